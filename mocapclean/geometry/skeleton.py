"""Joints, bones and forward kinematics, vectorised over frames."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats


@dataclass(frozen=True, kw_only=True)
class Bone:
    """A bone between two joints or markers, by name; length and spread, its standard deviation, are millimetres."""

    start: str
    end: str
    length: float
    spread: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Channel:
    """A degree of freedom: ``joint`` turns about, or moves along, ``axis`` (0, 1, 2 for x, y, z)."""

    joint: int
    axis: int
    is_rotation: bool


@dataclass(frozen=True, kw_only=True)
class Skeleton:
    """A tree of J joints, each after its parent, with C channels.

    names: J names. parents: J indices, -1 for a root. before: (J, 3) millimetres, an offset from the parent in the
    parent's frame, which the joint's rotation does not turn (a BVH OFFSET). after: (J, 3) millimetres, an offset in
    the joint's own frame, which its rotation turns (an ASF bone, named for its far end). frames: (J, 3, 3) rotation C
    of the joint's axes: its local rotation is C R Cᵀ. channels: in the order of the columns of a pose table. product:
    channel indices, joint by joint, in the order in which the elementary rotations are multiplied from the left.

    With G the global rotation, t the translation channels and R = Π R_axis(angle) in product order:
    G_j = G_parent C_j R_j C_jᵀ and p_j = p_parent + G_parent (before_j + t_j) + G_j after_j.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    before: Floats
    after: Floats
    frames: Floats
    channels: tuple[Channel, ...]
    product: tuple[int, ...]

    def bones(self) -> tuple[Bone, ...]:
        """Return the parent-to-joint distances that every pose keeps; none for joints that translate or coincide."""
        moving = {c.joint for c in self.channels if not c.is_rotation}
        bones = []
        for joint, parent in enumerate(self.parents):
            before, after = (float(np.linalg.norm(v[joint])) for v in (self.before, self.after))
            # With both offsets the distance depends on the rotation between them.
            length = max(before, after)
            if parent >= 0 and joint not in moving and length > 0 and min(before, after) == 0:
                bones.append(Bone(start=self.names[parent], end=self.names[joint], length=length))
        return tuple(bones)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The forward kinematics of a skeleton in F poses.

    positions: (F, J, 3) millimetres. rotations: (F, J, 3, 3) global. axes: (F, C, 3) unit vectors, the global
    direction about which, or along which, a channel moves the joints below it.
    """

    positions: Floats
    rotations: Floats
    axes: Floats


def turn(axis: int, degrees: Floats) -> Floats:
    """Return the rotation matrices (..., 3, 3) about a coordinate axis by angles (...) in degrees."""
    radians = np.radians(degrees)
    cos, sin = np.cos(radians), np.sin(radians)
    matrix = np.zeros((*np.shape(degrees), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[..., axis, axis] = 1.0
    matrix[..., i, i] = matrix[..., j, j] = cos
    matrix[..., j, i] = sin
    matrix[..., i, j] = -sin
    return matrix


def influence(skeleton: Skeleton) -> tuple[Bools, Bools]:
    """Return which channels decide a joint's position, and which its rotation: two masks (J, C)."""
    shape = (len(skeleton.names), len(skeleton.channels))
    moved, turned = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    own = np.array([c.joint for c in skeleton.channels], dtype=int)
    rotates = np.array([c.is_rotation for c in skeleton.channels], dtype=bool)
    for joint, parent in enumerate(skeleton.parents):
        shifts = (own == joint) & ~rotates
        # The parent's rotation moves a joint only at a distance from the parent, the joint's own one only its bone.
        if parent >= 0:
            moved[joint], turned[joint] = moved[parent], turned[parent]
            if shifts.any() or skeleton.before[joint].any():
                moved[joint] |= turned[parent]
        moved[joint] |= shifts
        turned[joint] |= (own == joint) & rotates
        if skeleton.after[joint].any():
            moved[joint] |= turned[joint]
    return moved, turned


def move(skeleton: Skeleton, poses: Floats) -> Motion:
    """Return the forward kinematics of finite poses (F, C), degrees and millimetres."""
    n_frames, n_joints = len(poses), len(skeleton.names)
    positions = np.empty((n_frames, n_joints, 3))
    rotations = np.empty((n_frames, n_joints, 3, 3))
    axes = np.empty((n_frames, len(skeleton.channels), 3))
    turns: list[list[int]] = [[] for _ in range(n_joints)]
    shifts: list[list[int]] = [[] for _ in range(n_joints)]
    for index in skeleton.product:
        turns[skeleton.channels[index].joint].append(index)
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation:
            shifts[channel.joint].append(index)
    for joint, parent in enumerate(skeleton.parents):
        # p = p_parent + G_parent (before + t)
        if parent >= 0:
            base = rotations[:, parent]
            place = positions[:, parent] + base @ skeleton.before[joint]
        else:
            base = np.broadcast_to(np.eye(3), (n_frames, 3, 3))
            place = np.broadcast_to(skeleton.before[joint], (n_frames, 3))
        for index in shifts[joint]:
            axes[:, index] = base[:, :, skeleton.channels[index].axis]
            place = place + axes[:, index] * poses[:, index, None]
        # G = G_parent C R Cᵀ
        if turns[joint]:
            base = base @ skeleton.frames[joint]
            for index in turns[joint]:
                axis = skeleton.channels[index].axis
                axes[:, index] = base[:, :, axis]
                base = base @ turn(axis, poses[:, index])
            base = base @ skeleton.frames[joint].T
        # p + G after
        rotations[:, joint] = base
        positions[:, joint] = place + base @ skeleton.after[joint]
    return Motion(positions=positions, rotations=rotations, axes=axes)


def forward(skeleton: Skeleton, poses: Floats) -> tuple[Floats, Floats]:
    """Return joint positions (F, J, 3), mm, and global rotations (F, J, 3, 3) of poses (F, C), degrees and mm.

    A NaN channel makes NaN every position and every rotation that it decides, and no other.
    """
    missing = np.isnan(poses)
    motion = move(skeleton, np.where(missing, 0.0, poses))
    if missing.any():
        moved, turned = influence(skeleton)
        motion.positions[missing @ moved.T] = np.nan
        motion.rotations[missing @ turned.T] = np.nan
    return motion.positions, motion.rotations
