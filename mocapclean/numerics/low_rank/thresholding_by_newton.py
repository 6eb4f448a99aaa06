"""Singular value thresholding with bounds on distances, to many digits: multipliers and semismooth Newton steps.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the known entries,  ‖C_i z‖ ≤ d_i for every i

The problem of ``thresholding_by_splitting``, whose iteration needs thousands of steps where thousands of bounds are
nearly active. Here X is a copy of Z for the norms, with multipliers Y and a penalty ρ; the bounds have multipliers p_i
and a penalty σ. Over the unknown entries of Z alone

    L(Z) = min_X τ‖X‖_* + ½‖X‖² + ⟨Y, Z − X⟩ + ½ρ‖Z − X‖² + ½σ Σ dist(C_i z + p_i / σ, ball of radius d_i)²

is minimised, then Y += ρ (Z − X), p_i = σ (C_i z + p_i / σ less its projection on the ball), and both penalties grow.
L is convex and once differentiable. Its gradient Y + ρ (Z − X) + Σ C_iᵀ p_i has a generalised derivative, of the
singular value thresholding and of the projections, so that Newton's method converges faster than linearly. Its steps
come from conjugate gradients. They are preconditioned by the blocks of the frames: the weights that iterative
reweighting would give to a frame, and all of its bounds.

Semismooth Newton and multipliers: L. Qi, J. Sun, 1993, doi:10.1007/BF01581275; R. T. Rockafellar, 1976,
doi:10.1287/moor.1.2.97; for the nuclear norm K. Jiang, D. Sun, K.-C. Toh, 2014, doi:10.1007/s12532-013-0069-5.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.determined_samples import with_determined
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds
from mocapclean.numerics.low_rank.shrinkage import singular_values
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import Iterate

# Chosen by hand on 13_17, 49_02 and 10_01 with three joints out for half a second.
_FIRST_PENALTY = 100.0  # ρ and σ at first, in units of τ / ‖B‖₂
_GROWTH, _BOUND_GROWTH = 2.0, 3.0  # of ρ and of σ from one update of the multipliers to the next
_MOST_GROWTH = 2.0**40  # of σ; beyond it rounding errors of C_i z outweigh what it gains
_MOST_UPDATES = 60  # of the multipliers
# Bounds contradict each other where a multiplier exceeds ten times what the norm can pull, and over five updates, in
# which σ grew 81-fold, the least excess is more than 0.9 of the largest. Chosen by hand on the same takes and on Jump2.
_STALLED, _STALLED_UPDATES, _STRONGEST_PULL = 0.9, 5, 10.0
_NEWTON_STEPS = 30  # most between two updates
_INNER_SHARE = 0.1  # the gradient at an update, as a share of what the update changes
_LEAST_GRADIENT = 1e-8  # the gradient at an update in units of τ √n, below which it is rounding
_GRADIENT_STEPS = 200  # most of conjugate gradients for one Newton step
_RESIDUALS = (1e-6, 0.1)  # least and largest relative residual of a Newton step; the root of the gradient between them
_DECREASE = 1e-4  # share of the slope that a step must gain (Armijo)
_LEAST_STEP = 1e-8  # of a Newton step, below which it is given up
_UNKNOWN_TOLERANCE = 0.1  # tolerance over the unknown entries relative to that over the known ones, as in the splitting
_TINY = np.finfo(np.float64).tiny


@dataclass(kw_only=True)
class _Multipliers:
    """Y (F, n) and p (N, 3), and the penalties ρ and σ."""

    matrix: Floats
    vectors: Floats
    penalty: float
    bound_penalty: float


class _Problem:
    """The constraints in terms of the unknown samples z (U, 3), and the threshold τ."""

    def __init__(self, values: Floats, known: Bools, bounds: DistanceBounds, threshold: float) -> None:
        self.values, self.bounds, self.threshold = values, bounds, threshold
        self.free = np.flatnonzero(~known[:, ::3].ravel())
        self.columns = bounds.columns(self.free)
        self.adjoint = self.columns.T.tocsr()
        self.fixed = bounds.differences(values)
        # C for the coordinates of all samples, and the pairs of unknown samples of one frame
        self.coordinates = scipy.sparse.kron(self.columns, scipy.sparse.eye_array(3), format="csr")
        samples, frames = np.arange(len(self.free)), self.free // (values.shape[1] // 3)
        incidence = scipy.sparse.csr_array((np.ones(len(frames)), (samples, frames)), shape=(len(frames), len(values)))
        pairs = (incidence @ incidence.T).tocoo()
        self.pairs = pairs.row, pairs.col

    def matrix(self, free: Floats) -> Floats:
        """Return Z (F, n) for unknown samples (U, 3)."""
        matrix = self.values.copy()
        matrix.reshape(-1, 3)[self.free] = free
        return matrix

    def of_free(self, matrix: Floats) -> Floats:
        """Return the unknown samples (U, 3) of a matrix (F, n)."""
        samples: Floats = matrix.reshape(-1, 3)[self.free]
        return samples


class _Point:
    """L at unknown samples z (U, 3): its value, its gradient (U, 3), X, the updated multipliers, and a Newton step."""

    def __init__(self, problem: _Problem, free: Floats, at: _Multipliers) -> None:
        self.problem, self.free, self.at = problem, free, at
        rho, sigma = at.penalty, at.bound_penalty
        # X = 𝒟_{τ/(1+ρ)}((ρZ + Y) / (1 + ρ)): the Gram matrix would not resolve values near a small threshold
        self.z = problem.matrix(free)
        limit = problem.threshold / (1.0 + rho)
        self._left, self._sizes, self._rows = np.linalg.svd(
            (rho * self.z + at.matrix) / (1.0 + rho), full_matrices=False
        )
        self._shrunk = np.maximum(self._sizes - limit, 0.0)
        self.x = (self._left * self._shrunk) @ self._rows
        gap = self.z - self.x
        self.matrix = at.matrix + rho * gap
        # C_i z + p_i / σ less its projection on the ball
        arms = problem.fixed + problem.columns @ free
        self.excess = problem.bounds.excess(arms)
        arms += at.vectors / sigma
        norms = np.sqrt(np.einsum("nc,nc->n", arms, arms))
        over = np.maximum(norms - problem.bounds.lengths, 0.0)
        self._directions = arms / np.maximum(norms, _TINY)[:, None]
        self._outside, self._shares = over > 0.0, over / np.maximum(norms, _TINY)
        self.vectors = sigma * over[:, None] * self._directions
        self.gradient = problem.of_free(self.matrix) + problem.adjoint @ self.vectors
        self.size = float(np.linalg.norm(self.gradient))
        self.gap = float(np.linalg.norm(gap))
        norms_of_x = problem.threshold * self._shrunk.sum() + 0.5 * np.vdot(self._shrunk, self._shrunk)
        penalties = rho * self.gap**2 + sigma * np.vdot(over, over)
        self.value = float(norms_of_x + np.vdot(at.matrix, gap) + 0.5 * penalties)

    def is_stationary(self, scale: float) -> bool:
        """Whether the gradient is small enough to update the multipliers, or rounding. scale: τ √n."""
        return self.size <= max(_LEAST_GRADIENT * scale, _INNER_SHARE * self.at.penalty * self.gap)

    def step(self, tolerance: float) -> Floats:
        """Return the Newton step (U, 3) to a relative residual, by preconditioned conjugate gradients."""
        self._prepare()
        residual = -self.gradient
        step: Floats = np.zeros_like(residual)
        scaled = self._precondition(residual)
        direction, product = scaled, float(np.vdot(residual, scaled))
        enough = tolerance**2 * product
        for _ in range(_GRADIENT_STEPS):
            image = self._derivative(direction)
            length = product / float(np.vdot(direction, image))
            step += length * direction
            residual = residual - length * image
            scaled = self._precondition(residual)
            product, before = float(np.vdot(residual, scaled)), product
            if product <= enough:
                break
            direction = scaled + (product / before) * direction
        return step

    def _prepare(self) -> None:
        """Set the derivative of the thresholding and of the projections, and factor the blocks of the frames."""
        problem, rho, sigma = self.problem, self.at.penalty, self.at.bound_penalty
        # Divided differences of f(s) = max(s − τ', 0): (f_i − f_j) / (s_i − s_j), (f_i + f_j) / (s_i + s_j), f_i / s_i
        sizes, shrunk, slope = self._sizes, self._shrunk, (self._shrunk > 0.0).astype(float)
        apart, mean_slope = sizes[:, None] - sizes, 0.5 * (slope[:, None] + slope)
        near = np.abs(apart) <= 1e-10 * sizes[0]
        self._symmetric = np.where(near, mean_slope, (shrunk[:, None] - shrunk) / np.where(near, 1.0, apart))
        self._skew = (shrunk[:, None] + shrunk) / np.maximum(sizes[:, None] + sizes, _TINY)
        self._ratios = shrunk / np.maximum(sizes, _TINY)
        self._projector = (self._rows.T * self._ratios) @ self._rows
        # The derivative of a projection's remainder: n nᵀ + (1 − d / ‖x‖)(I − n nᵀ) outside of the ball
        shares, across = self._shares, self._outside - self._shares
        normals = across[:, None, None] * self._directions[:, :, None] * self._directions[:, None]
        self._remainders = sigma * (shares[:, None, None] * np.eye(3) + normals)
        # Blocks: ρ (I − ρ / (1 + ρ) V diag(f / s) Vᵀ) among the unknown entries of a frame, and its bounds
        weights = rho * (np.eye(len(self._projector)) - rho / (1.0 + rho) * self._projector)
        n_columns = len(weights) // 3
        weights = weights.reshape(n_columns, 3, n_columns, 3).swapaxes(1, 2)
        (rows, columns), n_free = problem.pairs, len(problem.free)
        blocks = weights[problem.free[rows] % n_columns, problem.free[columns] % n_columns]
        one, other = np.indices((3, 3))
        places = (3 * rows[:, None, None] + one).ravel(), (3 * columns[:, None, None] + other).ravel()
        system = scipy.sparse.coo_array((blocks.ravel(), places), shape=(3 * n_free, 3 * n_free)).tocsc()
        if len(self._remainders):
            each = np.arange(len(self._remainders))
            of_bounds = scipy.sparse.bsr_array((self._remainders, each, np.append(each, len(each))))
            system = system + problem.coordinates.T @ (of_bounds @ problem.coordinates)
        self._factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(system))

    def _precondition(self, residual: Floats) -> Floats:
        solution: Floats = self._factor.solve(residual.ravel()).reshape(-1, 3)
        return solution

    def _derivative(self, step: Floats) -> Floats:
        """Return the generalised derivative of the gradient along a step (U, 3)."""
        problem, rho = self.problem, self.at.penalty
        moved = np.zeros_like(problem.values)
        moved.reshape(-1, 3)[problem.free] = step
        inner = (self._left.T @ moved) @ self._rows.T
        # U (A ∘ sym + B ∘ skew) Vᵀ, and f / s on what lies outside of the spans of U and of V
        middle = 0.5 * (self._symmetric * (inner + inner.T) + self._skew * (inner - inner.T)) - inner * self._ratios
        thresholded = moved @ self._projector
        if len(moved) < moved.shape[1]:
            middle -= self._ratios[:, None] * inner
            thresholded += (self._left * self._ratios) @ (self._left.T @ moved)
        thresholded += self._left @ (middle @ self._rows)
        of_bounds = np.einsum("nij,nj->ni", self._remainders, problem.columns @ step)
        image: Floats = rho * (step - rho / (1.0 + rho) * problem.of_free(thresholded)) + problem.adjoint @ of_bounds
        return image


def threshold_by_newton(
    values: Floats,
    known: Bools,
    bounds: DistanceBounds,
    *,
    threshold: float,
    tolerance: float,
    excess_tolerance: float,
    max_iterations: int,
) -> Iterate:
    """Iterate until X and Z agree and no bound is exceeded by more than its tolerance; return the last iterate, X.

    values: (F, n), B where known and 0 elsewhere. threshold: τ. tolerance: root mean square of Z − X over the known
    entries; a tenth of it over the unknown ones, and the largest excess of a bound. An iteration is one Newton step;
    the trace has the residual after each update of the multipliers.
    """
    placed, fixed = with_determined(values, known, bounds)
    problem = _Problem(placed, fixed, bounds, threshold)
    norm = float(singular_values(values).max(initial=0.0)) or 1.0
    first = _FIRST_PENALTY * threshold / norm
    at = _Multipliers(
        matrix=np.zeros_like(values), vectors=np.zeros((len(bounds.lengths), 3)), penalty=first, bound_penalty=first
    )
    point = _Point(problem, problem.of_free(placed), at)
    scale = threshold * min(values.shape) ** 0.5
    n_known, steps = max(int(known.sum()), 1), 0
    now, excesses = Iterate(matrix=point.x), list[float]()
    for _ in range(_MOST_UPDATES):
        point, taken = _minimised(point, scale, max_iterations - steps)
        steps += taken
        gap = np.square(point.z - point.x)
        now.matrix, of_known = point.x, float(gap[known].sum())
        now.residual = (of_known / n_known) ** 0.5
        now.excess = bounds.excess(bounds.differences(now.matrix))
        now.trace.append(now.residual)
        of_unknown = (float(gap[~known].sum()) / max(known.size - n_known, 1)) ** 0.5
        agrees = now.residual <= tolerance and of_unknown <= _UNKNOWN_TOLERANCE * tolerance
        within = max(now.excess, point.excess) <= min(excess_tolerance, tolerance)
        now.converged = agrees and within and point.is_stationary(scale)
        excesses.append(point.excess)
        recent = excesses[-_STALLED_UPDATES:]
        stalled = len(recent) == _STALLED_UPDATES and min(recent) > _STALLED * max(recent)
        pull = float(np.linalg.norm(point.vectors, axis=1).max(initial=0.0))
        now.contradictory = not within and stalled and pull > _STRONGEST_PULL * threshold
        if now.converged or now.contradictory or steps >= max_iterations:
            break
        grown = at.penalty if agrees else _GROWTH * at.penalty
        bound_grown = at.bound_penalty if within else min(_BOUND_GROWTH * at.bound_penalty, _MOST_GROWTH * first)
        at = _Multipliers(matrix=point.matrix, vectors=point.vectors, penalty=grown, bound_penalty=bound_grown)
        point = _Point(problem, point.free, at)
    return now


def _minimised(point: _Point, scale: float, most: int) -> tuple[_Point, int]:
    """Return the point that Newton's method leads to, and the number of its steps."""
    if not len(point.free):
        return point, 0
    for k in range(min(_NEWTON_STEPS, most)):
        if point.is_stationary(scale):
            return point, k
        step = point.step(float(np.clip((point.size / scale) ** 0.5, *_RESIDUALS)))
        slope, length = float(np.vdot(step, point.gradient)), 1.0
        nearer = _Point(point.problem, point.free + step, point.at)
        # Halve the step until the value falls, or, where that is lost in rounding, the gradient
        while nearer.value > point.value + _DECREASE * length * slope and nearer.size > 0.9 * point.size:
            length *= 0.5
            if length < _LEAST_STEP:
                return point, k
            nearer = _Point(point.problem, point.free + length * step, point.at)
        point = nearer
    return point, min(_NEWTON_STEPS, most)
