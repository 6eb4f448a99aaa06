"""Sliding windows that stay symmetric to the end."""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mocapclean.arrays import Floats


def median_mean(values: Floats, width: int) -> Floats:
    """The sliding median of values (n, d), then its sliding mean, over windows of ``width`` frames, made odd.

    Near the ends the windows shrink and stay symmetric, so nothing is delayed; the two end frames on each side, whose
    windows would hold three frames at most, keep their values.
    """
    return _slide(_slide(values, width, np.median), width, np.mean)


def _slide(values: Floats, width: int, of: Callable[..., Floats]) -> Floats:
    half, n = width // 2, len(values)
    found = values.copy()
    if n > 2 * half > 0:
        found[half : n - half] = of(sliding_window_view(values, 2 * half + 1, axis=0), axis=-1)
    for k in range(2, min(half, (n + 1) // 2)):
        found[k] = of(values[: 2 * k + 1], axis=0)
        found[n - 1 - k] = of(values[n - 1 - 2 * k :], axis=0)
    return found
