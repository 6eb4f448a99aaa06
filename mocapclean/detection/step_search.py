"""The search for steps: change points in the regression of a marker on its partners, by generalised least squares.

Model of a marker's rows: y = X S + s(a) oᵀ + noise, where s(a) is 0 before row a and 1 from it on. The slopes S and the
offset o are fitted together for every candidate a, and the a that explains most is taken.

Most markers have no step. A coarse search over few rows shows which may have one, and only these are searched in full.

Shapes: b markers, T rows, n inputs, k candidates.
"""

from dataclasses import dataclass, replace

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.robust_ridge import NOISE_FLOOR, Rows, Sample, centred, gcv_penalties, ridge_slopes
from mocapclean.detection.steps import Step

# Chosen by hand on the takes of `bench trust`, seeds 0 to 4 (docs/results.md), where no other reason is given; no sweep
# was kept.
LONGEST_SLIDE = 0.1  # share of the rows that a slide may take
_N_CANDIDATES = 80  # candidates of the coarse search
_SCREEN_ROWS = 200  # rows of the search that shows which markers may have a step; chosen for speed
# Size, mm, and score from which on that search shows a step. Chosen on every fourth capture, up to 1200 frames, as they
# are and with faults: a third of the markers are left, with all 514 steps of the least size and score.
_SCREEN_SIZE = 4.0
_SCREEN_SCORE = 0.5
_EDGE = 0.08  # share of the rows at each end in which no step is looked for
_FEWEST_EDGE = 10  # rows at each end, at least
_LEAST_SUPPORT = 0.4  # mean weight that the rows of both sides of a step must keep
_LONGEST_LAG = 200  # rows, longest lag of the autocorrelation
_LEAST_CORRELATION = 0.1  # autocorrelation at which the sum over lags ends
_LEAST_ENERGY = 1e-9  # keeps a step that the inputs explain from a division by 0
_VARIANCE_SHARE = 1e-9  # least variance in any direction, as a share of the total: keeps matrices regular


def find_steps(markers: Ints, sample: Sample, slide: int, penalties: Floats | None = None) -> list[Step]:
    """Return the best step of each of the markers (b,), from targets regressed on inputs.

    Markers with too few rows have no step. penalties: (b,), the ridge penalties of regressions without a step, for each
    unit of weight: with them, markers in which a coarse search of few rows shows no step have none either.

    Two fits compete by their scores: a step within one frame, and a step by a slide of up to ``slide`` frames. The
    rows around a slide are left out, because the inputs would explain the slide as motion. A fit that the rows of one
    side contradict does not count.
    """
    enough = np.flatnonzero(sample.rows.number >= 4 * _edge(sample.rows))
    if not len(enough):
        return []
    if penalties is not None:
        number = sample.rows.number[enough]
        few = np.linspace(0, number - 1, min(_SCREEN_ROWS, int(number.max())), axis=1).astype(np.intp)
        enough = enough[_may_step(sample.some(enough, few), penalties[enough])]
        if not len(enough):
            return []
    every = np.broadcast_to(np.arange(sample.values.shape[2]), (len(enough), sample.values.shape[2]))
    return _searched(markers[enough], sample.some(enough, every), slide)


def _may_step(sample: Sample, penalties: Floats) -> Bools:
    """Whether (b,) a coarse search of a sample shows a step; its limits are far below those of a credible one."""
    search = _Search(sample)
    edge, number = _edge(sample.rows), sample.rows.number
    candidates = np.linspace(edge, number - edge, _N_CANDIDATES, axis=1).astype(np.intp)
    shown, fit = np.zeros(len(number), dtype=bool), search.without_step()
    # Without weights, and once more with the weights that the first step gives the rows.
    for _ in range(2):
        fit = search.fit(candidates, fit, penalties)
        shown |= (np.linalg.norm(fit.offset, axis=1) >= _SCREEN_SIZE) & (fit.score(number) >= _SCREEN_SCORE)
    return shown


def _edge(rows: Rows) -> Ints:
    """Return the number of rows (b,) at each end in which no step is looked for."""
    return np.asarray(np.maximum(_FEWEST_EDGE, np.rint(_EDGE * rows.number)).astype(np.intp))


def _searched(markers: Ints, sample: Sample, slide: int) -> list[Step]:
    """Return the best step of each of the markers (b,) by the full search."""
    rows = sample.rows
    edge = _edge(rows)
    last = rows.number - edge
    n_frames = rows.frames[:, -1] - rows.frames[:, 0] + 1
    slides = np.minimum(slide * rows.number // n_frames, (LONGEST_SLIDE * rows.number).astype(np.intp))[:, None]
    search = _Search(sample)
    # Coarse search over candidates spread evenly; then once more without the rows of a slide around its best.
    candidates = np.linspace(edge, last, _N_CANDIDATES, axis=1).astype(np.intp)
    coarse = search.fit(candidates, search.without_step())
    outside = np.abs(search.index - coarse.start[:, None]) > slides
    slid = search.fit(coarse.start[:, None], replace(coarse, weights=coarse.weights * outside))
    # Fine search over the rows between the neighbouring candidates.
    reach = 1 + rows.number // _N_CANDIDATES
    around = np.arange(-max(reach), max(reach) + 1)
    fits = []
    for fit in (search.fit(candidates, coarse), slid):
        low, high = np.maximum(edge, fit.start - reach), np.minimum(last, fit.start + reach)
        fits.append(search.fit(np.clip(fit.start[:, None] + around, low[:, None], high[:, None]), fit))
    scores = np.stack([np.where(_supported(fit, slides, rows), fit.score(rows.number), -np.inf) for fit in fits])
    return [
        Step(marker, int(rows.frames[i, fits[k].start[i]]), fits[k].offset[i], float(scores[k, i]))
        for i, (marker, k) in enumerate(zip(markers.tolist(), np.argmax(scores, axis=0).tolist(), strict=True))
        if scores[k, i] > 0
    ]


@dataclass(frozen=True)
class _StepFit:
    """Steps of b markers with the regressions around them.

    start: the rows (b,) from which on there are offsets (b, 3). weights: (b, T), robust weights of the rows. noise:
    (b, 3, T), weighted residuals. energy: (b,), the weighted sum of squares of s that the inputs do not explain.
    """

    start: Ints
    offset: Floats
    weights: Floats
    noise: Floats
    energy: Floats

    def score(self, n_rows: Ints) -> Floats:
        """Return the sizes (b,) of the offsets over their standard errors.

        √(oᵀ Σ⁻¹ o / 3 · energy / τ) with the covariance Σ and the correlation time τ of the noise.
        """
        covariance = self.noise @ self.noise.swapaxes(1, 2) / self.weights.sum(axis=1)[:, None, None]
        whitened = np.linalg.solve(_floored(covariance), self.offset[..., None])[..., 0]
        squared = np.einsum("bc,bc->b", self.offset, whitened)
        return np.asarray(np.sqrt(squared / 3.0 * self.energy / _correlation_times(self.noise, n_rows)))


def _supported(fit: _StepFit, slides: Ints, rows: Rows) -> Bools:
    """Whether (b,) the rows of both sides of a step keep enough weight, without those of the slide."""
    distance = np.arange(rows.weights.shape[1]) - fit.start[:, None]
    mean_weights = [
        (fit.weights * side).sum(axis=1) / np.maximum((rows.weights * side).sum(axis=1), 1.0)
        for side in (distance < -slides, distance > slides)
    ]
    return np.asarray(np.minimum(*mean_weights) >= _LEAST_SUPPORT)


class _Search:
    """Ridge regressions of a sample with one step, fitted at many candidate rows."""

    def __init__(self, sample: Sample) -> None:
        self.sample, self.n, self.rows = sample, sample.n, sample.rows
        self.index = np.arange(sample.values.shape[2])

    def without_step(self) -> _StepFit:
        """Return fits with an offset of 0."""
        n = len(self.sample.values)
        return _StepFit(self.rows.number, np.zeros((n, 3)), self.rows.weights, self.sample.targets, np.ones(n))

    def fit(self, candidates: Ints, last: _StepFit, penalties: Floats | None = None) -> _StepFit:
        """Return the best of the steps at candidates (b, k), with the weights of the last fit.

        By partial regression (R. Frisch, F. V. Waugh, 1933, doi:10.2307/1907330), with G = XᵀWX and P = (G + λI)⁻¹:
        p = sᵀWY - sᵀWX P XᵀWY, energy e = sᵀWs - sᵀWX P XᵀWs, o = p / e. The best candidate has the largest
        pᵀ Σ⁻¹ p / e, where Σ is the covariance of the noise: most markers are predicted worse in one direction. Σ and λ
        are those of the targets less the last step, unless penalties (b,) for each unit of weight are given.
        """
        n, each, weights = self.n, np.arange(len(candidates)), last.weights
        weighted = self.sample.values * weights[:, None]
        means, products = centred(weighted @ self.sample.values.swapaxes(1, 2))
        gram, moment = products[:, :n, :n], products[:, :n, n:]
        # sᵀW(X, Y) for the last step and the candidates. The weighted columns less their means sum to 0: the sum from a
        # row on is minus the sum before it. sᵀWs follows from the weight before the row, the last of these sums.
        starts = np.column_stack([last.start, candidates])[:, None]
        before = np.take_along_axis(np.cumsum(weighted, axis=2, out=weighted), starts - 1, axis=2)
        products_of_s = means * before[:, -1:] - before[:, :-1]
        total = weights.sum(axis=1, keepdims=True)
        energy_of_s = before[:, -1] * (1.0 - before[:, -1] / total)
        rest, rest_energy = self._without_last(products, products_of_s[..., :1], energy_of_s[:, :1], last.offset)
        if penalties is None:
            chosen = gcv_penalties(gram, rest, np.trace(rest_energy, axis1=1, axis2=2), self.rows)
        else:
            chosen = penalties * total[:, 0]
        # Slopes of the targets, of the targets less the last step, and of s, in one solution.
        s_inputs, s_targets, energy_of_s = products_of_s[:, :n, 1:], products_of_s[:, n:, 1:], energy_of_s[:, 1:]
        slopes = ridge_slopes(gram, np.concatenate([moment, rest, s_inputs], axis=2), chosen)
        of_targets, of_rest, of_s = np.split(slopes, [3, 6], axis=2)
        # Σ = (Y - XS)ᵀW(Y - XS) / Σw, of the targets less the last step.
        cross = of_rest.swapaxes(1, 2) @ rest
        covariance = rest_energy - cross - cross.swapaxes(1, 2) + of_rest.swapaxes(1, 2) @ gram @ of_rest
        # p, e and pᵀ Σ⁻¹ p / e of all candidates.
        partial = s_targets - of_targets.swapaxes(1, 2) @ s_inputs
        energy = np.maximum(energy_of_s - np.einsum("bnk,bnk->bk", s_inputs, of_s), _LEAST_ENERGY)
        whitened = np.linalg.solve(_floored(covariance / total[..., None]), partial)
        best = np.argmax(np.einsum("bck,bck->bk", partial, whitened) / energy, axis=1)
        start, energy = candidates[each, best], energy[each, best]
        offset = partial[each, :, best] / energy[:, None]
        # Residual Y - X (S - S_s oᵀ) - s oᵀ, centred, and the weights that it gives the rows.
        slopes = of_targets.swapaxes(1, 2) - offset[..., None] * of_s[each, :, best][:, None]
        residual = self.sample.targets - slopes @ self.sample.inputs
        residual -= (self.index >= start[:, None])[:, None] * offset[..., None]
        residual -= (residual @ weights[..., None]) / total[..., None]
        weights = self.rows.robust_weights(residual)
        return _StepFit(start, offset, weights, weights[:, None] * residual, energy)

    def _without_last(
        self, products: Floats, products_of_s: Floats, energy_of_s: Floats, offset: Floats
    ) -> tuple[Floats, Floats]:
        """Return XᵀWY (b, n, 3) and YᵀWY (b, 3, 3) for the targets less a step of this offset (b, 3).

        products: of the inputs and targets. products_of_s: sᵀW(X, Y) (b, n + 3, 1). energy_of_s: sᵀWs (b, 1).
        """
        n = self.n
        taken, size = products_of_s @ offset[:, None], offset * energy_of_s
        moment = products[:, :n, n:] - taken[:, :n]
        energy = products[:, n:, n:] - taken[:, n:] - taken[:, n:].swapaxes(1, 2)
        return moment, energy + size[:, :, None] * offset[:, None]


def _floored(covariance: Floats) -> Floats:
    """Return covariances (b, 3, 3) with at least the noise floor and a share of their trace in every direction."""
    least = NOISE_FLOOR**2 / 3.0 + _VARIANCE_SHARE * np.trace(covariance, axis1=1, axis2=2)
    return np.asarray(covariance + least[:, None, None] * np.eye(3))


def _correlation_times(noise: Floats, n_rows: Ints) -> Floats:
    """Return the correlation times (b,) of noise (b, 3, T), in rows, of which the first n_rows (b,) count.

    1 + 2 Σ of the autocorrelation up to the lag where it falls below 0.1, or a quarter of the rows.
    """
    longest = np.minimum(_LONGEST_LAG, n_rows // 4)
    # Autocorrelation by the Wiener-Khinchin theorem, padded so that it does not wrap around.
    size = _fast_length(noise.shape[2] + _LONGEST_LAG)
    power = np.square(np.abs(np.fft.rfft(noise, size, axis=2))).sum(axis=1)
    covariance = np.fft.irfft(power, size, axis=1)[:, :_LONGEST_LAG]
    correlation = covariance[:, 1:] / np.maximum(covariance[:, :1], np.finfo(float).tiny)
    counts = (correlation >= _LEAST_CORRELATION) & (np.arange(1, _LONGEST_LAG) < longest[:, None])
    return np.asarray(1.0 + 2.0 * (correlation * np.logical_and.accumulate(counts, axis=1)).sum(axis=1))


def _fast_length(least: int) -> int:
    """Return the least length from ``least`` on that is a power of 2, or 3 or 5 times one: fast to transform."""
    return min(part << (-(-least // part) - 1).bit_length() for part in (1, 3, 5))
