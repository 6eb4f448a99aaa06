"""Stacking: the weighted mean of predictions, with weights of at least 0 that minimise the error in windows, and its
SD.

L. Breiman, 1996, Stacked regressions, doi:10.1007/BF00117832.
"""

from typing import TYPE_CHECKING

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.solvers.kriging.regression_kriging import KrigingResult
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan

if TYPE_CHECKING:
    from mocapclean.solvers.kriging import Params

JITTER = 1e-9  # of the mean moment, added to the diagonal: equal predictors then have one solution; by hand
EQUAL_GRADIENT = 1e-9  # of the mean moment, excess of a gradient that is a rounding error; chosen by hand
DISAGREEMENT_POWER = 0.5  # by which the variance grows with the ratio of disagreements; chosen by hand
MOST_STEPS = 10  # times the number of predictors, steps of the active-set method; it needs about one; by hand
UNTESTED_FACTOR = 4.0  # times the predictors' disagreement, the variance without windows; chosen by hand


def stacking_weights(errors: Floats, shrinkage: float) -> Floats:
    """Return the weights w (p,), w >= 0 and Σ w = 1, that minimise the mean square of the weighted errors (p, n).

    shrinkage: share taken off the covariances of the errors, which a few windows estimate badly.
    """
    n = len(errors)
    moments = errors @ errors.T
    total = float(np.trace(moments))
    if n == 1 or total <= 0.0:
        return np.full(n, 1.0 / n)
    # Shrink the off-diagonal moments, and scale the mean of the diagonal to 1.
    moments *= (1.0 - shrinkage) * n / total
    moments[np.diag_indices(n)] /= 1.0 - shrinkage
    return _least_on_simplex(moments + JITTER * np.eye(n))


def _least_on_simplex(matrix: Floats) -> Floats:
    """Return the w (n,), w >= 0 and Σ w = 1, that minimises wᵀ A w for a positive definite matrix A (n, n).

    The active-set method: J. Nocedal, S. J. Wright, 2006, Numerical optimization, doi:10.1007/978-0-387-40065-5,
    algorithm 16.3. n is at most about ten, so that importing a solver would take longer than all its calls.
    """
    n = len(matrix)
    weights, free = np.full(n, 1.0 / n), np.ones(n, dtype=bool)
    for _ in range(MOST_STEPS * n):
        # The minimiser with the other weights at 0 is proportional to A⁻¹ 1.
        target = np.zeros(n)
        target[free] = np.linalg.solve(matrix[np.ix_(free, free)], np.ones(free.sum()))
        target /= target.sum()
        falling = free & (target < 0.0)
        if falling.any():
            # Go towards it until the first weight is 0, which then stays there.
            steps = np.where(falling, weights / np.where(falling, weights - target, 1.0), np.inf)
            weights = np.maximum(weights + steps.min() * (target - weights), 0.0)
            free[steps.argmin()], weights[steps.argmin()] = False, 0.0
            continue
        weights = target
        # Optimal unless a weight at 0 has a smaller gradient than the others; the one with the least becomes free.
        gradient = matrix @ weights
        excess = np.where(free, 0.0, gradient - weights @ gradient)
        if excess.min() >= -EQUAL_GRADIENT:
            break
        free[excess.argmin()] = True
    return np.asarray(weights, dtype=np.float64)


def window_errors_ratio(results: list[KrigingResult], others: list[KrigingResult], params: "Params") -> float:
    """Return how many times larger the mean square error in windows is with ``results`` than with ``others``, stacked.

    It is the lesser of two ratios, of mean squares and of geometric means over windows. One window with a move decides
    the first, the many others the second. It is 1 where there are no windows.
    """
    if not results[0].window_errors.size:
        return 1.0
    own, other = (_stacked_squares(group, params) + params.noise**2 for group in (results, others))
    return float(min(own.mean() / other.mean(), np.exp(np.log(own / other).mean())))


def _stacked_squares(results: list[KrigingResult], params: "Params") -> Floats:
    """Return the mean square error (w,) of stacked results in each window, mm²."""
    errors = np.stack([result.window_errors for result in results])
    weights = stacking_weights(errors.reshape(len(results), -1), params.shrinkage)
    return np.asarray(np.square(np.tensordot(weights, errors, axes=1)).mean(axis=(1, 2)))


def combine(results: list[KrigingResult], plan: SamplingPlan, noise: float, shrinkage: float) -> tuple[Floats, Floats]:
    """Return the stacked prediction (L, 3) of a gap and its SD (L,) per coordinate, mm.

    noise: mm, least SD. shrinkage: that of ``stacking_weights``. With e the stacked error in windows, v_t the bridge
    variance over the gap and v̄ its mean over a window, D and D₀ the mean square disagreement of the predictors in the
    gap and in windows:

        SD_t² = noise² + mean(e²) · v_t / v̄ · (gap length / window length) · max((D + noise²) / (D₀ + noise²), 1)^½
    """
    positions = np.stack([result.positions for result in results])
    errors = np.stack([result.window_errors for result in results])
    weights = stacking_weights(errors.reshape(len(results), -1), shrinkage)
    stacked = np.tensordot(weights, positions, axes=1)
    gap_disagreement = np.square(positions - stacked).mean(axis=(0, 2))
    floor = noise**2
    if not errors.size:
        # Without windows only the disagreement shows the error.
        return stacked, np.sqrt(floor + UNTESTED_FACTOR * gap_disagreement)
    # D₀, and v_t and v̄ of the stack.
    stacked_error = np.tensordot(weights, errors, axes=1)
    window_disagreement = float(np.square(errors - stacked_error).mean())
    gap_variance = sum(w * result.gap_variance for w, result in zip(weights, results, strict=True))
    window_variance = sum(w * result.window_variance for w, result in zip(weights, results, strict=True))
    process_variance = float(np.square(stacked_error).mean()) / float(window_variance.mean())
    # Windows are shorter than the gap where too few of its length fit; the variance then grows with the length.
    length_ratio = len(plan.gap) / (plan.inside[-1] + 1)
    # The error grows where the predictors disagree more than they do in windows.
    ratio = (float(gap_disagreement.mean()) + floor) / (window_disagreement + floor)
    excess = np.maximum(ratio, 1.0) ** DISAGREEMENT_POWER
    return stacked, np.sqrt(floor + process_variance * gap_variance * length_ratio * excess)
