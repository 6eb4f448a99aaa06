"""How far markers are from each other, and how much that varies."""

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats

_CHUNK = 512  # frames whose distances are held at a time


def even(n: int, most: int) -> NDArray[np.intp]:
    """At most ``most`` of the indices 0 .. n − 1, evenly spread; all where there are no more."""
    return np.arange(n) if n <= most else np.linspace(0, n - 1, most).astype(np.intp)


def pair_distances(positions: Floats, trusted: Bools, most: int) -> tuple[Floats, Floats]:
    """The mean (M, M) and the standard deviation (M, M) of the distances of positions (F, M, 3).

    Over the frames in which both are trusted (F, M), at most ``most``, evenly spread over the take. Pairs that no such
    frame has are infinitely far and infinitely loose.
    """
    frames = even(len(trusted), most)
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
