"""Joints, bones and forward kinematics, vectorised over frames."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats


@dataclass(frozen=True, kw_only=True)
class Bone:
    """Two joints or markers, by name, the distance between them and its standard deviation, both in millimetres."""

    start: str
    end: str
    length: float
    spread: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One degree of freedom: ``joint`` turns about, or moves along, ``axis`` (0, 1, 2 for x, y, z)."""

    joint: int
    axis: int
    is_rotation: bool


@dataclass(frozen=True, kw_only=True)
class Skeleton:
    """A tree of J joints, each after its parent, with C channels.

    names: J names. parents: J indices, -1 for a root. before: (J, 3) millimetres, from the parent's place in the
    parent's frame (a BVH OFFSET); after: (J, 3) millimetres, in the joint's own frame (an ASF bone, whose name
    stands for its far end). frames: (J, 3, 3) rotation C of the joint's axes: its local rotation is C R Cᵀ.
    channels: in the order of the columns of a pose table. product: channel indices, joint by joint, in the order
    in which the elementary rotations are multiplied from the left.

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
        """The parent-to-joint distances that every pose keeps; none for joints that translate or coincide."""
        moving = {c.joint for c in self.channels if not c.is_rotation}
        found = []
        for joint, parent in enumerate(self.parents):
            before, after = (float(np.linalg.norm(v[joint])) for v in (self.before, self.after))
            length = max(before, after)
            if parent >= 0 and joint not in moving and length > 0 and min(before, after) == 0:
                found.append(Bone(start=self.names[parent], end=self.names[joint], length=length))
        return tuple(found)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A skeleton in motion: where its joints are, how they are turned, and what each channel works along.

    positions: (F, J, 3) millimetres. rotations: (F, J, 3, 3) global. axes: (F, C, 3) unit vectors, the global
    direction about which, or along which, a channel moves what hangs on it.
    """

    positions: Floats
    rotations: Floats
    axes: Floats


def turn(axis: int, degrees: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) about one coordinate axis by angles (...)."""
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
    """Which channels decide where a joint is, and which how it is turned: two (J, C) masks."""
    shape = (len(skeleton.names), len(skeleton.channels))
    moved, turned = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    own = np.array([c.joint for c in skeleton.channels], dtype=int)
    rotates = np.array([c.is_rotation for c in skeleton.channels], dtype=bool)
    for joint, parent in enumerate(skeleton.parents):
        shifts = (own == joint) & ~rotates
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
    """Forward kinematics of finite poses (F, C), degrees and millimetres."""
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
        if parent >= 0:
            base = rotations[:, parent]
            place = positions[:, parent] + base @ skeleton.before[joint]
        else:
            base = np.broadcast_to(np.eye(3), (n_frames, 3, 3))
            place = np.broadcast_to(skeleton.before[joint], (n_frames, 3))
        for index in shifts[joint]:
            axes[:, index] = base[:, :, skeleton.channels[index].axis]
            place = place + axes[:, index] * poses[:, index, None]
        if turns[joint]:
            base = base @ skeleton.frames[joint]
            for index in turns[joint]:
                axis = skeleton.channels[index].axis
                axes[:, index] = base[:, :, axis]
                base = base @ turn(axis, poses[:, index])
            base = base @ skeleton.frames[joint].T
        rotations[:, joint] = base
        positions[:, joint] = place + base @ skeleton.after[joint]
    return Motion(positions=positions, rotations=rotations, axes=axes)


def forward(skeleton: Skeleton, poses: Floats) -> tuple[Floats, Floats]:
    """Forward kinematics of poses (F, C), degrees and millimetres.

    Returns the joint positions (F, J, 3) in millimetres and the global rotations (F, J, 3, 3). A NaN channel makes
    NaN every position and every rotation that it decides, and no other.
    """
    missing = np.isnan(poses)
    motion = move(skeleton, np.where(missing, 0.0, poses))
    if missing.any():
        moved, turned = influence(skeleton)
        motion.positions[missing @ moved.T] = np.nan
        motion.rotations[missing @ turned.T] = np.nan
    return motion.positions, motion.rotations
