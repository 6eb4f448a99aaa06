"""Ridge regressions of several markers at once, in which rows that nothing explains count little."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.numerics.robust import nan_median

FLOOR = 0.5
_FITS = 3
_PENALTIES = np.logspace(-6, 1, 15)
_LEAST = 1e-100  # its square is still a number


@dataclass(frozen=True)
class Rows:
    """The frames (b, T) that b markers are learnt from, in order, and what they count: 0 where a marker has fewer."""

    frames: Ints
    count: Floats

    @classmethod
    def of(cls, frames: list[Ints]) -> "Rows":
        """The rows of so many frames for each marker."""
        most = max(map(len, frames))
        filled = np.stack([np.pad(each, (0, most - len(each)), mode="edge") for each in frames])
        return cls(filled, np.stack([np.arange(most) < len(each) for each in frames]).astype(float))

    @property
    def number(self) -> Ints:
        """How many rows (b,) count."""
        return np.asarray(self.count.sum(axis=1).astype(np.intp))

    def take(self, values: Floats) -> Floats:
        """The rows (b, T, n) of values (b, F, n)."""
        return np.take_along_axis(values, self.frames[..., None], axis=1)

    def confidence(self, missed: Floats) -> Floats:
        """What rows that miss by so much (b, T, 3) count: 1 / (1 + (r / 3s)²)², with the median s of their distances r.

        S. Geman, D. E. McClure, 1985, Bayesian image analysis: an application to single photon emission tomography.
        """
        size = np.sqrt(np.einsum("btc,btc->bt", missed, missed))
        usual = nan_median(np.where(self.count > 0, size, np.nan), axis=1)[:, None]
        return np.asarray(self.count / (1.0 + (size / (3.0 * usual + FLOOR)) ** 2) ** 2)


@dataclass(frozen=True)
class Fit:
    """Slopes (b, n, 3) and the means of inputs (b, 1, n) and of what is wanted (b, 1, 3)."""

    slopes: Floats
    mean: Floats
    middle: Floats

    def at(self, inputs: Floats) -> Floats:
        """What is expected (b, T, 3) at inputs (b, T, n)."""
        return np.asarray(inputs @ self.slopes + (self.middle - self.mean @ self.slopes))


def regress(inputs: Floats, wanted: Floats, rows: Rows) -> Fit:
    """Ridge regressions of what is wanted (b, T, 3) on inputs (b, T, n), in which what misses far counts little."""
    n, weights = inputs.shape[2], rows.count
    columns = np.concatenate([inputs, wanted], axis=2)
    for _ in range(_FITS):
        means, centred = about_means(columns, weights)
        products = (weights[..., None] * centred).swapaxes(1, 2) @ centred
        gram, moment = products[:, :n, :n], products[:, :n, n:]
        penalties = penalty(gram, moment, np.trace(products[:, n:, n:], axis1=1, axis2=2), rows)
        fit = Fit(slopes(gram, moment, penalties), means[:, :, :n], means[:, :, n:])
        weights = rows.confidence(wanted - fit.at(inputs))
    return fit


def about_means(columns: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The means (b, 1, m) of columns (b, T, m) weighted by (b, T), and the columns less them."""
    means = (weights / weights.sum(axis=1, keepdims=True))[:, None] @ columns
    return means, columns - means


def penalty(gram: Floats, moment: Floats, energy: Floats, rows: Rows) -> Floats:
    """The penalties (b,) of ridge regressions with Gram matrices (b, n, n), moments (b, n, 3) and energies (b,).

    By generalised cross-validation with a tenth of the rows counted, for neighbouring frames say nearly the same.
    """
    values, vectors = np.linalg.eigh(gram)
    values = np.maximum(values, 0.0)[:, None]
    penalties = _PENALTIES * np.maximum(values[:, :, -1], _LEAST)
    shrunk = values + penalties[..., None]
    freedom = (values / shrunk).sum(axis=2)
    projected = ((vectors.swapaxes(1, 2) @ moment) ** 2).sum(axis=2)[:, None]
    gain = (projected * (shrunk + penalties[..., None]) / shrunk**2).sum(axis=2)
    counted = np.maximum(rows.number / 10.0, 5.0)[:, None]
    score = (energy[:, None] - gain) / np.maximum(1 - freedom / counted, 0.05) ** 2
    best = np.argmin(np.where(freedom < 0.95 * counted, score, np.inf), axis=1)
    return np.asarray(penalties[np.arange(len(best)), best])


def slopes(gram: Floats, moment: Floats, penalties: Floats) -> Floats:
    """The slopes (b, n, k) for moments (b, n, k)."""
    return np.asarray(np.linalg.solve(gram + penalties[:, None, None] * np.eye(gram.shape[1]), moment))
