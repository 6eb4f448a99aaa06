"""Cut one marker's trajectory into segments at breaks, and find the chain of segments that fit together best.

Chains are found by dynamic programming over the segments in the order of time; ``paths`` and the rule ``tdd`` share it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, runs

_LOOK_BACK = (
    40  # segments before each that may precede it in a chain; chosen by hand, it bounds the cost of noisy takes
)
_AT_ONCE = 2000  # segments whose links are judged at once; bounds the memory


def cut_segments(valid: Bools, cuts: Bools) -> Ints:
    """Return the segments (S, 2) of valid frames (F,), as half-open rows (start, stop).

    A segment ends at an invalid frame and before a frame of ``cuts`` (F,). At least one frame must be valid.
    """
    segments = []
    for start, stop in runs(valid):
        inner = start + 1 + np.flatnonzero(cuts[start + 1 : stop])
        segments.append(np.stack([np.r_[start, inner], np.r_[inner, stop]], axis=1))
    return np.concatenate(segments)


@dataclass(frozen=True)
class SegmentEnds:
    """The ends of segments of a path, each (S, 3): first and last place, and the velocities, per frame, at both.

    The velocity of a segment of one frame is 0.
    """

    first: Floats
    last: Floats
    velocity_in: Floats
    velocity_out: Floats

    @classmethod
    def of(cls, path: Floats, segments: Ints) -> "SegmentEnds":
        """Return the ends of segments (S, 2) of a path (F, 3)."""
        starts, stops = segments.T
        several = (stops - starts > 1)[:, None]
        first, last = path[starts], path[stops - 1]
        velocity_out = np.where(several, last - path[np.maximum(stops - 2, 0)], 0.0)
        velocity_in = np.where(several, path[np.minimum(starts + 1, len(path) - 1)] - first, 0.0)
        return cls(first, last, velocity_in, velocity_out)

    def misses(self, later: Ints, earlier: Ints, frames: Ints) -> Floats:
        """Return the errors (3, ...), mm, of three extrapolations from earlier segments (...) to later ones, ``frames``
        after them.

        Three predictions: the last place kept; extrapolated at the velocity there; extrapolated backwards from the
        first place, at the velocity there.
        """
        time = frames[..., None].astype(float)
        step = self.first[later] - self.last[earlier]
        forward, backward = step - time * self.velocity_out[earlier], step - time * self.velocity_in[later]
        errors = np.stack([step, forward, backward])
        return np.asarray(np.sqrt(np.einsum("...c,...c->...", errors, errors)))


def best_chain(
    segments: Ints, n_frames: int, link_costs: Callable[[Ints, Ints], Floats], end_cost: float = 0.0
) -> tuple[Bools, float]:
    """Return the frames (n_frames,) of the chain of segments (S, 2) with the largest length less costs, and its costs.

    Objective: the chain c₁ < c₂ < ... < cₙ with the largest Σ length(cₖ) - Σ link(cₖ₋₁, cₖ) - begin(c₁) - stop(cₙ).
    begin is 0 for the first segment of all and ``end_cost`` for the others; stop is 0 for the last and ``end_cost`` for
    the others. An end of the path that is left out therefore costs ``end_cost``.

    Recurrence: value(i) = length(i) + max(-begin(i), max over j of value(j) - link(j, i)), j = i - 40, ..., i - 1. A
    chain with a longer run of segments left out between two others is not considered. Cost: O(40 S).

    link_costs: of later and earlier segments, two arrays of one shape, the costs in frames; infinite where a segment
    cannot follow.
    """
    starts, stops = segments.T
    n_segments = len(segments)
    length = (stops - starts).astype(float)
    link = _band(n_segments, link_costs)
    previous = np.full(n_segments, -1)
    # A chain that begins here leaves out an end of the path, unless this is the first segment.
    cost = np.r_[0.0, np.full(n_segments - 1, end_cost)]
    value = length - cost
    for i in range(1, n_segments):
        first = max(0, i - _LOOK_BACK)
        continued = value[first:i] - link[i, first - i :]
        best = int(np.argmax(continued))
        if continued[best] > -end_cost:
            previous[i] = first + best
            value[i] = length[i] + continued[best]
            cost[i] = cost[first + best] + value[first + best] - continued[best]
    # A chain that stops before the last segment leaves out an end of the path.
    value[:-1], cost[:-1] = value[:-1] - end_cost, cost[:-1] + end_cost
    chosen = np.zeros(n_frames, dtype=bool)
    last = i = int(np.argmax(value))
    while i >= 0:
        chosen[starts[i] : stops[i]] = True
        i = int(previous[i])
    return chosen, float(cost[last])


def _band(n_segments: int, link_costs: Callable[[Ints, Ints], Floats]) -> Floats:
    """Return the costs (S, 40) of the links to each segment from the 40 before it; infinite before the first one."""
    costs = np.full((n_segments, _LOOK_BACK), np.inf)
    for low in range(0, n_segments, _AT_ONCE):
        later = np.arange(low, min(low + _AT_ONCE, n_segments))[:, None]
        earlier = later + np.arange(-_LOOK_BACK, 0)
        costs[later[:, 0]] = np.where(earlier >= 0, link_costs(later + 0 * earlier, np.maximum(earlier, 0)), np.inf)
    return costs
