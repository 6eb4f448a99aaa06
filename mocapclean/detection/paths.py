"""Which samples of a marker lie off the path that its other samples make.

Every sample has two coordinates: its position in the world, and its residual, what is left of it after the markers
around it have had their say. A break is a frame at which both change as the marker's own noise and the acceleration
around it do not explain. Between breaks a path is whole; of its pieces the chain of largest total length is kept in
which each can follow the one before.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mocapclean.arrays import Bools, Floats, Ints, column_runs, runs
from mocapclean.numerics.robust import nan_median, nan_quantiles

_LEAST = 8.0
_CALM, _JERK = 3.0, 0.6
_RARE = 1e-6
_NEAR = 2
_NO_PATH = 0.1
_HALO = 2
_LOOK_BACK = 40
_FREE, _GROWTH = 6, 0.25
_LAGS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256])
_WANDER = 3.0
_FEW = 20
_WINDOW, _FEWEST = 5, 4


def innovations(positions: Floats, residual: Floats) -> Floats:
    """How far (F, M) each frame is from where the frames before it lead, or it from where those after it lead, in mm.

    positions, residual: (F, M, 3), NaN where not trusted. Of the two directions, and of position and residual held or
    carried on, the one that explains most counts; NaN at the first trusted frame of a piece.
    """
    shape = residual.shape[:2]
    held, onward, backward = (np.full(shape, np.nan) for _ in range(3))
    held[1:] = np.linalg.norm(np.diff(residual, axis=0), axis=2)
    bend = np.fmin(*(np.linalg.norm(np.diff(path, n=2, axis=0), axis=2) for path in (residual, positions)))
    onward[2:], backward[1:-1] = bend, bend
    return np.asarray(np.fmin(held, np.fmin(onward, backward)))


def thresholds(innovation: Floats, usable: Bools, expected: Floats) -> Floats:
    """The innovation (F, M) from which on a frame is a break, in mm.

    The largest of 8 mm; of what the marker's own noise exceeds once in a million; and of 3 medians and 0.6 times the
    acceleration, in mm per frame², of where it is expected (F, M, 3), the largest of 5 frames. usable: (F, M), the
    samples whose noise counts.
    """
    median, rare = tail(np.where(usable, innovation, np.nan))
    return np.asarray(np.maximum(np.maximum(rare, _LEAST), _CALM * median + _JERK * _jerk(expected)))


def _jerk(expected: Floats) -> Floats:
    """The acceleration (F, M) of positions (F, M, 3), mm per frame², the largest of 5 frames."""
    jerk = np.zeros(expected.shape[:2])
    jerk[1:-1] = np.linalg.norm(np.diff(expected, n=2, axis=0), axis=2)
    around = jerk.copy()
    for near in range(1, _NEAR + 1):
        around[near:] = np.maximum(around[near:], jerk[:-near])
        around[:-near] = np.maximum(around[:-near], jerk[near:])
    return around


def deviations(
    positions: Floats, residual: Floats, breaks: Bools, threshold: Floats, usable: Bools, cost: float, end: float
) -> tuple[Floats, slice, float]:
    """How far the frames (F,) of one marker lie off its path, in mm, from where to where it leads, and what it costs.

    The distance is 0 on the path and within the threshold of it; the cost is that of the frames off it, and of the
    steps of it that nothing explains.

    positions, residual: (F, 3), NaN where not trusted; breaks: (F,) bool; threshold: (F,) mm; usable: (F,) the frames
    whose wandering counts. cost: what a step that nothing explains costs, in frames, beyond an end off the path: it is
    worth it to keep an end of this length. end: what an end off the path costs besides its frames, for a piece between
    two that can follow each other has gone there and back, even if it is longer than both. Off the chain, the residual
    of the path is a line; before and after all of it, what it is at its end, or in the median of ``cost`` frames there.
    A marker that breaks in more than a tenth of its frames has no path.
    """
    trusted = np.isfinite(residual[:, 0])
    off = np.zeros(len(trusted))
    n_breaks = np.count_nonzero(breaks & trusted)
    if not n_breaks or n_breaks > _NO_PATH * np.count_nonzero(trusted):
        return off, slice(0, len(off)), 0.0
    pieces = _pieces(trusted, breaks)
    wander = _wander(residual, usable & trusted)
    chain, toll = _chain(positions, residual, pieces, breaks, threshold, wander, cost, end)
    kept, doubted = np.flatnonzero(chain), np.flatnonzero(trusted & ~chain)
    away = np.full(len(doubted), np.inf)
    for first, last in ((residual[kept[0]], residual[kept[-1]]), _usual(residual[kept], max(1, round(cost)))):
        bridge = [np.interp(doubted, kept, residual[kept, c], first[c], last[c]) for c in range(3)]
        away = np.minimum(away, np.linalg.norm(residual[doubted] - np.stack(bridge, axis=1), axis=1))
    off[doubted] = np.where(away > threshold[doubted], away, 0.0)
    return off, slice(int(kept[0]), int(kept[-1]) + 1), float(np.count_nonzero(off) + toll)


def _usual(kept: Floats, near: int) -> tuple[Floats, Floats]:
    """The medians of the first and the last rows of a path (n, 3)."""
    return nan_median(kept[:near]), nan_median(kept[-near:])


def _pieces(trusted: Bools, breaks: Bools) -> Ints:
    """Pieces (start, stop) between gaps and breaks; the frames next to a break are pieces of their own."""
    near = breaks.copy()
    for halo in range(1, _HALO + 1):
        near[halo:] |= breaks[:-halo]
        near[:-halo] |= breaks[halo:]
    parts = []
    for start, stop in runs(trusted):
        inner = start + 1 + np.flatnonzero(near[start + 1 : stop])
        parts.append(np.stack([np.r_[start, inner], np.r_[inner, stop]], axis=1))
    return np.concatenate(parts)


def _wander(residual: Floats, usable: Bools) -> Floats:
    """How far a residual may wander over each of the lags: 3 times what it does in nine of ten cases."""
    far = np.zeros(len(_LAGS))
    for k, lag in enumerate(_LAGS[len(residual) > _LAGS]):
        both = usable[lag:] & usable[:-lag]
        if np.count_nonzero(both) > _FEW:
            gone = np.linalg.norm(residual[lag:][both] - residual[:-lag][both], axis=1)
            far[k] = _WANDER * np.partition(gone, int(0.9 * len(gone)))[int(0.9 * len(gone))]
    return np.asarray(np.maximum.accumulate(far))


def _chain(
    positions: Floats,
    residual: Floats,
    pieces: Ints,
    breaks: Bools,
    threshold: Floats,
    wander: Floats,
    cost: float,
    end: float,
) -> tuple[Bools, float]:
    """The frames (F,) of the chain of pieces of most length less what its steps and ends cost; and that cost."""
    starts, stops = pieces.T
    several = (stops - starts > 1)[:, None]

    def ends(path: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        first, last = path[starts], path[stops - 1]
        leaving = np.where(several, last - path[np.maximum(stops - 2, 0)], 0.0)
        arriving = np.where(several, path[np.minimum(starts + 1, len(path) - 1)] - first, 0.0)
        return first, last, leaving, arriving

    first, last, leaving, arriving = ends(residual)
    came, went, away, towards = ends(positions)
    length = (stops - starts).astype(float)
    before, toll = np.full(len(pieces), -1), np.r_[0.0, np.full(len(pieces) - 1, end)]
    total = length - toll
    for i in range(1, len(pieces)):
        j = np.arange(max(0, i - _LOOK_BACK), i)
        gap = starts[i] - (stops[j] - 1)
        far = gap > _FREE
        limit = np.maximum(threshold[starts[i]], threshold[stops[j] - 1])
        limit = np.where(far, np.maximum(limit * (1 + _GROWTH * (gap - _FREE)), np.interp(gap, _LAGS, wander)), limit)
        step, leap, time = first[i] - last[j], came[i] - went[j], gap[:, None].astype(float)
        by_residual = np.array([step, step - time * leaving[j], step - time * arriving[i]])
        by_position = np.array([leap - time * away[j], leap - time * towards[i]])
        can = (np.einsum("kjc,kjc->kj", by_residual, by_residual) <= limit**2).any(axis=0)
        close = (gap <= _NEAR + 1) & (several[i, 0] | several[j, 0])
        can |= close & (np.einsum("kjc,kjc->kj", by_position, by_position) <= threshold[starts[i]] ** 2).any(axis=0)
        can |= (gap == 1) & ~breaks[starts[i]]
        worth = total[j] - np.where(can, 0.0, cost + end)
        best = int(np.argmax(worth))
        if worth[best] > -end:
            before[i] = j[best]
            total[i] = length[i] + worth[best]
            toll[i] = toll[j[best]] + total[j[best]] - worth[best]
    total[:-1], toll[:-1] = total[:-1] - end, toll[:-1] + end
    chosen = np.zeros(len(residual), dtype=bool)
    last_piece = i = int(np.argmax(total))
    while i >= 0:
        chosen[starts[i] : stops[i]] = True
        i = int(before[i])
    return chosen, float(toll[last_piece])


def bursts(innovation: Floats, usable: Bools, expected: Floats) -> Bools:
    """Samples (F, M) in bursts of noise: the median innovation of 5 frames is beyond its threshold for 4 or more.

    The threshold is as in ``thresholds``; the last of these frames leads back and is none of the samples.
    """
    out = np.zeros_like(usable)
    if len(innovation) < _WINDOW:
        return out
    noise = np.full_like(innovation, np.nan)
    half = _WINDOW // 2
    noise[half : len(noise) - half] = nan_median(sliding_window_view(innovation, _WINDOW, axis=0), axis=2)
    loud = noise > thresholds(noise, usable, expected)
    for marker, start, stop in column_runs(loud):
        if stop - start >= _FEWEST:
            out[start : stop - 1, marker] = True
    return out


def tail(noise: Floats) -> tuple[Floats, Floats]:
    """The median of noise (F, M), NaN where it is not known, and the value (M,) that it exceeds once in a million.

    An exponential tail through the median and the 95th percentile, found without what lies beyond the tail through the
    75th, so that a marker that is at fault in a twentieth of its frames does not hide it.
    """
    for share in (0.75, 0.95, 0.95):
        median, high = np.nan_to_num(nan_quantiles(noise, (0.5, share)))
        rare = median + (high - median) * np.log(0.5 / _RARE) / np.log(0.5 / (1 - share))
        noise = np.where(noise > np.maximum(rare, _LEAST), np.nan, noise)
    return median, rare
