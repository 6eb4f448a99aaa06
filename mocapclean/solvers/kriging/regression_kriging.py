"""Regression kriging of gaps: ridge regression on features, plus its residual carried over time from both sides.

    y_t = μ + aᵗW + g(t) + ε      W a ridge estimate, g a Matérn process in time

The error of every ridge penalty λ and Matérn kernel is measured on windows. A window is a stretch as long as the gap in
which y is known. Each window is held out of the regression in one fold, and bridged from its own adjacent samples as
the gap is. All pairs (kernel, λ) contribute to the prediction, with the weights of a Gaussian likelihood: this is
steadier than the best pair alone.

N. Cressie, 1993, doi:10.1002/9781119115151 (kriging with a regression for its mean).
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.bridging import KERNELS
from mocapclean.solvers.kriging.ridge import penalty_units, ridge_weights
from mocapclean.solvers.kriging.sampling_plan import N_FOLDS
from mocapclean.solvers.kriging.segment_batch import SegmentBatch

PENALTIES = np.logspace(-6, 0, 6)
"""Ridge penalties λ in the unit of ``ridge.penalty_units``.

Eight penalties from 1e-7 were reduced to these for speed; no sweep was kept.
"""
EFFECTIVE_SAMPLES = 48.0  # n of the likelihood, the independent errors; 24 while there were more penalties; by hand
MIN_WEIGHT = 0.02  # of the best pair's weight; pairs below are dropped, which saves ridge solutions; chosen by hand
MAX_EXCURSION = 2.0  # times the largest known distance from the mean; by hand, after a prediction that was 200 m off
MIN_LENGTH = 1e-300  # mm, keeps a division by the length of a vector finite


@dataclass(frozen=True)
class KrigingResult:
    """The predictions of gap segments by regression kriging, and their errors in the windows.

    positions: (..., L, 3) in the gap, mm, in the coordinates of the target.
    window_errors: (..., w, m, 3) mm, truth less prediction; w is 0 without windows.
    gap_variance, window_variance: (..., L) and (..., m) variance of the bridge, as a share of that of the process.
    Leading axes, if there are any, are the segments of a batch.
    """

    positions: Floats
    window_errors: Floats
    gap_variance: Floats
    window_variance: Floats


def krige(
    features: Floats, target: Floats, batch: SegmentBatch, n_features: Floats | float, error_floor: float
) -> KrigingResult:
    """Return the predictions (G) of targets in their gaps, from features (G, N, p) and targets (G, N, 3).

    The targets in the gaps are not read. n_features: (G,), or one number, the features that are in use. error_floor:
    mm², the mean square below which errors count as equal.
    """
    # y_t - μ and a_t - their mean over the training rows
    level = batch.training_mean(target)
    features, target = features - batch.training_mean(features), target - level
    learnt, values = features[:, batch.training], target[:, batch.training]
    if batch.n_training.min() < learnt.shape[1]:
        in_use = batch.training_share.swapaxes(1, 2) > 0.0
        learnt, values = learnt * in_use, values * in_use
    gram, cross = learnt.swapaxes(1, 2) @ learnt, learnt.swapaxes(1, 2) @ values
    penalties = PENALTIES * penalty_units(gram, n_features)[:, None]
    if batch.n_windows.any():
        of_folds = _weights_of_folds(learnt, values, gram, cross, penalties, batch)
        residuals = batch.in_windows(_fold_residuals(features, target, of_folds, batch))
        errors = _bridging_errors(residuals, batch)
        squares = np.einsum("gwkmlc,gwkmlc->gwkl", errors, errors) / (3 * batch.n_inside)
        weights = likelihood_weights(squares, batch.window_share, error_floor)
        window_errors = np.einsum("gkl,gwkmlc->gwmc", weights, errors)
    else:
        weights = np.full((len(gram), len(KERNELS), len(PENALTIES)), 1.0 / (len(KERNELS) * len(PENALTIES)))
        window_errors = np.zeros((len(gram), 0, batch.n_inside, 3))
    # Σ over kernels and penalties of weight · (aᵗW + bridge weights · (y - aᵗW) at the adjacent samples)
    kernel_weights, n_rows = weights.sum(axis=2), features.shape[2]
    of_all = _weights_in_use(gram, cross, penalties, weights)
    regression = (weights @ of_all.reshape(len(gram), len(PENALTIES), -1)).reshape(len(gram), len(KERNELS), n_rows, 3)
    residual = kernel_weights[..., None, None] * target[:, None, batch.adjacent]
    residual = residual - features[:, None, batch.adjacent] @ regression
    offsets = features[:, batch.gap] @ regression.sum(axis=1) + (batch.gap_bridges @ residual).sum(axis=1)
    return KrigingResult(
        positions=level + _limited(offsets, target, batch),
        window_errors=window_errors,
        gap_variance=np.einsum("gk,gkl->gl", kernel_weights, batch.gap_variance),
        window_variance=np.einsum("gk,gkm->gm", kernel_weights, batch.window_variance),
    )


def _weights_of_folds(
    learnt: Floats, values: Floats, gram: Floats, cross: Floats, penalties: Floats, batch: SegmentBatch
) -> Floats:
    """Return the ridge weights (G, folds, λ, p, 3) that are learnt without the rows that each fold leaves out."""
    # Taking the rows that are held out off the sums is cheaper than summing over the others. Rows beyond them are zero.
    held_out, held_out_values = (_rows_or_zeros(of_rows, batch.held_out) for of_rows in (learnt, values))
    grams = gram[:, None] - held_out.swapaxes(2, 3) @ held_out
    crosses = cross[:, None] - held_out.swapaxes(2, 3) @ held_out_values
    shape = len(learnt) * N_FOLDS, learnt.shape[2]
    weights = ridge_weights(
        grams.reshape(*shape, -1), crosses.reshape(*shape, 3), np.repeat(penalties, N_FOLDS, axis=0)
    )
    return weights.reshape(len(learnt), N_FOLDS, *weights.shape[1:])


def _rows_or_zeros(values: Floats, rows: Ints) -> Floats:
    """Return rows (G, folds, H) of values (G, T, p); zeros for row T."""
    n_rows = values.shape[1]
    taken: Floats = values[np.arange(len(values))[:, None, None], np.minimum(rows, n_rows - 1)]
    taken[rows == n_rows] = 0.0
    return taken


def _fold_residuals(features: Floats, target: Floats, weights: Floats, batch: SegmentBatch) -> Floats:
    """Return the residuals (G, folds, R, λ · 3) in the windows of each fold of the regressions learnt without them."""
    n_features = features.shape[2]
    # One product for all penalties: the penalties and coordinates stand side by side in its columns.
    columns = weights.swapaxes(2, 3).reshape(len(features), N_FOLDS, n_features, -1)
    residuals = batch.by_fold(features) @ columns
    return np.subtract(np.tile(batch.by_fold(target), len(PENALTIES)), residuals, out=residuals)


def _bridging_errors(residuals: Floats, batch: SegmentBatch) -> Floats:
    """Return the errors (G, W, kernels, m, λ, 3) inside windows after residuals (G, W, m + s, λ · 3) are bridged."""
    n_segments, n_windows, _, n_columns = residuals.shape
    inside, adjacent = residuals[:, :, : batch.n_inside], residuals[:, :, batch.n_inside :]
    bridges = batch.window_bridges.reshape(n_segments, n_windows, len(KERNELS) * batch.n_inside, adjacent.shape[2])
    bridged = (bridges @ adjacent).reshape(n_segments, n_windows, len(KERNELS), batch.n_inside, n_columns)
    errors = np.subtract(inside[:, :, None], bridged, out=bridged)
    return errors.reshape(*errors.shape[:4], len(PENALTIES), 3)


def _weights_in_use(gram: Floats, cross: Floats, penalties: Floats, weights: Floats) -> Floats:
    """Return the ridge weights (G, λ, p, 3) learnt from all rows, of those penalties that have a weight; else 0."""
    solved = np.zeros((*penalties.shape, *cross.shape[1:]))
    segment, penalty = np.nonzero(weights.any(axis=1))
    chosen = penalties[segment, penalty][:, None]
    solved[segment, penalty] = ridge_weights(gram[segment], cross[segment], chosen)[:, 0]
    return solved


def likelihood_weights(squares: Floats, window_share: Floats, error_floor: float) -> Floats:
    """Return the weights (..., kernels, λ) of sum 1: exp(-n/2 · mean over windows of log(mean square error + floor)).

    squares: (..., w, kernels, λ) mean square errors in each window, mm². window_share: (..., w), the share of each
    window in the mean. error_floor: mm².
    """
    loss = (window_share[..., None, None] * np.log(squares + error_floor)).sum(axis=-3)
    weights = np.exp(-0.5 * EFFECTIVE_SAMPLES * (loss - loss.min(axis=(-2, -1), keepdims=True)))
    weights[weights < MIN_WEIGHT] = 0.0
    return np.asarray(weights / weights.sum(axis=(-2, -1), keepdims=True), dtype=np.float64)


def _limited(offsets: Floats, target: Floats, batch: SegmentBatch) -> Floats:
    """Return offsets (G, L, 3), shortened where they exceed ``MAX_EXCURSION`` times the longest known offset.

    target: (G, N, 3) offsets in the training and adjacent rows, where they are known.
    """
    known = np.concatenate([target[:, batch.training], target[:, batch.adjacent]], axis=1)
    longest = np.linalg.norm(known, axis=2).max(axis=1)[:, None, None]
    length = np.linalg.norm(offsets, axis=2, keepdims=True)
    return np.asarray(offsets * np.minimum(1.0, MAX_EXCURSION * longest / np.maximum(length, MIN_LENGTH)))
