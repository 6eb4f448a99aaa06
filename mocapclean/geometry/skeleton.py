"""Joints, bones and forward kinematics, vectorised over frames."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mocapclean.arrays import Bools, Floats

CONSTANT_SHARE = 1e-3
"""Largest change of a position channel that counts as constant, per distance from the parent. Chosen by hand: two
decimals in centimetres round by less on a bone of 0.1 m, and no muscle or stretched limb moves so little."""


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

    @property
    def name(self) -> str:
        """The name of the channel as BVH spells it, such as ``Xrotation``."""
        return "XYZ"[self.axis] + ("rotation" if self.is_rotation else "position")


@dataclass(frozen=True, kw_only=True)
class Skeleton:
    """A tree of J joints, each after its parent, with C channels.

    names: J names. parents: J indices, -1 for a root. before: (J, 3) millimetres, an offset from the parent in the
    parent's frame, which the joint's rotation does not turn (a BVH OFFSET). after: (J, 3) millimetres, an offset in
    the joint's own frame, which its rotation turns (an ASF bone, named for its far end). frames: (J, 3, 3) rotation C
    of the joint's axes: its local rotation is C R Cᵀ. channels: in the order of the columns of a pose table. product:
    channel indices, joint by joint, in the order in which the elementary rotations are multiplied from the left.
    is_scaled: whether its millimetres are true ones; not so where a file states no unit and no body shows it.

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
    is_scaled: bool = True

    @cached_property
    def steps(self) -> "list[Step]":
        """The steps of forward kinematics, joint by joint."""
        return _steps(self)

    def bones(self, poses: Floats | None = None) -> tuple[Bone, ...]:
        """Return the parent-to-joint distances that every pose keeps; none for joints that translate or coincide.

        poses: (F, C) degrees and millimetres, NaN where unknown. With them, position channels that keep their values
        in all these poses count as offsets (``settled``).
        """
        if poses is not None:
            return settled(self, poses).bones()
        moving = {c.joint for c in self.channels if not c.is_rotation}
        bones = []
        for joint, parent in enumerate(self.parents):
            before, after = (float(np.linalg.norm(v[joint])) for v in (self.before, self.after))
            # With both offsets the distance depends on the rotation between them.
            length = max(before, after)
            if parent >= 0 and joint not in moving and length > 0 and min(before, after) == 0:
                bones.append(Bone(start=self.names[parent], end=self.names[joint], length=length))
        return tuple(bones)


def settled(skeleton: Skeleton, poses: Floats) -> Skeleton:
    """Return the skeleton in which position channels that never change are offsets, and no channels any more.

    poses: (F, C) degrees and millimetres, NaN where unknown. Only a joint below another one is settled, and only if
    none of its position channels changes by more than a thousandth of its distance from the parent.
    """
    own: dict[int, list[int]] = {}
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation and skeleton.parents[channel.joint] >= 0:
            own.setdefault(channel.joint, []).append(index)
    before, dropped = skeleton.before.copy(), set[int]()
    for joint, indices in own.items():
        values = poses[:, indices]
        values = values[np.isfinite(values).all(axis=1)]
        if not len(values):
            continue
        # t is constant: p = p_parent + G_parent (before + t) + G after
        offset = before[joint].copy()
        offset[[skeleton.channels[index].axis for index in indices]] += np.median(values, axis=0)
        length = max(float(np.linalg.norm(offset)), float(np.linalg.norm(skeleton.after[joint])))
        if np.ptp(values, axis=0).max() <= CONSTANT_SHARE * length:
            before[joint] = offset
            dropped.update(indices)
    if not dropped:
        return skeleton
    kept = [index for index in range(len(skeleton.channels)) if index not in dropped]
    places = {index: place for place, index in enumerate(kept)}
    return replace(
        skeleton,
        before=before,
        channels=tuple(skeleton.channels[index] for index in kept),
        product=tuple(places[index] for index in skeleton.product),
    )


Vector = list[tuple[int, float]]
"""A vector in space by its coordinates that are not zero: (axis, size)."""
Matrix = list[Vector]
"""The three columns of a matrix."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """What forward kinematics does at a joint, with H = G C for the rotation of a joint's own axes.

    The equations of ``Skeleton`` then read H = H_parent (C_parentᵀ C) R and
    p = p_parent + H_parent (C_parentᵀ before) + H_parent (C_parentᵀ t) + H (Cᵀ after). The brackets are constant.

    parent: of the joint, -1 for a root. before, after: the bracketed offsets. shifts: (channel, direction of t) of
    each position channel. change: C_parentᵀ C, None if it is the identity. turns: (channel, axis) of each rotation
    channel in product order. upright: Cᵀ, None if it is the identity. places: whether H decides any position.
    """

    parent: int
    before: Vector
    after: Vector
    shifts: list[tuple[int, Vector]]
    change: Matrix | None
    turns: list[tuple[int, int]]
    upright: Matrix | None
    places: bool


def _steps(skeleton: Skeleton) -> list[Step]:
    """Return the steps of forward kinematics, joint by joint."""
    turns: list[list[tuple[int, int]]] = [[] for _ in skeleton.names]
    shifts: list[list[int]] = [[] for _ in skeleton.names]
    for index in skeleton.product:
        turns[skeleton.channels[index].joint].append((index, skeleton.channels[index].axis))
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation:
            shifts[channel.joint].append(index)
    steps = []
    for joint, parent in enumerate(skeleton.parents):
        own, above = skeleton.frames[joint], skeleton.frames[parent] if parent >= 0 else np.eye(3)
        steps.append(
            Step(
                parent=parent,
                before=_vector(above.T @ skeleton.before[joint]),
                after=_vector(own.T @ skeleton.after[joint]),
                shifts=[(index, _vector(above[skeleton.channels[index].axis])) for index in shifts[joint]],
                change=_matrix(above.T @ own),
                turns=turns[joint],
                upright=_matrix(own.T),
                places=joint in skeleton.parents or bool(skeleton.after[joint].any()),
            )
        )
    return steps


def _vector(vector: Floats) -> Vector:
    """Return the coordinates of a vector (3,) that are not zero."""
    return [(int(axis), float(vector[axis])) for axis in np.flatnonzero(vector)]


def _matrix(matrix: Floats) -> Matrix | None:
    """Return the columns of a matrix (3, 3), or None for the identity."""
    return None if (matrix == np.eye(3)).all() else [_vector(column) for column in matrix.T]


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
    for joint, (place, columns) in enumerate(_walk(skeleton, poses, axes)):
        positions[:, joint] = place.T
        # G = H Cᵀ
        rotations[:, joint] = _times(columns, skeleton.steps[joint].upright).transpose(2, 1, 0)
    return Motion(positions=positions, rotations=rotations, axes=axes)


def placed(skeleton: Skeleton, poses: Floats) -> Floats:
    """Return the joint positions (F, J, 3), mm, of finite poses (F, C), the same as those of ``move``."""
    positions = np.empty((len(skeleton.names), 3, len(poses)))
    for joint, (place, _) in enumerate(_walk(skeleton, poses)):
        positions[joint] = place
    return np.ascontiguousarray(positions.transpose(2, 0, 1))


def _walk(skeleton: Skeleton, poses: Floats, axes: Floats | None = None) -> Iterator[tuple[Floats, Floats]]:
    """Yield the positions p (3, F) of each joint and the columns of its H = G C (3 columns, 3, F), see ``Step``.

    Frames are the last axis, so that each step is arithmetic on whole rows of numbers. axes: (F, C, 3), filled if
    given. Without it, the H of a joint that decides no position is not that of the joint.
    """
    # Rows of the channels; the cosine and the sine of a shift are not used.
    values = np.ascontiguousarray(poses.T)
    radians = np.radians(values)
    cos, sin = np.cos(radians), np.sin(radians)
    origin, upright = np.zeros((3, len(poses))), np.broadcast_to(np.eye(3)[:, :, None], (3, 3, len(poses)))
    passed: list[tuple[Floats, Floats]] = []
    for step in skeleton.steps:
        place, columns = passed[step.parent] if step.parent >= 0 else (origin, upright)
        # p = p_parent + G_parent (before + t)
        place = _plus(place, columns, step.before)
        for index, direction in step.shifts:
            axis = _plus(None, columns, direction)
            place = place + axis * values[index]
            if axes is not None:
                axes[:, index] = axis.T
        # H = G_parent C R
        if step.places or axes is not None:
            columns = _times(columns, step.change)
            for index, around in step.turns:
                if axes is not None:
                    axes[:, index] = columns[around].T
                columns = _turned(columns, around, cos[index], sin[index])
        # p + G after
        place = _plus(place, columns, step.after)
        passed.append((place, columns))
        yield place, columns


def _turned(columns: Floats, axis: int, cos: Floats, sin: Floats) -> Floats:
    """Return the columns (3, 3, F) of the products of rotations and elementary rotations about an axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turned = np.empty_like(columns)
    turned[axis] = columns[axis]
    turned[i] = columns[i] * cos + columns[j] * sin
    turned[j] = columns[j] * cos - columns[i] * sin
    return turned


def _times(columns: Floats, matrix: Matrix | None) -> Floats:
    """Return the columns (3, 3, F) of the products of rotations, given by theirs, and one matrix; None is identity."""
    return columns if matrix is None else np.stack([_plus(None, columns, vector) for vector in matrix])


def _plus(place: Floats | None, columns: Floats, vector: Vector) -> Floats:
    """Return places (3, F), or none, plus a vector that rotations with these columns (3, 3, F) turn."""
    for axis, size in vector:
        part = columns[axis] * size
        place = part if place is None else place + part
    return np.zeros_like(columns[0]) if place is None else place


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


def places(skeleton: Skeleton, poses: Floats) -> Floats:
    """Return the joint positions (F, J, 3) of ``forward``, which takes several times as long."""
    missing = np.isnan(poses)
    if not missing.any():
        return placed(skeleton, poses)
    positions = placed(skeleton, np.where(missing, 0.0, poses))
    moved, _ = influence(skeleton)
    rows = np.flatnonzero(missing.any(axis=1))
    positions[rows] = np.where((missing[rows] @ moved.T)[:, :, None], np.nan, positions[rows])
    return positions
