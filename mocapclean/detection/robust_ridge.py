"""Robust ridge regressions of several markers at once: samples with large residuals get small weights.

Shapes: b markers, T rows (frames that a marker is learnt from), n inputs, 3 target coordinates.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.numerics.robust import nan_median

# Chosen by hand on the takes of `bench trust`, seeds 0 to 4 (docs/results.md), where no other reason is given; no sweep
# was kept.
NOISE_FLOOR = 0.5  # mm, least noise that a marker is taken to have
_N_FITS = 3  # fits, each with the weights from the one before
_SCALE_FACTOR = 3.0  # times the median residual at which the weight of a row falls to a quarter
_PENALTIES = np.logspace(-6, 1, 15)  # shares of the largest eigenvalue of the inputs that a ridge penalty may have
_LEAST_EIGENVALUE = 1e-100  # its square is still a number: keeps inputs that never change from a penalty of 0
_ROWS_PER_SAMPLE = 10.0  # rows that count as one independent sample, for neighbouring frames are nearly the same
_FEWEST_SAMPLES = 5.0  # independent samples, at least
_MOST_FREEDOM = 0.95  # share of the independent samples that the degrees of freedom may reach
_LEAST_SLACK = 0.05  # least share of the samples that counts as free in the score


@dataclass(frozen=True)
class Rows:
    """The frames (b, T) that b markers are learnt from, in order, and their weights (b, T).

    A marker with fewer than T frames repeats its last one with weight 0; all other weights are 1.
    """

    frames: Ints
    weights: Floats

    @classmethod
    def of(cls, frames: list[Ints]) -> "Rows":
        """Return the rows for the frames of each marker."""
        most = max(map(len, frames))
        padded = np.stack([np.pad(each, (0, most - len(each)), mode="edge") for each in frames])
        return cls(padded, np.stack([np.arange(most) < len(each) for each in frames]).astype(float))

    @property
    def number(self) -> Ints:
        """Return the number of training frames (b,) of each marker, without padding."""
        return np.asarray(self.weights.sum(axis=1).astype(np.intp))

    def take(self, values: Floats) -> Floats:
        """Return the values (b, T, n) in the training frames, selected from values (b, F, n) in all frames."""
        return np.take_along_axis(values, self.frames[..., None], axis=1)

    def robust_weights(self, residual: Floats) -> Floats:
        """Return weights (b, T) for residuals (b, T, 3): 1 / (1 + (r / (3s + 0.5 mm))²)², s the median distance r.

        S. Geman, D. E. McClure, 1985, Bayesian image analysis: an application to single photon emission tomography.
        """
        size = np.sqrt(np.einsum("btc,btc->bt", residual, residual))
        median = nan_median(np.where(self.weights > 0, size, np.nan), axis=1)[:, None]
        return np.asarray(self.weights / (1.0 + (size / (_SCALE_FACTOR * median + NOISE_FLOOR)) ** 2) ** 2)


@dataclass(frozen=True)
class RidgeFit:
    """Slopes (b, n, 3), and the weighted means of the inputs (b, 1, n) and of the targets (b, 1, 3)."""

    slopes: Floats
    input_mean: Floats
    target_mean: Floats

    def predict(self, inputs: Floats) -> Floats:
        """Return the predictions (b, T, 3) for inputs (b, T, n)."""
        return np.asarray(inputs @ self.slopes + (self.target_mean - self.input_mean @ self.slopes))


def regress(inputs: Floats, targets: Floats, rows: Rows) -> RidgeFit:
    """Return robust ridge regressions of targets (b, T, 3) on inputs (b, T, n), by iteratively reweighted fits."""
    n, weights = inputs.shape[2], rows.weights
    columns = np.concatenate([inputs, targets], axis=2)
    for _ in range(_N_FITS):
        means, centred = centre(columns, weights)
        # XᵀWX, XᵀWY and the trace of YᵀWY in one product.
        products = (weights[..., None] * centred).swapaxes(1, 2) @ centred
        gram, moment = products[:, :n, :n], products[:, :n, n:]
        penalties = gcv_penalties(gram, moment, np.trace(products[:, n:, n:], axis1=1, axis2=2), rows)
        fit = RidgeFit(ridge_slopes(gram, moment, penalties), means[:, :, :n], means[:, :, n:])
        weights = rows.robust_weights(targets - fit.predict(inputs))
    return fit


def centre(columns: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return the means (b, 1, m) of columns (b, T, m), weighted by (b, T), and the columns less their means."""
    means = (weights / weights.sum(axis=1, keepdims=True))[:, None] @ columns
    return means, columns - means


def gcv_penalties(gram: Floats, moment: Floats, energy: Floats, rows: Rows) -> Floats:
    """Return the ridge penalties (b,) with the least score of generalised cross-validation.

    G. H. Golub, M. Heath, G. Wahba, 1979, doi:10.1080/00401706.1979.10489751: RSS(λ) / (1 - df(λ) / N)². N is a tenth
    of the rows. gram: XᵀWX (b, n, n). moment: XᵀWY (b, n, 3). energy: trace of YᵀWY (b,).
    """
    values, vectors = np.linalg.eigh(gram)
    values = np.maximum(values, 0.0)[:, None]
    penalties = _PENALTIES * np.maximum(values[:, :, -1], _LEAST_EIGENVALUE)
    shrunk = values + penalties[..., None]
    # df(λ) = Σ d / (d + λ) over the eigenvalues d.
    freedom = (values / shrunk).sum(axis=2)
    # RSS(λ) = energy - Σ ‖vᵀXᵀWY‖² (d + 2λ) / (d + λ)².
    projected = ((vectors.swapaxes(1, 2) @ moment) ** 2).sum(axis=2)[:, None]
    explained = (projected * (shrunk + penalties[..., None]) / shrunk**2).sum(axis=2)
    samples = np.maximum(rows.number / _ROWS_PER_SAMPLE, _FEWEST_SAMPLES)[:, None]
    score = (energy[:, None] - explained) / np.maximum(1 - freedom / samples, _LEAST_SLACK) ** 2
    best = np.argmin(np.where(freedom < _MOST_FREEDOM * samples, score, np.inf), axis=1)
    return np.asarray(penalties[np.arange(len(best)), best])


def ridge_slopes(gram: Floats, moment: Floats, penalties: Floats) -> Floats:
    """Return the slopes (b, n, k) of ridge regressions, (XᵀWX + λI)⁻¹ XᵀWY, for moments (b, n, k)."""
    return np.asarray(np.linalg.solve(gram + penalties[:, None, None] * np.eye(gram.shape[1]), moment))
