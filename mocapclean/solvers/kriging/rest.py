"""Whether a marker is at rest on both sides of a stretch, and at one place: windows at rest resemble gaps at rest."""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints

REST_SHARE = 0.5
"""Of the rigidity parameter, the RMS distance of samples from their mean up to which they are at rest: 1 mm.

Chosen by hand, no sweep was kept.
"""
NOISE_FACTOR = 2.0  # times the marker's noise, added to it; chosen by hand
QUARTILE_OF_NOISE = 1.101  # lower quartile of the length of a standard normal vector in space, √0.25-quantile of χ²₃


class Rest:
    """Whether a marker rests at one place in the frames beside a stretch.

    The samples on both sides are pooled. Their RMS distance from their mean has a limit, which grows with the noise.
    """

    def __init__(self, track: Floats, known: Bools, rigidity: float) -> None:
        """Take the track (F, 3) of a marker, mm, which is read where it is known (F,)."""
        centred = np.where(known[:, None], track - track[known].mean(axis=0), 0.0)
        # Prefix sums: entry b less entry a is the sum over the frames a to b - 1.
        self._sums = np.concatenate([np.zeros((1, 3)), np.cumsum(centred, axis=0)])
        self._squares = np.append(0.0, np.cumsum(np.square(centred).sum(axis=1)))
        noise = NOISE_FACTOR * noise_of(track, known)
        self._largest = (REST_SHARE * rigidity) ** 2 + 3.0 * noise**2

    def are_at_rest(self, samples: Floats) -> bool:
        """Return whether samples (n, 3) beside a gap are at rest, mm; False without any."""
        return bool(len(samples) and np.square(samples - samples.mean(axis=0)).sum(axis=1).mean() <= self._largest)

    def at(self, starts: Ints, length: int, edges: tuple[int, int]) -> Bools:
        """Return whether (n,) the marker rests beside stretches; the arguments are those of ``variance``."""
        return np.asarray(self.variance(starts, length, edges) <= self._largest, dtype=bool)

    def variance(self, starts: Ints, length: int, edges: tuple[int, int]) -> Floats:
        """Return the mean square distance (n,) of the samples beside stretches from their mean, mm².

        The stretches have ``length`` frames from ``starts`` (n,). edges: frames before and after a stretch that count,
        in all of which the marker is known.
        """
        before, after = edges
        spans = ((starts - before, starts), (starts + length, starts + length + after))
        total = sum(self._sums[high] - self._sums[low] for low, high in spans)
        squares = sum(self._squares[high] - self._squares[low] for low, high in spans)
        count = max(before + after, 1)
        return np.asarray(np.maximum(squares / count - np.square(total / count).sum(axis=-1), 0.0), dtype=np.float64)


def noise_of(track: Floats, known: Bools) -> float:
    """Return the SD of the noise of a coordinate, mm, from the lower quartile of second differences; 0 without any.

    The second difference of white noise has a variance of 6 σ². In its lower quartile a marker moves least.
    """
    inside = known[:-2] & known[1:-1] & known[2:]
    if not inside.any():
        return 0.0
    bends = np.linalg.norm(track[:-2] - 2.0 * track[1:-1] + track[2:], axis=1)[inside]
    return float(np.quantile(bends, 0.25) / (np.sqrt(6.0) * QUARTILE_OF_NOISE))
