"""The start of inverse kinematics: joint chains turned, from the roots outwards, towards their targets.

A ball joint (three rotations about different axes) is swung by the smallest rotation that points the joints it carries
at their targets. That is Wahba's problem (G. Wahba, SIAM Review 7(3) 409, 1965, doi:10.1137/1007077), solved by the
singular value decomposition of F. L. Markley, J. Astronautical Sciences 36, 245-258, 1988. If a hinge follows, the
twist of the ball joint is chosen so that the hinge can reach its target, by the smaller of two angles. Other rotations
are turned one after the other, each by the angle that brings the carried joints nearest to their targets.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.euler import euler_angles, is_ball, nearest_angles, rotations_of
from mocapclean.geometry.skeleton import Skeleton, move, turn

LEAST_LEVER = 0.05
"""Share of the product of two lengths: an angle that is decided by less is left as it was. Below it, vectors lie nearly
along the axis, and noise would decide. Chosen by hand; no sweep was kept."""
SHORTEST_BONE = 1e-9
"""Millimetres: keeps the direction of a bone without length from being divided by zero."""
IDENTITY_SHARE = 1e-6
"""Share of the moment matrix's size that is added as a multiple of the identity: where the targets leave a rotation
undetermined, the smallest one is taken. Chosen by hand."""
IDENTITY_FLOOR = 1e-9
"""mm²: the same where there is no target at all, so that the rotation is the identity."""


def aim(skeleton: Skeleton, poses: Floats, free: Bools, known: Bools, targets: Floats) -> Floats:
    """Return poses (F, C) whose free rotations point, from the roots outwards, at the targets.

    targets: (F, J, 3) millimetres. known: (F, J) bool, the joints whose target counts.
    """
    return _AimingPass(skeleton, poses, free, known, targets).poses


class _AimingPass:
    """One pass over the joints, each after its parent.

    start, before: the poses to start from and their forward kinematics. poses, positions, rotations: the poses so far
    and the global positions and rotations of the joints that were passed. targets: (F, J, 3) mm, zero where unknown.
    pivots: (F, J, 3) mm, the points about which the joints turn at the start. carried, hinges: see the functions.
    """

    def __init__(self, skeleton: Skeleton, poses: Floats, free: Bools, known: Bools, targets: Floats) -> None:
        self.skeleton, self.start, self.poses, self.free, self.known = skeleton, poses, poses.copy(), free, known
        self.targets = np.where(known[:, :, None], targets, 0.0)
        self.before = move(skeleton, poses)
        self.pivots = self.before.positions - np.einsum("fjab,jb->fja", self.before.rotations, skeleton.after)
        self.positions, self.rotations = self.before.positions.copy(), self.before.rotations.copy()
        self.turns = rotations_of(skeleton)
        self.carried = _carried(skeleton, self.turns)
        self.hinges = _hinges(skeleton, self.turns, self.carried)
        for joint, parent in enumerate(skeleton.parents):
            pivot = self._follow(joint, parent)
            if self.turns[joint] and self.carried[joint]:
                rows = np.flatnonzero(free[:, self.turns[joint]].any(axis=1))
                if len(rows):
                    self._turn(joint, rows, pivot[rows])
            self.positions[:, joint] = pivot + self.rotations[:, joint] @ skeleton.after[joint]

    def _follow(self, joint: int, parent: int) -> Floats:
        """Move the joint rigidly with its parent; return its new pivot (F, 3)."""
        if parent < 0:
            return self._shift_root(joint)
        change = self.rotations[:, parent] @ _transposed(self.before.rotations[:, parent])
        self.rotations[:, joint] = change @ self.before.rotations[:, joint]
        return self.positions[:, parent] + _apply(change, self.pivots[:, joint] - self.before.positions[:, parent])

    def _shift_root(self, joint: int) -> Floats:
        """Bring a root to its own target where its three shifts are free; return its new pivot (F, 3)."""
        shifts = {c.axis: i for i, c in enumerate(self.skeleton.channels) if c.joint == joint and not c.is_rotation}
        if len(shifts) < 3 or self.skeleton.after[joint].any():
            return np.asarray(self.pivots[:, joint])
        columns = np.array([shifts[axis] for axis in range(3)])
        rows = np.flatnonzero(self.free[:, columns].all(axis=1) & self.known[:, joint])
        self.poses[np.ix_(rows, columns)] = self.targets[rows, joint] - self.skeleton.before[joint]
        pivot = self.pivots[:, joint].copy()
        pivot[rows] = self.targets[rows, joint]
        return np.asarray(pivot)

    def _turn(self, joint: int, rows: Ints, pivot: Floats) -> None:
        """Turn a joint, in some frames, so that the joints it carries point at their targets."""
        group, carried, frame = self.turns[joint], self.carried[joint], self.skeleton.frames[joint]
        axes = [self.skeleton.channels[i].axis for i in group]
        cells = np.ix_(rows, np.array(group))
        # Arms: pivot to carried joint, in the joint's own frame. Lines: pivot to target; zero where there is no target.
        offsets = self.before.positions[rows][:, carried] - self.pivots[rows, joint][:, None]
        arms = offsets @ self.before.rotations[rows, joint]
        lines = (self.targets[rows][:, carried] - pivot[:, None]) * self.known[rows][:, carried, None]
        rotation = self.rotations[rows, joint]
        parent = self.skeleton.parents[joint]
        base = (self.rotations[rows, parent] if parent >= 0 else np.eye(3)) @ frame
        if is_ball(axes) and self.free[cells].all():
            rotation = _smallest_rotations(arms @ _transposed(rotation), lines) @ rotation
            if joint in self.hinges:
                rotation = self._twist(joint, rows, pivot, rotation) @ rotation
            # The joint's own rotation R from G = G_parent C R Cᵀ.
            own = _transposed(base) @ rotation @ frame
            angles = nearest_angles(axes, euler_angles(axes, own), self.start[cells])
        else:
            angles = _turned_one_by_one(axes, self.start[cells], self.free[cells], base, arms @ frame, lines)
            rotation = base @ _product(axes, angles) @ frame.T
        self.rotations[rows, joint] = rotation
        self.poses[cells] = angles

    def _twist(self, joint: int, rows: Ints, pivot: Floats, rotation: Floats) -> Floats:
        """Return the smallest rotation about the bone that lets the hinge at its end reach its target.

        With u the bone's direction, h the hinge axis, l the line from the hinge to the target and k the length of the
        hinge's arm along h, the angle τ solves (R_u(τ) h) · l = k. By Rodrigues' formula this is
        A + B cos τ + C sin τ = 0 with A = (h·u)(u·l) - k, B = h·l - (h·u)(u·l) and C = (u × h)·l. The solutions are
        τ = atan2(C, B) ± arccos(-A / √(B² + C²)).
        """
        hinge, channel, end = self.hinges[joint]
        change = rotation @ _transposed(self.before.rotations[rows, joint])
        bone = _apply(change, self.pivots[rows, hinge] - self.pivots[rows, joint])
        axis = _apply(change, self.before.axes[rows, channel])
        arm = _apply(change, self.before.positions[rows, end] - self.pivots[rows, hinge])
        line = self.targets[rows, end] - pivot - bone
        bone = bone / np.maximum(np.linalg.norm(bone, axis=1, keepdims=True), SHORTEST_BONE)
        along = _dot(axis, bone) * _dot(bone, line)
        a, b, c = along - _dot(axis, arm), _dot(axis, line) - along, _dot(np.cross(bone, axis), line)
        size = np.hypot(b, c)
        determined = self.known[rows, end] & (size > LEAST_LEVER * np.linalg.norm(line, axis=1))
        # An unreachable target is approached: the argument of arccos is clipped.
        half = np.arccos(np.clip(-a / np.where(determined, size, 1.0), -1, 1))
        both = np.arctan2(c, b) + np.stack([half, -half])
        both = (both + np.pi) % (2 * np.pi) - np.pi
        smaller = np.where(np.abs(both[0]) < np.abs(both[1]), both[0], both[1])
        return _rotations_about(bone, np.where(determined, smaller, 0.0))


def _carried(skeleton: Skeleton, turns: list[list[int]]) -> list[list[int]]:
    """Return the joints that each joint carries rigidly at a distance: no rotation lies between."""
    carried: list[list[int]] = [[] for _ in skeleton.names]
    for joint, parent in enumerate(skeleton.parents):
        holder = joint if skeleton.after[joint].any() else parent
        while holder >= 0 and not turns[holder]:
            holder = skeleton.parents[holder]
        if holder >= 0:
            carried[holder].append(joint)
    return carried


def _hinges(skeleton: Skeleton, turns: list[list[int]], carried: list[list[int]]) -> dict[int, tuple[int, int, int]]:
    """Return (hinge, its channel, the joint it carries) for each joint that carries nothing but a hinge.

    A hinge has a single rotation and carries a single joint, such as a knee or an elbow.
    """
    hinges = {}
    for hinge, parent in enumerate(skeleton.parents):
        holder = parent
        while holder >= 0 and not turns[holder]:
            holder = skeleton.parents[holder]
        if holder >= 0 and len(turns[hinge]) == len(carried[hinge]) == len(carried[holder]) == 1:
            hinges[holder] = (hinge, turns[hinge][0], carried[hinge][0])
    return hinges


def _transposed(matrices: Floats) -> Floats:
    """Return the transposes of matrices (..., 3, 3)."""
    return np.swapaxes(matrices, -1, -2)


def _apply(matrices: Floats, vectors: Floats) -> Floats:
    """Return the products (..., 3) of matrices (..., 3, 3) and vectors (..., 3)."""
    return (matrices @ vectors[..., None])[..., 0]


def _dot(a: Floats, b: Floats) -> Floats:
    """Return the scalar products (...) of vectors (..., 3)."""
    return np.asarray((a * b).sum(axis=-1))


def _smallest_rotations(arms: Floats, lines: Floats) -> Floats:
    """Return the smallest rotations (F, 3, 3) that turn arms (F, K, 3) towards lines (F, K, 3)."""
    # Wahba's moment matrix Σ line armᵀ, with a little of the identity where it does not determine the rotation.
    moment = _transposed(lines) @ arms
    size = np.linalg.norm(moment, axis=(1, 2))
    moment += (IDENTITY_SHARE * size + IDENTITY_FLOOR)[:, None, None] * np.eye(3)
    # R = U diag(1, 1, det UVᵀ) Vᵀ. The computed determinant is the factor, not its sign: files keep their spelling.
    left, _, right = np.linalg.svd(moment)
    left[..., 2] *= np.linalg.det(left @ right)[:, None]
    return np.asarray(left @ right)


def _rotations_about(axis: Floats, radians: Floats) -> Floats:
    """Return rotations (F, 3, 3) about unit axes (F, 3), by Rodrigues' formula I + sin τ [u]ₓ + (1 - cos τ) [u]ₓ²."""
    x, y, z = axis.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sin, cos = np.sin(radians)[:, None, None], np.cos(radians)[:, None, None]
    return np.asarray(np.eye(3) + sin * cross + (1 - cos) * (cross @ cross))


def _product(axes: list[int], angles: Floats) -> Floats:
    """Return the products (F, 3, 3) of elementary rotations by angles (F, n) about coordinate axes."""
    product = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    for i, axis in enumerate(axes):
        product = product @ turn(axis, angles[:, i])
    return product


def _turned_one_by_one(
    axes: list[int], angles: Floats, free: Bools, base: Floats, arms: Floats, lines: Floats
) -> Floats:
    """Return angles (F, n) of which each free one in its turn brings arms (F, K, 3) nearest to lines (F, K, 3).

    For the rotation about axis i with j, k the next two axes, x the arms in front of it and y the lines behind it, the
    best further angle is atan2(Σ (x_j y_k - x_k y_j), Σ (x_j y_j + x_k y_k)).
    """
    angles = angles.copy()
    lines = lines @ base
    for i in range(len(axes)):
        outer, inner = _product(axes[:i], angles[:, :i]), _product(axes[i:], angles[:, i:])
        j, k = (axes[i] + 1) % 3, (axes[i] + 2) % 3
        x, y = arms @ _transposed(inner), lines @ outer
        sin = (x[..., j] * y[..., k] - x[..., k] * y[..., j]).sum(axis=1)
        cos = (x[..., j] * y[..., j] + x[..., k] * y[..., k]).sum(axis=1)
        size = np.linalg.norm(x, axis=2) * np.linalg.norm(y, axis=2)
        determined = free[:, i] & (np.hypot(sin, cos) > LEAST_LEVER * size.sum(axis=1))
        angles[:, i] += np.where(determined, np.degrees(np.arctan2(sin, cos)), 0.0)
    return angles
