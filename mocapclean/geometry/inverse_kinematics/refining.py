"""Levenberg-Marquardt steps of inverse kinematics, in many frames at once.

The objective of a frame, over its free channels θ, is

    w Σ_fixed |p_k - target_k|² + Σ_wanted |p_k - target_k|² + Σ_free s_c (θ_c - start_c)²

with a w so large that fixed joints do not move, and s so small that it decides only what no position shows, such as
the twist about a bone. The Jacobian is geometric: ∂p_k/∂θ_c = a_c × (p_k - q_c) for a turn about the global axis a_c
through q_c, and a_c for a shift (D. E. Orin and W. W. Schrader, Int. J. Robotics Research 3(4) 66-75, 1984,
doi:10.1177/027836498400300404); the damping is that of K. Levenberg, Quart. Appl. Math. 2(2) 164-168, 1944,
doi:10.1090/qam/10666. A step is chosen with a large w but at first judged with a small one: along the curved set of
poses that keep the fixed joints, a straight step always leaves it a little.

One step costs O(d² K + n³) per frame with n free channels and K joints that they move, each at most d deep.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.skeleton import Motion, Skeleton, influence, move

BOLD = ((1e1, 1e4), (1e6, 1e6))  # stages: w when a step is judged, and when it is chosen
CAREFUL = ((1e6, 1e6), (1e3, 1e5), (1e6, 1e6))  # first the fixed joints, then the wanted ones
STEPS = 12  # at most, per stage
STRIDE = 30.0  # degrees or millimetres, the longest change of a channel in one step
DAMPING = (1e-2, 1e8)  # at the start, and where a frame is given up
GAIN = (1e-2, 1e-3)  # of the cost, and mm²: steps that gain less end a stage
BATCH = 256  # frames solved together even though their free channels differ
ROOM = 1e6  # numbers in the working arrays of a batch: they should stay in the cache


def refine(
    skeleton: Skeleton,
    start: Floats,
    free: Bools,
    wanted: Bools,
    fixed: Bools,
    targets: Floats,
    slack: Floats,
    *,
    careful: bool = False,
) -> Floats:
    """Poses (F, C) near ``start`` that bring wanted joints to their targets and keep fixed ones on theirs.

    free, slack: (F, C), the channels to change and their s per degree² or mm². wanted, fixed: (F, J) bool. targets:
    (F, J, 3) millimetres. ``careful`` first satisfies the fixed joints and then moves along with them.
    """
    found = start.copy()
    moved, _ = influence(skeleton)
    for rows in _batches(free, wanted.shape[1]):
        columns = np.flatnonzero(free[rows].any(axis=0))
        counted = wanted[rows] | fixed[rows]
        joints = np.flatnonzero(counted.any(axis=0) & moved[:, columns].any(axis=1))
        if not len(joints):
            continue
        system = _System(
            skeleton=skeleton,
            columns=columns,
            joints=joints,
            moves=moved[np.ix_(joints, columns)].T,
            owners=np.array([skeleton.channels[c].joint for c in columns]),
            turns=np.array([skeleton.channels[c].is_rotation for c in columns]),
            start=start[rows],
            free=free[np.ix_(rows, columns)],
            wanted=wanted[np.ix_(rows, joints)].astype(float),
            fixed=fixed[np.ix_(rows, joints)].astype(float),
            goals=np.where(counted[:, joints, None], targets[np.ix_(rows, joints)], 0.0),
            slack=np.where(free[np.ix_(rows, columns)], slack[np.ix_(rows, columns)], 1.0),
        )
        angles = start[np.ix_(rows, columns)]
        for judged, chosen in CAREFUL if careful else BOLD:
            angles = _descend(system, angles, judged, chosen)
        found[np.ix_(rows, columns)] = angles
    return found


def _batches(free: Bools, n_joints: int) -> Iterator[Ints]:
    """Frames, those with the same free channels side by side, as many as there is room for."""
    _, kind = np.unique(free, axis=0, return_inverse=True)
    order = np.argsort(kind.reshape(-1), kind="stable")
    for first in range(0, len(order), BATCH):
        rows = order[first : first + BATCH]
        n_free = int(free[rows].any(axis=0).sum())
        size = max(1, int(ROOM / (max(n_free, 1) ** 2 + 12 * n_joints)))
        yield from (rows[i : i + size] for i in range(0, len(rows), size))


@dataclass(frozen=True, kw_only=True)
class _System:
    """The least squares of a batch of frames: n channels (columns) and the K joints that they move."""

    skeleton: Skeleton
    columns: Ints
    joints: Ints
    moves: Bools
    owners: Ints
    turns: Bools
    start: Floats
    free: Bools
    wanted: Floats
    fixed: Floats
    goals: Floats
    slack: Floats

    def place(self, rows: Ints, angles: Floats, weight: float) -> tuple[Floats, Floats, Motion]:
        """Cost (f,), misses (f, K, 3) and motion of some frames."""
        poses = self.start[rows]
        poses[:, self.columns] = angles
        motion = move(self.skeleton, poses)
        misses = motion.positions[:, self.joints] - self.goals[rows]
        squares = np.einsum("fki,fki->fk", misses, misses)
        drift = self.slack[rows] * (angles - self.start[rows][:, self.columns]) ** 2
        return (self.weights(rows, weight) * squares).sum(axis=1) + drift.sum(axis=1), misses, motion

    def weights(self, rows: Ints, weight: float) -> Floats:
        """Weights (f, K) of the joints; zero for those neither wanted nor fixed."""
        return np.asarray(self.wanted[rows] + weight * self.fixed[rows])

    def normal(
        self, rows: Ints, angles: Floats, misses: Floats, motion: Motion, weight: float
    ) -> tuple[Floats, Floats]:
        """Gradient (f, n) and Gauss-Newton matrix (f, n, n)."""
        n_rows, n_columns = angles.shape
        weights, free = self.weights(rows, weight), self.free[rows]
        axes = motion.axes[:, self.columns] * np.where(self.turns, np.radians(1.0), 1.0)[:, None] * free[:, :, None]
        after = self.skeleton.after[self.owners]
        hubs = motion.positions[:, self.owners] - np.einsum("fnij,nj->fni", motion.rotations[:, self.owners], after)
        gradient = self.slack[rows] * (angles - self.start[rows][:, self.columns])
        matrix = np.zeros((n_rows, n_columns, n_columns))
        for index, joint in enumerate(self.joints):
            above = np.flatnonzero(self.moves[:, index])
            slopes = axes[:, above]
            turns = np.flatnonzero(self.turns[above])
            arms = motion.positions[:, None, joint] - hubs[:, above[turns]]
            slopes[:, turns] = _cross(slopes[:, turns], arms)
            heavy = slopes * weights[:, index, None, None]
            gradient[:, above] += (heavy @ misses[:, index, :, None])[:, :, 0]
            matrix[:, above[:, None], above] += heavy @ np.swapaxes(slopes, 1, 2)
        diagonal = np.arange(n_columns)
        matrix[:, diagonal, diagonal] += self.slack[rows]
        return gradient, matrix


def _cross(a: Floats, b: Floats) -> Floats:
    """The cross products of (..., 3); numpy's own is slower by far."""
    found = np.empty_like(a)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        found[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return found


def _descend(system: _System, angles: Floats, judged: float, chosen: float) -> Floats:
    """Damped Gauss-Newton steps, frame by frame until they gain little."""
    found = angles.copy()
    rows = np.arange(len(found))
    diagonal = np.arange(found.shape[1])
    cost, misses, motion = system.place(rows, found, judged)
    gradient, matrix = system.normal(rows, found, misses, motion, chosen)
    damping = np.full(len(rows), DAMPING[0])
    for _ in range(STEPS):
        damped = matrix.copy()
        damped[:, diagonal, diagonal] += damping[:, None]
        step = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        longest = np.abs(step).max(axis=1)
        trial = found[rows] + step * np.minimum(1.0, STRIDE / np.maximum(longest, STRIDE))[:, None]
        new_cost, misses, motion = system.place(rows, trial, judged)
        better = new_cost < cost
        found[rows[better]] = trial[better]
        gains = cost - new_cost > GAIN[0] * cost + GAIN[1]
        damping = np.where(better, damping / 10, damping * 10)
        going = np.where(better, gains, damping < DAMPING[1])
        if not going.any():
            break
        cost = np.where(better, new_cost, cost)
        renew = better & going
        if renew.any():
            part = Motion(positions=motion.positions[renew], rotations=motion.rotations[renew], axes=motion.axes[renew])
            gradient[renew], matrix[renew] = system.normal(rows[renew], trial[renew], misses[renew], part, chosen)
        rows, cost, damping = rows[going], cost[going], damping[going]
        gradient, matrix = gradient[going], matrix[going]
    return found
