"""Regression kriging of one gap: ridge regression on features, plus its residual carried over time from both sides.

    y_t = μ + aᵗW + g(t) + ε      W a ridge estimate, g a Matérn process in time

For every ridge penalty λ and every Matérn kernel the error is measured on windows: stretches as long as the gap in
which y is known. Each window is held out of the regression in one fold, and bridged from its own adjacent samples as
the gap is. All pairs (kernel, λ) contribute to the prediction, with the weights of a Gaussian likelihood: this is
steadier than the best pair alone.

N. Cressie, 1993, doi:10.1002/9781119115151 (kriging with a regression for its mean).
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.solvers.kriging.bridging import KERNELS, PlanBridges
from mocapclean.solvers.kriging.ridge import RidgeRegression
from mocapclean.solvers.kriging.sampling_plan import N_FOLDS, SamplingPlan

PENALTIES = np.logspace(-6, 0, 6)
"""Ridge penalties λ in the unit of ``RidgeRegression``.

Eight penalties from 1e-7 were reduced to these for speed; no sweep was kept.
"""
EFFECTIVE_SAMPLES = 48.0  # n of the likelihood, the independent errors; 24 while there were more penalties; by hand
MIN_WEIGHT = 0.02  # of the best pair's weight; pairs below are dropped, which saves ridge solutions; chosen by hand
MAX_EXCURSION = 2.0  # times the largest known distance from the mean; by hand, after a prediction that was 200 m off
MIN_LENGTH = 1e-300  # mm, keeps a division by the length of a vector finite


@dataclass(frozen=True, kw_only=True)
class KrigingResult:
    """The prediction of one gap segment by regression kriging, and its errors in the windows.

    positions: (L, 3) in the gap, mm, in the coordinates of the target.
    window_errors: (w, m, 3) mm, truth less prediction; w is 0 without windows.
    gap_variance, window_variance: (L,) and (m,) variance of the bridge, as a share of that of the process.
    """

    positions: Floats
    window_errors: Floats
    gap_variance: Floats
    window_variance: Floats


def krige(
    features: Floats, target: Floats, plan: SamplingPlan, bridges: PlanBridges, held_out: Bools, error_floor: float
) -> KrigingResult:
    """Return the prediction of a target in the gap, from features (N, p) and target (N, 3) over ``plan.frames``.

    The target in the gap is not read. held_out: (folds, n) training frames left out in each fold. error_floor: mm²,
    the mean square below which errors count as equal.
    """
    training, windows, gap_adjacent, gap = plan.parts
    # y_t - μ and a_t - their mean over the training frames.
    level, middle = target[training].mean(axis=0), features[training].mean(axis=0)
    features = features - middle
    target = target - level
    ridge = RidgeRegression(features[training], target[training])
    n_inside, n_windows = len(plan.inside), len(plan.windows)
    if n_windows:
        shape = n_windows, n_inside + len(plan.adjacent)
        residuals = _cross_validated_residuals(
            features[windows].reshape(*shape, -1), target[windows].reshape(*shape, 3), ridge, held_out, plan
        )
        errors = _bridging_errors(residuals, n_inside, bridges)
        weights = likelihood_weights(errors, error_floor)
        window_errors = np.einsum("gl,glwmc->wmc", weights, errors)
    else:
        weights = np.full((len(KERNELS), len(PENALTIES)), 1.0 / (len(KERNELS) * len(PENALTIES)))
        window_errors = np.zeros((0, n_inside, 3))
    # Σ over kernels and penalties of weight · (aᵗW + bridge weights · (y - aᵗW) at the adjacent samples).
    used, kernel_weights = weights.any(axis=0), weights.sum(axis=1)
    regression = np.tensordot(weights[:, used], ridge.weights(PENALTIES[used]), axes=1)
    residual = kernel_weights[:, None, None] * target[gap_adjacent] - features[gap_adjacent] @ regression
    offsets = features[gap] @ regression.sum(axis=0) + np.matmul(bridges.gap_weights, residual).sum(axis=0)
    return KrigingResult(
        positions=level + _limited(offsets, np.concatenate([target[training], target[gap_adjacent]])),
        window_errors=window_errors,
        gap_variance=kernel_weights @ bridges.gap_variance,
        window_variance=kernel_weights @ bridges.window_variance,
    )


def _cross_validated_residuals(
    features: Floats, target: Floats, ridge: RidgeRegression, held_out: Bools, plan: SamplingPlan
) -> Floats:
    """Return the residuals (λ, w, m + s, 3) in windows of the regressions that were learnt without them."""
    residuals = np.empty((len(PENALTIES), *target.shape))
    for fold in range(min(N_FOLDS, len(plan.windows))):
        in_fold = plan.folds == fold
        fold_features, weights = features[in_fold], ridge.weights(PENALTIES, held_out[fold])
        # One product for all penalties: the penalties and coordinates stand side by side in its columns.
        n_features = fold_features.shape[-1]
        predicted = fold_features.reshape(-1, n_features) @ weights.swapaxes(0, 1).reshape(n_features, -1)
        predicted = predicted.reshape(*fold_features.shape[:-1], len(PENALTIES), 3)
        residuals[:, in_fold] = target[in_fold] - np.moveaxis(predicted, 2, 0)
    return residuals


def _bridging_errors(residuals: Floats, n_inside: int, bridges: PlanBridges) -> Floats:
    """Return the errors (kernels, λ, w, m, 3) inside the windows after their residuals are bridged."""
    n_penalties, n_windows = residuals.shape[:2]
    errors = np.empty((len(KERNELS), n_penalties, n_windows, n_inside, 3))
    for windows, known, weights in bridges.groups:
        if not len(known):
            errors[:, :, windows] = residuals[:, windows, :n_inside]
            continue
        inside, adjacent = residuals[:, windows, :n_inside], residuals[:, windows][:, :, n_inside + known]
        flat = np.moveaxis(adjacent, 2, 0).reshape(len(known), -1)
        bridged = np.matmul(weights, flat).reshape(len(KERNELS), n_inside, n_penalties, len(windows), 3)
        errors[:, :, windows] = inside - bridged.transpose(0, 2, 3, 1, 4)
    return errors


def likelihood_weights(errors: Floats, error_floor: float) -> Floats:
    """Return the weights (kernels, λ) of sum 1: exp(-n/2 · mean over windows of log(mean square error + floor))."""
    squares = np.einsum("glwmc,glwmc->glw", errors, errors) / (errors.shape[3] * errors.shape[4])
    loss = np.log(squares + error_floor).mean(axis=2)
    weights = np.exp(-0.5 * EFFECTIVE_SAMPLES * (loss - loss.min()))
    weights[weights < MIN_WEIGHT] = 0.0
    return np.asarray(weights / weights.sum(), dtype=np.float64)


def _limited(offsets: Floats, known: Floats) -> Floats:
    """Return offsets (L, 3), shortened where they exceed ``MAX_EXCURSION`` times the longest known offset (n, 3)."""
    length, longest = np.linalg.norm(offsets, axis=1, keepdims=True), np.linalg.norm(known, axis=1).max()
    return np.asarray(offsets * np.minimum(1.0, MAX_EXCURSION * longest / np.maximum(length, MIN_LENGTH)))
