"""Damped least squares (Levenberg-Marquardt) for inverse kinematics, in many frames at once.

The cost of a frame, over its free channels θ, is

    w Σ_fixed |p_k - t_k|² + Σ_wanted |p_k - t_k|² + Σ_free s_c (θ_c - θ⁰_c)²

with joint positions p, targets t and start θ⁰. The weight w is so large that fixed joints do not move. The weights s
are so small that they decide only what no position shows, such as the twist about a bone. The Jacobian is geometric:
∂p_k/∂θ_c = a_c × (p_k - q_c) for a rotation about the global axis a_c through the pivot q_c, and a_c for a shift
(D. E. Orin and W. W. Schrader, Int. J. Robotics Research 3(4) 66-75, 1984, doi:10.1177/027836498400300404). The step
solves (JᵀWJ + S + λI) δ = -g with the damping λ of K. Levenberg, Quart. Appl. Math. 2(2) 164-168, 1944,
doi:10.1090/qam/10666. A step is computed with a large w but at first accepted by a cost with a small one: the poses
that keep the fixed joints form a curved set, which a straight step always leaves a little.

One step costs O(d² K + n³) per frame with n free channels and K joints that they move, each at most d deep.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.skeleton import Motion, Skeleton, influence, move


class Stage(NamedTuple):
    """The weights w of the fixed joints in a stage: in the cost that accepts a step, and in the step itself."""

    accept: float
    step: float


# All numbers below were chosen by hand and no sweep was kept.

TOGETHER = (Stage(accept=1e1, step=1e4), Stage(accept=1e6, step=1e6))
"""Stages of a first attempt: wanted and fixed joints together, then the fixed joints to the tolerance."""
CONSTRAINTS_FIRST = (Stage(accept=1e6, step=1e6), Stage(accept=1e3, step=1e5), Stage(accept=1e6, step=1e6))
"""Stages of a further attempt: fixed joints first, then wanted joints along with them, then the fixed joints again."""
MOST_STEPS = 12
"""Steps of a stage at most."""
LONGEST_STEP = 30.0
"""Degrees or millimetres: the longest change of a channel in one step, beyond which a linear model of a chain fails."""
FIRST_DAMPING = 1e-2
"""λ of the first step, mm² per degree² or mm²: a hundred times the weight of the start in a first attempt."""
MOST_DAMPING = 1e8
"""λ beyond which a frame's stage ends: steps have become too short to matter."""
DAMPING_FACTOR = 10
"""λ is divided by this after a step that was accepted, multiplied by it after a step that was not."""
LEAST_GAIN_SHARE = 1e-2
"""Share of the cost: a step that gains less than this and ``LEAST_GAIN`` together ends a frame's stage."""
LEAST_GAIN = 1e-3
"""mm²: see ``LEAST_GAIN_SHARE``; the square of 0.03 mm."""
BATCH_FRAMES = 256
"""Frames solved together at most, even though their free channels differ."""
BATCH_NUMBERS = 1e6
"""Numbers in the working arrays of a batch at most (8 MB), so that they stay in a processor's cache."""
NUMBERS_PER_JOINT = 12
"""Numbers of a joint in the working arrays: its position (3) and its rotation (9)."""


def least_squares(
    skeleton: Skeleton,
    start: Floats,
    free: Bools,
    wanted: Bools,
    fixed: Bools,
    targets: Floats,
    start_weights: Floats,
    *,
    constraints_first: bool = False,
) -> Floats:
    """Return poses (F, C) near ``start`` that bring wanted joints to their targets and keep fixed joints on theirs.

    free, start_weights: (F, C), the channels to change and their s per degree² or mm². wanted, fixed: (F, J) bool.
    targets: (F, J, 3) millimetres. constraints_first: satisfy the fixed joints, then move along with them.
    """
    fitted = start.copy()
    places, _ = influence(skeleton)
    for rows in _batches(free, wanted.shape[1]):
        columns = np.flatnonzero(free[rows].any(axis=0))
        counted = wanted[rows] | fixed[rows]
        joints = np.flatnonzero(counted.any(axis=0) & places[:, columns].any(axis=1))
        if not len(joints):
            continue
        cells = np.ix_(rows, columns)
        system = _System(
            skeleton=skeleton,
            columns=columns,
            joints=joints,
            moves=places[np.ix_(joints, columns)].T,
            owners=np.array([skeleton.channels[c].joint for c in columns]),
            is_rotation=np.array([skeleton.channels[c].is_rotation for c in columns]),
            start=start[rows],
            free=free[cells],
            wanted=wanted[np.ix_(rows, joints)].astype(float),
            fixed=fixed[np.ix_(rows, joints)].astype(float),
            targets=np.where(counted[:, joints, None], targets[np.ix_(rows, joints)], 0.0),
            start_weights=np.where(free[cells], start_weights[cells], 1.0),
        )
        values = start[cells]
        for stage in CONSTRAINTS_FIRST if constraints_first else TOGETHER:
            values = _descend(system, values, stage)
        fitted[cells] = values
    return fitted


def _batches(free: Bools, n_joints: int) -> Iterator[Ints]:
    """Yield frames to be solved together: frames with the same free channels adjoin, as many as memory allows."""
    _, pattern = np.unique(free, axis=0, return_inverse=True)
    order = np.argsort(pattern.reshape(-1), kind="stable")
    for first in range(0, len(order), BATCH_FRAMES):
        rows = order[first : first + BATCH_FRAMES]
        n_free = int(free[rows].any(axis=0).sum())
        size = max(1, int(BATCH_NUMBERS / (max(n_free, 1) ** 2 + NUMBERS_PER_JOINT * n_joints)))
        yield from (rows[i : i + size] for i in range(0, len(rows), size))


@dataclass(frozen=True, kw_only=True)
class _System:
    """The least squares of a batch of f frames: n channels (columns) and the K joints that they move.

    columns: (n,) channels. joints: (K,). moves: (n, K) bool, whether a channel moves a joint. owners: (n,) the joints
    of the channels. is_rotation: (n,) bool. start: (f, C) poses. free: (f, n) bool. wanted, fixed: (f, K) 0 or 1.
    targets: (f, K, 3) mm. start_weights: (f, n), 1 for a channel that is not free, which keeps the matrix regular.
    """

    skeleton: Skeleton
    columns: Ints
    joints: Ints
    moves: Bools
    owners: Ints
    is_rotation: Bools
    start: Floats
    free: Bools
    wanted: Floats
    fixed: Floats
    targets: Floats
    start_weights: Floats

    def evaluate(self, rows: Ints, values: Floats, weight: float) -> tuple[Floats, Floats, Motion]:
        """Return cost (f,), residuals p - t (f, K, 3) and forward kinematics of some frames; values: (f, n)."""
        poses = self.start[rows]
        poses[:, self.columns] = values
        motion = move(self.skeleton, poses)
        residuals = motion.positions[:, self.joints] - self.targets[rows]
        squares = np.einsum("fki,fki->fk", residuals, residuals)
        departure = self.start_weights[rows] * (values - self.start[rows][:, self.columns]) ** 2
        return (self.weights(rows, weight) * squares).sum(axis=1) + departure.sum(axis=1), residuals, motion

    def weights(self, rows: Ints, weight: float) -> Floats:
        """Return the weights (f, K) of the joints: 1 if wanted, ``weight`` if fixed, 0 if neither."""
        return np.asarray(self.wanted[rows] + weight * self.fixed[rows])

    def normal_equations(
        self, rows: Ints, values: Floats, residuals: Floats, motion: Motion, weight: float
    ) -> tuple[Floats, Floats]:
        """Return the gradient g (f, n), halved, and the Gauss-Newton matrix JᵀWJ + S (f, n, n)."""
        n_rows, n_columns = values.shape
        weights, free = self.weights(rows, weight), self.free[rows]
        # Global axes a_c per degree or millimetre, zero for channels that are not free in a frame.
        unit = np.where(self.is_rotation, np.radians(1.0), 1.0)[:, None]
        axes = motion.axes[:, self.columns] * unit * free[:, :, None]
        # Pivots q_c: a joint turns about the start of its bone.
        after = self.skeleton.after[self.owners]
        pivots = motion.positions[:, self.owners] - np.einsum("fnij,nj->fni", motion.rotations[:, self.owners], after)
        gradient = self.start_weights[rows] * (values - self.start[rows][:, self.columns])
        matrix = np.zeros((n_rows, n_columns, n_columns))
        for index, joint in enumerate(self.joints):
            # Jacobian of one joint over the channels above it: a_c × (p_k - q_c), or a_c.
            above = np.flatnonzero(self.moves[:, index])
            jacobian = axes[:, above]
            turns = np.flatnonzero(self.is_rotation[above])
            arms = motion.positions[:, None, joint] - pivots[:, above[turns]]
            jacobian[:, turns] = _cross(jacobian[:, turns], arms)
            weighted = jacobian * weights[:, index, None, None]
            gradient[:, above] += (weighted @ residuals[:, index, :, None])[:, :, 0]
            matrix[:, above[:, None], above] += weighted @ np.swapaxes(jacobian, 1, 2)
        diagonal = np.arange(n_columns)
        matrix[:, diagonal, diagonal] += self.start_weights[rows]
        return gradient, matrix


def _cross(a: Floats, b: Floats) -> Floats:
    """Return the cross products of vectors (..., 3); ``np.cross`` takes twice as long on short ones."""
    product = np.empty_like(a)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        product[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return product


def _descend(system: _System, values: Floats, stage: Stage) -> Floats:
    """Return values (f, n) after damped Gauss-Newton steps, frame by frame until they gain little."""
    best = values.copy()
    rows = np.arange(len(best))
    diagonal = np.arange(best.shape[1])
    cost, residuals, motion = system.evaluate(rows, best, stage.accept)
    gradient, matrix = system.normal_equations(rows, best, residuals, motion, stage.step)
    damping = np.full(len(rows), FIRST_DAMPING)
    for _ in range(MOST_STEPS):
        # (JᵀWJ + S + λI) δ = -g, shortened to the longest step.
        damped = matrix.copy()
        damped[:, diagonal, diagonal] += damping[:, None]
        step = -np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        longest = np.abs(step).max(axis=1)
        trial = best[rows] + step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, LONGEST_STEP))[:, None]
        # Accept a step that lowers the cost; else try a shorter one with more damping.
        trial_cost, residuals, motion = system.evaluate(rows, trial, stage.accept)
        better = trial_cost < cost
        best[rows[better]] = trial[better]
        gains = cost - trial_cost > LEAST_GAIN_SHARE * cost + LEAST_GAIN
        damping = np.where(better, damping / DAMPING_FACTOR, damping * DAMPING_FACTOR)
        going = np.where(better, gains, damping < MOST_DAMPING)
        if not going.any():
            break
        # Linearise again where the pose changed, and drop the frames that are done.
        cost = np.where(better, trial_cost, cost)
        renew = better & going
        if renew.any():
            part = Motion(positions=motion.positions[renew], rotations=motion.rotations[renew], axes=motion.axes[renew])
            gradient[renew], matrix[renew] = system.normal_equations(
                rows[renew], trial[renew], residuals[renew], part, stage.step
            )
        rows, cost, damping = rows[going], cost[going], damping[going]
        gradient, matrix = gradient[going], matrix[going]
    return best
