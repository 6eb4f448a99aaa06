"""Distances between markers and their variation over a take: means or medians over evenly spaced frames."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced
from mocapclean.numerics.robust import MAD_TO_SD, nan_median

_CHUNK = 512  # frames whose distances are in memory at a time; chosen for memory
_ROBUST_SAMPLE = 300  # most frames of robust distances; chosen for speed, more change no bone of the sample takes
_FEWEST_SHARED = 10  # frames in which both markers must be trusted for their distance to count; chosen by hand
_FEWEST_SHARED_PART = 0.25  # the same as a part of the frames, where these are fewer than 40; chosen by hand

_SD_SCALE = 10.0  # mm, SD of a distance below which partners count as equally rigid; chosen on takes of `bench trust`
_DISTANCE_SCALE = 50.0  # mm, distance below which partners count as equally near; chosen on the same takes
PARTNERS = 10  # most partners of a marker; chosen on the same takes


@dataclass(frozen=True)
class Rigidity:
    """Median and robust SD (M, M), mm, of the distances between markers.

    The SD is infinite for pairs that are trusted together in too few frames.
    """

    distance: Floats
    spread: Floats

    def partners(self, marker: int) -> tuple[Ints, Floats]:
        """Return the up to 10 markers most rigid with one marker, and their weights.

        A weight is 1 / (SD² + (10 mm)²) / (distance + 50 mm): near and rigid partners weigh most.
        """
        weights = 1.0 / (self.spread[marker] ** 2 + _SD_SCALE**2) / (self.distance[marker] + _DISTANCE_SCALE)
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
    frames = evenly_spaced(len(trusted), _ROBUST_SAMPLE)
    known = np.where(trusted[frames, :, None], positions[frames], np.nan)
    n_markers = positions.shape[1]
    distance, spread = np.zeros((n_markers, n_markers)), np.full((n_markers, n_markers), np.inf)
    for a in range(n_markers - 1):
        # Marker a and all markers after it
        offset = known[:, a + 1 :] - known[:, [a]]
        length = np.sqrt(np.einsum("fmc,fmc->fm", offset, offset))
        often = np.isfinite(length).sum(axis=0) >= min(fewest, len(frames))
        median = nan_median(length)
        deviation = MAD_TO_SD * nan_median(np.abs(length - median))
        distance[a, a + 1 :] = distance[a + 1 :, a] = np.where(often, median, 0.0)
        spread[a, a + 1 :] = spread[a + 1 :, a] = np.where(often, deviation, np.inf)
    return distance, spread


def mean_distances(positions: Floats, trusted: Bools, most: int) -> tuple[Floats, Floats]:
    """Return mean and SD (M, M) of all distances of positions (F, M, 3), mm.

    They are over the frames with both markers trusted (F, M) among ``most`` evenly spaced ones. Both are infinite for
    pairs that are trusted together in none of these.
    """
    frames = evenly_spaced(len(trusted), most)
    n_markers = trusted.shape[1]
    count, total, squares = np.zeros((3, n_markers, n_markers))
    for start in range(0, len(frames), _CHUNK):
        chosen = frames[start : start + _CHUNK]
        known = trusted[chosen]
        points = np.where(known[..., None], positions[chosen], 0.0)
        both = known[:, :, None] & known[:, None]
        distance = np.where(both, np.linalg.norm(points[:, :, None] - points[:, None], axis=-1), 0.0)
        count += both.sum(axis=0)
        total += distance.sum(axis=0)
        squares += np.square(distance).sum(axis=0)
    mean = total / np.maximum(count, 1.0)
    deviation = np.sqrt(np.maximum(squares / np.maximum(count, 1.0) - mean**2, 0.0))
    never = count == 0
    return np.where(never, np.inf, mean), np.where(never, np.inf, deviation)


def exact_pairs(deviation: Floats, largest: float) -> Bools:
    """Return the pairs of points (M, M) of which one is computed from the other: their distance never varies.

    deviation: (M, M) SD of the distances, mm, infinite where unknown. largest: mm, up to which it counts as none.
    Where every point has such a partner, none is returned: then the points are the joints of a skeleton, or simulated.
    """
    others = ~np.eye(len(deviation), dtype=bool)
    exact = (deviation <= largest) & others
    measured = (np.isfinite(deviation) & others).any(axis=1)
    return np.asarray(exact & ~exact[measured].any(axis=1).all(), dtype=bool)


def distances_of_each(positions: Floats, trusted: Bools, spaced: Callable[[Ints], Ints]) -> tuple[Floats, Floats]:
    """Return mean and variance (M, M) of the distances of each marker from all others, mm and mm².

    Row k is over frames that ``spaced`` chooses among those in which marker k is trusted (F, M). So a marker that is
    seldom trusted is measured on as many frames as the others. Both are infinite for pairs that are trusted together
    in fewer than 10 of these frames, or in fewer than a quarter of them where they are fewer than 40.
    """
    mean, variance = np.full((2, trusted.shape[1], trusted.shape[1]), np.inf)
    for marker in np.flatnonzero(trusted.any(axis=0)).tolist():
        frames = spaced(np.flatnonzero(trusted[:, marker]))
        both, offsets = trusted[frames], positions[frames] - positions[frames, marker, None]
        length, count = np.sqrt(np.square(offsets).sum(axis=2)), both.sum(axis=0)
        often = count >= min(_FEWEST_SHARED, len(frames) * _FEWEST_SHARED_PART)
        mean[marker, often] = np.sum(length[:, often], axis=0, where=both[:, often]) / count[often]
        squares = np.square(length[:, often] - mean[marker, often])
        variance[marker, often] = np.sum(squares, axis=0, where=both[:, often]) / count[often]
    return mean, variance
