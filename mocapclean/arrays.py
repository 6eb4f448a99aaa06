"""Array types of the project, runs of True in masks, and evenly spaced frames."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]


def runs(mask: Bools) -> Ints:
    """Return the maximal runs of True in a mask (F,), as rows (start, stop), half open."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    return edges.reshape(-1, 2)


def column_runs(mask: Bools) -> Iterator[tuple[int, int, int]]:
    """Yield the runs of True in each column of a mask (F, M), as (column, start, stop), column by column."""
    for column in np.flatnonzero(mask.any(axis=0)):
        for start, stop in runs(mask[:, column]):
            yield int(column), int(start), int(stop)


def evenly_spaced(n: int, most: int) -> Ints:
    """Return at most ``most`` of the indices 0 .. n - 1, evenly spaced; all of them where there are no more."""
    return np.arange(n) if n <= most else np.linspace(0, n - 1, most).astype(np.intp)
