"""Find a marker's path, the chain of trajectory segments that fit together best, and the samples that deviate from it.

Breaks cut the samples of a marker into segments. The path is the chain of segments with the largest total length, less
the costs of the links that nothing explains. A link is explained where the later segment lies where the earlier leads.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.segments import SegmentEnds, best_chain, cut_segments
from mocapclean.numerics.robust import nan_median

_MOST_BREAKS = 0.1  # share of a marker's frames that may be breaks; beyond it the marker has no path
_CUT_REACH = 2  # frames on each side of a break that are segments of their own
_SHORT_GAP = 6  # frames between two segments up to which the threshold itself limits their distance
_LIMIT_GROWTH = 0.25  # growth of this limit for each frame more, as a share of the threshold
_LAGS = np.array([1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256])  # frames
_LAG_SHARE = 0.9  # quantile of the changes of a residual over a lag
_LAG_FACTOR = 3.0  # times this quantile that a residual may change over a lag
_FEWEST_CHANGES = 20  # changes that a lag must have more of to be measured
_POSITION_GAP = 3  # frames between two segments up to which positions are extrapolated


@dataclass(frozen=True)
class Deviations:
    """The samples of one marker off its path.

    distance: (F,) mm, 0 on the path and within the threshold of it. span: the frames from the first to the last of the
    path. cost: in frames, the samples off the path plus the costs of its links and ends. leaps: the frames before and
    after each link of the path that nothing explains.
    """

    distance: Floats
    span: slice
    cost: float
    leaps: tuple[tuple[int, int], ...] = ()


@dataclass(frozen=True)
class PathCosts:
    """The penalties, in frames, of a link that nothing explains and of an end that is left out.

    link: of a link that nothing explains. end: of an end of the path that is left out, besides its frames. An excursion
    between two segments that can follow each other is therefore left out even if it is longer than both.
    """

    link: float
    end: float


def deviations(
    positions: Floats, residual: Floats, breaks: Bools, threshold: Floats, usable: Bools, costs: PathCosts
) -> Deviations:
    """Return the deviations of one marker from its path.

    positions, residual: (F, 3) mm, NaN where not measured. breaks: (F,). threshold: (F,) mm. usable: (F,), the samples
    that show how far the residual changes over a lag. Between segments of the path the residual is interpolated;
    before and after the path it is its end value, or the median of ``costs.link`` frames there, the nearer one.
    """
    measured = np.isfinite(residual[:, 0])
    distance = np.zeros(len(measured))
    n_breaks = np.count_nonzero(breaks & measured)
    if not n_breaks or n_breaks > _MOST_BREAKS * np.count_nonzero(measured):
        return Deviations(distance, slice(0, len(distance)), 0.0)
    segments = cut_segments(measured, _widened(breaks))
    lag_limits = _lag_limits(residual, usable & measured)
    links = _Links(positions, residual, segments, breaks, threshold, lag_limits, costs.link + costs.end)
    chain, chain_cost = best_chain(segments, len(residual), links.costs, costs.end)
    kept, left_out = np.flatnonzero(chain), np.flatnonzero(measured & ~chain)
    # Distance of each sample left out from the residual interpolated through the chain, for both choices of its ends.
    nearest = np.full(len(left_out), np.inf)
    n_end = max(1, round(costs.link))
    medians = nan_median(residual[kept][:n_end]), nan_median(residual[kept][-n_end:])
    for first, last in ((residual[kept[0]], residual[kept[-1]]), medians):
        line = [np.interp(left_out, kept, residual[kept, c], first[c], last[c]) for c in range(3)]
        nearest = np.minimum(nearest, np.linalg.norm(residual[left_out] - np.stack(line, axis=1), axis=1))
    distance[left_out] = np.where(nearest > threshold[left_out], nearest, 0.0)
    span = slice(int(kept[0]), int(kept[-1]) + 1)
    leaps = _leaps(segments[chain[segments[:, 0]]], segments, links)
    return Deviations(distance, span, float(np.count_nonzero(distance) + chain_cost), leaps)


def _leaps(chain: Ints, segments: Ints, links: "_Links") -> tuple[tuple[int, int], ...]:
    """Return the last frame before and the first after each link of a chain of segments (n, 2) with a cost."""
    place = np.searchsorted(segments[:, 0], chain[:, 0])
    earlier, later = place[:-1], place[1:]
    unexplained = links.costs(later, earlier) > 0
    before, after = segments[earlier[unexplained], 1] - 1, segments[later[unexplained], 0]
    return tuple(zip(before.tolist(), after.tolist(), strict=True))


def _widened(breaks: Bools) -> Bools:
    """Return breaks (F,) and the frames within 2 of them."""
    near = breaks.copy()
    for shift in range(1, _CUT_REACH + 1):
        near[shift:] |= breaks[:-shift]
        near[:-shift] |= breaks[shift:]
    return near


def _lag_limits(residual: Floats, usable: Bools) -> Floats:
    """Return how far a residual (F, 3) may change over each of ``_LAGS``, mm.

    3 times the 90th percentile of its changes. A lag with 20 changes or fewer has the limit of the shorter ones.
    """
    limits = np.zeros(len(_LAGS))
    for k, lag in enumerate(_LAGS[len(residual) > _LAGS]):
        both = usable[lag:] & usable[:-lag]
        if np.count_nonzero(both) > _FEWEST_CHANGES:
            change = np.linalg.norm(residual[lag:][both] - residual[:-lag][both], axis=1)
            rank = int(_LAG_SHARE * len(change))
            limits[k] = _LAG_FACTOR * np.partition(change, rank)[rank]
    return np.asarray(np.maximum.accumulate(limits))


class _Links:
    """The costs of links between segments of a trajectory: 0 where the later one fits a prediction, else a constant."""

    def __init__(
        self,
        positions: Floats,
        residual: Floats,
        segments: Ints,
        breaks: Bools,
        threshold: Floats,
        lag_limits: Floats,
        unexplained: float,
    ) -> None:
        self.starts, self.stops = segments.T
        self.several = self.stops - self.starts > 1
        self.of_residual, self.of_position = SegmentEnds.of(residual, segments), SegmentEnds.of(positions, segments)
        self.breaks, self.threshold, self.lag_limits = breaks, threshold, lag_limits
        self.unexplained = unexplained

    def costs(self, later: Ints, earlier: Ints) -> Floats:
        """Return the costs (...) of the links from earlier to later segments (...): 0 where the later can follow."""
        start, before = self.starts[later], self.stops[earlier] - 1
        gap = start - before
        # By the residual: kept, or extrapolated from either end, within a limit that grows with the gap.
        limit = self._limits(start, before, gap)
        follows = (self.of_residual.misses(later, earlier, gap) <= limit).any(axis=0)
        # By the position, over short gaps only: extrapolated from either end.
        near = (gap <= _POSITION_GAP) & (self.several[later] | self.several[earlier])
        follows |= near & (self.of_position.misses(later, earlier, gap)[1:] <= self.threshold[start]).any(axis=0)
        # Adjacent frames without a break between them.
        follows |= (gap == 1) & ~self.breaks[start]
        return np.where(follows, 0.0, self.unexplained)

    def _limits(self, start: Ints, before: Ints, gap: Ints) -> Floats:
        """Return how far (...) the residual may change over gaps (...) from frames before (...) to a start (...)."""
        limit = np.maximum(self.threshold[start], self.threshold[before])
        grown = np.maximum(limit * (1 + _LIMIT_GROWTH * (gap - _SHORT_GAP)), np.interp(gap, _LAGS, self.lag_limits))
        return np.asarray(np.where(gap > _SHORT_GAP, grown, limit))
