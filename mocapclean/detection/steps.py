"""Steps: from some frame on a marker sits elsewhere in its segment for good.

A step is added to the regression of a marker on those around it, and the frame where it explains most is taken.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.robust_ridge import FLOOR, Rows, about_means, penalty, slopes

_CANDIDATES, _EDGE, _FEWEST = 80, 0.08, 10
BETWEEN, _BELIEVED = 0.1, 0.4
_LONGEST_LAG = 200
_ROOM = 1e-9
_SHARE = 1e-9


@dataclass(frozen=True)
class Step:
    """From frame ``start`` on a marker sits ``offset`` (3,) mm from where it sat, in its segment's frame.

    score: the size of the step over its standard error, as the noise is in its direction. sudden: whether it is made
    within a frame. bends: how many lengths it changes that are constant otherwise. agreed: whether the distances to
    rigid partners change as it says.
    """

    marker: int
    start: int
    offset: Floats
    score: float
    sudden: bool = False
    bends: int = 0
    agreed: bool = False


def steps_of(markers: Ints, inputs: Floats, wanted: Floats, rows: Rows, slide: int) -> list[Step]:
    """For each of the markers (b,) the step that explains most beside a ridge regression of what is wanted (b, T, 3) on
    inputs (b, T, n).

    It is made at once, or by a slide of so many frames: then the rows about it are left out before it is fitted, for
    the inputs take a slide for motion. What has the higher score counts, of what the rows of both sides agree with.
    """
    edge = np.maximum(_FEWEST, np.rint(_EDGE * rows.number).astype(np.intp))
    enough = rows.number >= 4 * edge
    if not enough.any():
        return []
    markers, edge, rows = markers[enough], edge[enough], Rows(rows.frames[enough], rows.count[enough])
    last = rows.number - edge
    length = rows.frames[:, -1] - rows.frames[:, 0] + 1
    slides = np.minimum(slide * rows.number // length, (BETWEEN * rows.number).astype(np.intp))[:, None]
    search = _Search(inputs[enough], wanted[enough], rows)
    starts = np.linspace(edge, last, _CANDIDATES, axis=1).astype(np.intp)
    rough = search.fit(starts, search.without())
    away = np.abs(search.index - rough.start[:, None]) > slides
    slid = search.fit(rough.start[:, None], replace(rough, weights=rough.weights * away))
    reach = 1 + rows.number // _CANDIDATES
    around = np.arange(-max(reach), max(reach) + 1)
    fits = []
    for fit in (search.fit(starts, rough), slid):
        low, high = np.maximum(edge, fit.start - reach), np.minimum(last, fit.start + reach)
        fits.append(search.fit(np.clip(fit.start[:, None] + around, low[:, None], high[:, None]), fit))
    scores = np.stack([np.where(_believed(fit, slides, rows), fit.score(rows.number), -np.inf) for fit in fits])
    return [
        Step(marker, int(rows.frames[i, fits[k].start[i]]), fits[k].offset[i], float(scores[k, i]))
        for i, (marker, k) in enumerate(zip(markers.tolist(), np.argmax(scores, axis=0).tolist(), strict=True))
        if scores[k, i] > 0
    ]


@dataclass(frozen=True)
class _StepFit:
    """From which rows (b,) on there are offsets (b, 3), what the rows (b, T) count, what is left of them, weighted
    (b, T, 3), and the room (b,) that the inputs leave for a step.
    """

    start: Ints
    offset: Floats
    weights: Floats
    noise: Floats
    room: Floats

    def score(self, n_rows: Ints) -> Floats:
        """The sizes (b,) of the offsets over their standard errors."""
        variance = self.noise.swapaxes(1, 2) @ self.noise / self.weights.sum(axis=1)[:, None, None]
        against = np.linalg.solve(_floored(variance), self.offset[..., None])[..., 0]
        surprise = np.einsum("bc,bc->b", self.offset, against)
        return np.asarray(np.sqrt(surprise / 3.0 * self.room / _correlation_times(self.noise, n_rows)))


def _believed(fit: _StepFit, slides: Ints, rows: Rows) -> Bools:
    """Whether (b,) the rows of both sides of a step, those of the slide aside, agree with it."""
    away = np.arange(rows.count.shape[1]) - fit.start[:, None]
    share = [
        (fit.weights * side).sum(axis=1) / np.maximum((rows.count * side).sum(axis=1), 1.0)
        for side in (away < -slides, away > slides)
    ]
    return np.asarray(np.minimum(*share) >= _BELIEVED)


class _Search:
    """Steps beside ridge regressions of what is wanted (b, T, 3) on inputs (b, T, n)."""

    def __init__(self, inputs: Floats, wanted: Floats, rows: Rows) -> None:
        self.n, self.rows = inputs.shape[2], rows
        self.columns = np.concatenate([inputs, wanted], axis=2)
        self.index = np.arange(rows.count.shape[1])

    def without(self) -> "_StepFit":
        """No step at all."""
        n = len(self.columns)
        return _StepFit(self.rows.number, np.zeros((n, 3)), self.rows.count, self.columns[:, :, self.n :], np.ones(n))

    def fit(self, starts: Ints, last: _StepFit) -> _StepFit:
        """The best of the steps from starts (b, k) on, with the weights of the last fit.

        With tails T, the sums of what is weighted and centred from a row on, an offset is T(y) - T(x) S over the room
        for it: S are the slopes of y on x, and the room is what x does not explain of the step. A direction counts by
        the noise in it, for most markers are predicted worse in one. Noise and penalty are those without the last step.
        """
        n, each, weights = self.n, np.arange(len(starts)), last.weights
        _, centred = about_means(self.columns, weights)
        weighted = weights[..., None] * centred
        products = weighted.swapaxes(1, 2) @ centred
        before = np.column_stack([last.start, starts])
        tails = -np.take_along_axis(np.cumsum(weighted, axis=1, out=weighted), before[..., None] - 1, axis=1)
        total = weights.sum(axis=1, keepdims=True)
        after = total - np.take_along_axis(np.cumsum(weights, axis=1), before - 1, axis=1)
        spread = after * (1.0 - after / total)
        gram, moment = products[:, :n, :n], products[:, :n, n:]
        taken, size = tails[:, :1].swapaxes(1, 2) @ last.offset[:, None], last.offset * spread[:, :1]
        rest, energy = moment - taken[:, :n], products[:, n:, n:] - taken[:, n:] - taken[:, n:].swapaxes(1, 2)
        energy = energy + size[:, :, None] * last.offset[:, None]
        penalties = penalty(gram, rest, np.trace(energy, axis1=1, axis2=2), self.rows)
        (own, said), spread = np.split(tails[:, 1:], [n], axis=2), spread[:, 1:]
        found = slopes(gram, np.concatenate([moment, rest, own.swapaxes(1, 2)], axis=2), penalties)
        of_wanted, of_rest, of_steps = np.split(found, [3, 6], axis=2)
        shared = of_rest.swapaxes(1, 2) @ rest
        noise = energy - shared - shared.swapaxes(1, 2) + of_rest.swapaxes(1, 2) @ gram @ of_rest
        said = said - own @ of_wanted
        room = np.maximum(spread - np.einsum("bkn,bnk->bk", own, of_steps), _ROOM)
        counts = np.linalg.solve(_floored(noise / total[..., None]), said.swapaxes(1, 2))
        best = np.argmax(np.einsum("bkc,bck->bk", said, counts) / room, axis=1)
        start, room, offset = starts[each, best], room[each, best], said[each, best] / room[each, best, None]
        left = centred[:, :, n:] - centred[:, :, :n] @ (of_wanted - of_steps[each, :, best, None] * offset[:, None])
        left -= (self.index >= start[:, None])[..., None] * offset[:, None]
        left -= (weights[:, None] @ left) / total[..., None]
        weights = self.rows.confidence(left)
        return _StepFit(start, offset, weights, weights[..., None] * left, room)


def _floored(variance: Floats) -> Floats:
    """Variances (b, 3, 3) that are in no direction less than a floor and a share of all of it."""
    least = FLOOR**2 / 3.0 + _SHARE * np.trace(variance, axis1=1, axis2=2)
    return np.asarray(variance + least[:, None, None] * np.eye(3))


def _correlation_times(noise: Floats, n_rows: Ints) -> Floats:
    """How many of the first rows (b,) of noise (b, T, 3) count as one.

    1 + 2 Σ of the autocorrelation to where it falls below 0.1, to a lag of a quarter of the rows at most.
    """
    longest = np.minimum(_LONGEST_LAG, n_rows // 4)
    size = next_fast_len(noise.shape[1] + _LONGEST_LAG, real=True)
    power = (np.abs(rfft(noise, size, axis=1)) ** 2).sum(axis=2)
    along = irfft(power, size, axis=1)[:, :_LONGEST_LAG]
    share = along[:, 1:] / np.maximum(along[:, :1], np.finfo(float).tiny)
    counts = (share >= 0.1) & (np.arange(1, _LONGEST_LAG) < longest[:, None])
    return np.asarray(1.0 + 2.0 * (share * np.logical_and.accumulate(counts, axis=1)).sum(axis=1))
