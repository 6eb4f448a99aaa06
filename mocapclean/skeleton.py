"""Joints, bones and forward kinematics, vectorised over frames."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Bone:
    """Two joints or markers, by name, and the distance between them in millimetres."""

    start: str
    end: str
    length: float


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


def forward(skeleton: Skeleton, poses: Floats) -> tuple[Floats, Floats]:
    """Forward kinematics of poses (F, C), degrees and millimetres.

    Returns the joint positions (F, J, 3) in millimetres and the global rotations (F, J, 3, 3). A NaN channel makes
    everything that hangs on it NaN.
    """
    n_frames, n_joints = len(poses), len(skeleton.names)
    positions = np.empty((n_frames, n_joints, 3))
    rotations = np.empty((n_frames, n_joints, 3, 3))
    local: list[Floats | None] = [None] * n_joints
    shift: dict[int, Floats] = {}
    for index in skeleton.product:
        channel = skeleton.channels[index]
        matrix = turn(channel.axis, poses[:, index])
        previous = local[channel.joint]
        local[channel.joint] = matrix if previous is None else previous @ matrix
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation:
            shift.setdefault(channel.joint, np.zeros((n_frames, 3)))[:, channel.axis] = poses[:, index]
    for joint, parent in enumerate(skeleton.parents):
        axes, turned = skeleton.frames[joint], local[joint]
        own = np.broadcast_to(np.eye(3), (n_frames, 3, 3)) if turned is None else axes @ turned @ axes.T
        reach = skeleton.before[joint] + shift.get(joint, 0.0)
        if parent >= 0:
            base = rotations[:, parent]
            own = base @ own
            place = positions[:, parent] + np.einsum("fij,fj->fi", base, np.broadcast_to(reach, (n_frames, 3)))
        else:
            place = np.broadcast_to(reach, (n_frames, 3))
        rotations[:, joint] = own
        positions[:, joint] = place + own @ skeleton.after[joint]
    return positions, rotations
