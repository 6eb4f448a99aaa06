"""Runs of True in boolean arrays: gaps, segments and spans are all this."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


def runs(mask: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The maximal runs of True in a mask (F,), as rows (start, stop), half open."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False]))))
    return edges.reshape(-1, 2)


def column_runs(mask: NDArray[np.bool_]) -> Iterator[tuple[int, int, int]]:
    """The runs of True in each column of a mask (F, M), as (column, start, stop), column by column."""
    for column in np.flatnonzero(mask.any(axis=0)):
        for start, stop in runs(mask[:, column]):
            yield int(column), int(start), int(stop)
