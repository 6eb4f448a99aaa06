"""Distances between markers, and how much each varies over a take: means or medians, over frames spread over it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced
from mocapclean.numerics.robust import nan_median

_CHUNK = 512  # frames whose distances are held in memory at a time
_SAMPLE = 300  # frames that robust distances are taken over; chosen for speed, more change no bone of the sample takes
_TO_SD = 1.4826  # the SD of a normal distribution over its median absolute deviation
_FEWEST_SHARED = 10  # frames in which both markers must be seen for a distance to count
_FEWEST_PAIR = 0.25  # the same as a share, where fewer frames were sampled

_SLACK = 10.0  # mm, SD of a distance below which partners count as equally rigid; chosen on the takes of `bench trust`
_NEAR = 50.0  # mm, distance below which partners count as equally near; chosen on the same takes
PARTNERS = 10  # most partners of a marker; chosen on the same takes


@dataclass(frozen=True)
class Rigidity:
    """Median and robust SD (M, M), mm, of the distances between markers; the SD is infinite for pairs seldom seen."""

    distance: Floats
    spread: Floats

    def partners(self, marker: int) -> tuple[Ints, Floats]:
        """Return the up to 10 markers most rigid with one, and their weights.

        A weight is 1 / (SD² + slack²) / (distance + 50 mm): near and rigid partners weigh most.
        """
        weights = 1.0 / (self.spread[marker] ** 2 + _SLACK**2) / (self.distance[marker] + _NEAR)
        weights[marker] = 0.0
        order = np.argsort(-weights, kind="stable")[:PARTNERS]
        chosen = order[weights[order] > 0]
        return chosen, weights[chosen]


def rigidity(positions: Floats, trusted: Bools) -> Rigidity:
    """Return the rigidity of all pairs of markers, from positions (F, M, 3) and trust (F, M)."""
    return Rigidity(*robust_distances(positions, trusted, _FEWEST_SHARED))


def robust_distances(positions: Floats, trusted: Bools, fewest: int) -> tuple[Floats, Floats]:
    """Return median and robust SD (M, M) of all distances of positions (F, M, 3), mm, over up to 300 frames.

    The robust SD is 1.4826 times the median absolute deviation. It is infinite, and the median 0, for pairs that are
    trusted (F, M) together in fewer than ``fewest`` of these frames.
    """
    frames = evenly_spaced(len(trusted), _SAMPLE)
    known = np.where(trusted[frames, :, None], positions[frames], np.nan)
    n_markers = positions.shape[1]
    distance, spread = np.zeros((n_markers, n_markers)), np.full((n_markers, n_markers), np.inf)
    for a in range(n_markers - 1):
        offset = known[:, a + 1 :] - known[:, [a]]
        apart = np.sqrt(np.einsum("fmc,fmc->fm", offset, offset))
        seen = np.isfinite(apart).sum(axis=0) >= min(fewest, len(frames))
        middle = nan_median(apart)
        deviation = _TO_SD * nan_median(np.abs(apart - middle))
        distance[a, a + 1 :] = distance[a + 1 :, a] = np.where(seen, middle, 0.0)
        spread[a, a + 1 :] = spread[a + 1 :, a] = np.where(seen, deviation, np.inf)
    return distance, spread


def mean_distances(positions: Floats, trusted: Bools, most: int) -> tuple[Floats, Floats]:
    """Return mean and SD (M, M) of all distances of positions (F, M, 3), mm.

    Over the frames in which both are trusted (F, M), at most ``most``, evenly spread over the take. Both are infinite
    for pairs that no such frame has.
    """
    frames = evenly_spaced(len(trusted), most)
    n_markers = trusted.shape[1]
    count, total, squares = np.zeros((3, n_markers, n_markers))
    for start in range(0, len(frames), _CHUNK):
        chosen = frames[start : start + _CHUNK]
        seen = trusted[chosen]
        points = np.where(seen[..., None], positions[chosen], 0.0)
        both = seen[:, :, None] & seen[:, None]
        distance = np.where(both, np.linalg.norm(points[:, :, None] - points[:, None], axis=-1), 0.0)
        count += both.sum(axis=0)
        total += distance.sum(axis=0)
        squares += np.square(distance).sum(axis=0)
    mean = total / np.maximum(count, 1.0)
    deviation = np.sqrt(np.maximum(squares / np.maximum(count, 1.0) - mean**2, 0.0))
    apart = count == 0
    return np.where(apart, np.inf, mean), np.where(apart, np.inf, deviation)


def distances_of_each(positions: Floats, trusted: Bools, spaced: Callable[[Ints], Ints]) -> tuple[Floats, Floats]:
    """Return mean and variance (M, M) of the distances of each marker from all others, mm and mm².

    ``spaced`` chooses among the frames in which a marker is trusted (F, M), so that markers that are seldom seen are
    judged on as many frames as the others. Row k is over the frames of marker k. Both are infinite for pairs that are
    seen together in fewer than 10 of these frames, or a quarter of fewer frames.
    """
    mean, variance = np.full((2, trusted.shape[1], trusted.shape[1]), np.inf)
    for marker in np.flatnonzero(trusted.any(axis=0)).tolist():
        frames = spaced(np.flatnonzero(trusted[:, marker]))
        both, offsets = trusted[frames], positions[frames] - positions[frames, marker, None]
        apart, count = np.sqrt(np.square(offsets).sum(axis=2)), both.sum(axis=0)
        near = count >= min(_FEWEST_SHARED, len(frames) * _FEWEST_PAIR)
        mean[marker, near] = np.sum(apart[:, near], axis=0, where=both[:, near]) / count[near]
        spread = np.square(apart[:, near] - mean[marker, near])
        variance[marker, near] = np.sum(spread, axis=0, where=both[:, near]) / count[near]
    return mean, variance
