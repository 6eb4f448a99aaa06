"""Robust ridge regressions of several markers at once: samples with large residuals get small weights.

Shapes: b markers, T rows (frames that a marker is learnt from), n inputs, 3 target coordinates. Rows are the last axis,
so that the values of one input lie side by side in memory.
"""

from dataclasses import dataclass, replace
from functools import cached_property

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
        number = np.array([len(each) for each in frames])
        padded = np.empty((len(frames), number.max()), dtype=np.intp)
        for row, each in zip(padded, frames, strict=True):
            row[: len(each)], row[len(each) :] = each, each[-1]
        return cls(padded, (np.arange(padded.shape[1]) < number[:, None]).astype(float))

    @cached_property
    def number(self) -> Ints:
        """Return the number of training frames (b,) of each marker, without padding."""
        return np.asarray(self.weights.sum(axis=1).astype(np.intp))

    def are_all(self, n_frames: int) -> bool:
        """Whether every marker is learnt from all frames of a take."""
        return self.frames.shape[1] == n_frames and bool(self.weights.all())

    def robust_weights(self, residual: Floats) -> Floats:
        """Return weights (b, T) for residuals (b, 3, T): 1 / (1 + (r / (3s + 0.5 mm))²)², s the median distance r.

        S. Geman, D. E. McClure, 1985, Bayesian image analysis: an application to single photon emission tomography.
        """
        size = np.sqrt(np.einsum("bct,bct->bt", residual, residual))
        median = nan_median(np.where(self.weights > 0, size, np.nan), axis=1)[:, None]
        return np.asarray(self.weights / (1.0 + (size / (_SCALE_FACTOR * median + NOISE_FLOOR)) ** 2) ** 2)


@dataclass(frozen=True)
class Sample:
    """The rows that b markers are learnt from.

    values: (b, n + 4, T), the inputs and the 3 targets less their means, and ones. means: (b, n + 3, 1).
    """

    values: Floats
    means: Floats
    rows: Rows

    @classmethod
    def of(cls, inputs: Floats, targets: Floats, rows: Rows) -> "Sample":
        """Return the rows with inputs (b, n, T) and targets (b, 3, T)."""
        values = np.concatenate([inputs, targets, np.ones((len(inputs), 1, inputs.shape[2]))], axis=1)
        means = values[:, :-1] @ (rows.weights / rows.weights.sum(axis=1, keepdims=True))[..., None]
        values[:, :-1] -= means
        return cls(values, means, rows)

    @property
    def n(self) -> int:
        """The number of inputs."""
        return int(self.values.shape[1]) - 4

    @property
    def inputs(self) -> Floats:
        """The inputs (b, n, T)."""
        return self.values[:, : self.n]

    @property
    def targets(self) -> Floats:
        """The targets (b, 3, T)."""
        return self.values[:, self.n : -1]

    def some(self, markers: Ints, rows: Ints) -> "Sample":
        """Return the sample of some of the markers (j,), in some of their rows (j, t)."""
        values = np.stack([self.values[k][:, row] for k, row in zip(markers.tolist(), rows, strict=True)])
        each = markers[:, None]
        return Sample(values, self.means[markers], Rows(self.rows.frames[each, rows], self.rows.weights[each, rows]))


@dataclass(frozen=True)
class RidgeFit:
    """Slopes (b, 3, n), and the weighted means of the inputs (b, n, 1) and of the targets (b, 3, 1).

    penalties: (b,), for each unit of weight of the rows.
    """

    slopes: Floats
    input_mean: Floats
    target_mean: Floats
    penalties: Floats

    @property
    def intercept(self) -> Floats:
        """The prediction (b, 3, 1) for inputs of 0."""
        return np.asarray(self.target_mean - self.slopes @ self.input_mean)

    def predict(self, inputs: Floats) -> Floats:
        """Return the predictions (b, 3, T) for inputs (b, n, T)."""
        return np.asarray(self.slopes @ inputs + self.intercept)


def regress(sample: Sample) -> RidgeFit:
    """Return robust ridge regressions of targets on inputs, by iteratively reweighted fits."""
    n, weights = sample.n, sample.rows.weights
    for index in range(_N_FITS):
        # XᵀWX, XᵀWY and YᵀWY of all columns less their means, from one product of √w (X, Y, 1) with itself.
        scaled = sample.values * np.sqrt(weights)[:, None]
        means, products = centred(scaled @ scaled.swapaxes(1, 2))
        gram, moment = products[:, :n, :n], products[:, :n, n:]
        penalties = gcv_penalties(gram, moment, np.trace(products[:, n:, n:], axis1=1, axis2=2), sample.rows)
        slopes = ridge_slopes(gram, moment, penalties).swapaxes(1, 2)
        fit = RidgeFit(slopes, means[:, :n], means[:, n:], penalties / weights.sum(axis=1))
        if index < _N_FITS - 1:
            weights = sample.rows.robust_weights(sample.targets - fit.predict(sample.inputs))
    return replace(
        fit, input_mean=fit.input_mean + sample.means[:, :n], target_mean=fit.target_mean + sample.means[:, n:]
    )


def centred(products: Floats) -> tuple[Floats, Floats]:
    """Return the weighted means (b, m, 1) of columns, and the products (b, m, m) of the columns less their means.

    products: (b, m + 1, m + 1), weighted sums of products of the columns, of which the last one is ones.
    """
    means = products[:, :-1, -1:] / products[:, -1:, -1:]
    return means, products[:, :-1, :-1] - means * products[:, -1:, :-1]


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
