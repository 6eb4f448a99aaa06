"""How a marker moves beside a stretch: whether it rests before it and after it, and comes back to one place.

Windows resemble a gap where these three are equal.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.robust import quantile

REST_SHARE = 0.5
"""Of the rigidity parameter, the RMS distance of samples from their mean up to which they are at rest: 1 mm.

Chosen by hand, no sweep was kept.
"""
NOISE_FACTOR = 2.0  # times the marker's noise, added to it; chosen by hand
REST_EDGE = 1.0 / 60.0
"""Time beside a stretch, s, in which it is judged whether a marker rests.

It is short, so that a ball at rest until its throw counts as at rest. Chosen by hand, no sweep was kept.
"""
QUARTILE_OF_NOISE = 1.101  # lower quartile of the length of a standard normal vector in space, √0.25-quantile of χ²₃


class Rest:
    """How a marker moves in the frames beside stretches, from running sums over its track."""

    def __init__(self, track: Floats, known: Bools, rate: float, rigidity: float) -> None:
        """Take the track (F, 3) of a marker, mm, which is read where it is known (F,), and the rate, Hz."""
        centred = np.where(known[:, None], track - track[known].mean(axis=0), 0.0)
        # Entry b less entry a is the sum over the frames a to b - 1.
        self._sums = np.concatenate([np.zeros((1, 3)), np.cumsum(centred, axis=0)])
        self._squares = np.append(0.0, np.cumsum(np.square(centred).sum(axis=1)))
        self._largest = (REST_SHARE * rigidity) ** 2 + 3.0 * (NOISE_FACTOR * noise_of(track, known)) ** 2
        self.edge = max(2, round(REST_EDGE * rate))

    def kind(self, before: Floats, after: Floats) -> int:
        """Return how the marker moves beside a gap, from the samples (n, 3) before and after it, nearest first, mm.

        Bits: at rest before, at rest after, at one place on both sides. A side without samples counts as at rest.
        """
        sides = before[: self.edge], after[: self.edge]
        flags = [_variance(samples) <= self._largest for samples in (*sides, np.concatenate(sides))]
        return int(np.dot(flags, (1, 2, 4)))

    def kinds(self, starts: Ints, length: int, edges: tuple[int, int]) -> Ints:
        """Return how (n,) the marker moves beside stretches of ``length`` frames from ``starts`` (n,).

        edges: frames before and after a stretch in all of which the marker is known; 0 for a side that does not count.
        """
        before, after = (min(edge, self.edge) for edge in edges)
        sides = (starts - before, starts), (starts + length, starts + length + after)
        flags = [self._variances(spans) <= self._largest for spans in (sides[:1], sides[1:], sides)]
        return np.asarray(np.dot(np.stack(flags, axis=1), (1, 2, 4)), dtype=np.intp)

    def variances(self, starts: Ints, length: int, edges: tuple[int, int]) -> Floats:
        """Return the mean square distance (n,) of the samples on both sides from their mean, mm²; as in ``kinds``."""
        before, after = (min(edge, self.edge) for edge in edges)
        return self._variances(((starts - before, starts), (starts + length, starts + length + after)))

    def variance(self, before: Floats, after: Floats) -> float:
        """Return the mean square distance of samples on both sides of a gap from their mean, mm²; as in ``kind``."""
        return _variance(np.concatenate([before[: self.edge], after[: self.edge]]))

    def _variances(self, spans: tuple[tuple[Ints, Ints], ...]) -> Floats:
        """Return the mean square distance (n,), mm², of the samples in some spans (low, high) from their mean."""
        count = sum(high - low for low, high in spans)
        total = sum(self._sums[high] - self._sums[low] for low, high in spans)
        squares = sum(self._squares[high] - self._squares[low] for low, high in spans)
        count = np.maximum(count, 1)
        mean = total / count[:, None]
        return np.asarray(np.maximum(squares / count - np.square(mean).sum(axis=1), 0.0), dtype=np.float64)


def _variance(samples: Floats) -> float:
    """Return the mean square distance of samples (n, 3) from their mean, mm²; 0 without any."""
    return float(np.square(samples - samples.mean(axis=0)).sum(axis=1).mean()) if len(samples) else 0.0


def noise_of(track: Floats, known: Bools) -> float:
    """Return the SD of the noise of a coordinate, mm, from the lower quartile of second differences; 0 without any.

    The second difference of white noise has a variance of 6 σ². In its lower quartile a marker moves least.
    """
    inside = known[:-2] & known[1:-1] & known[2:]
    if not inside.any():
        return 0.0
    bends = np.linalg.norm(track[:-2] - 2.0 * track[1:-1] + track[2:], axis=1)[inside]
    return float(quantile(bends, 0.25) / (np.sqrt(6.0) * QUARTILE_OF_NOISE))
