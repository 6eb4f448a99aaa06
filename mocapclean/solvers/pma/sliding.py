"""Sliding medians and means over windows that shrink at the ends and stay symmetric."""

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mocapclean.arrays import Floats


def median_mean(values: Floats, width: int) -> Floats:
    """Return the sliding median of values (n, d), then its sliding mean, over windows of ``width`` frames, made odd.

    Near the ends the windows shrink and stay symmetric, so nothing is delayed. The two end frames on each side, whose
    windows would hold three frames at most, keep their values.
    """
    return _slide(_slide(values, width, np.median), width, np.mean)


def _slide(values: Floats, width: int, statistic: Callable[..., Floats]) -> Floats:
    """Return a statistic of values (n, d) over sliding windows."""
    half, n = width // 2, len(values)
    smoothed = values.copy()
    if n > 2 * half > 0:
        smoothed[half : n - half] = statistic(sliding_window_view(values, 2 * half + 1, axis=0), axis=-1)
    for k in range(2, min(half, (n + 1) // 2)):
        smoothed[k] = statistic(values[: 2 * k + 1], axis=0)
        smoothed[n - 1 - k] = statistic(values[n - 1 - 2 * k :], axis=0)
    return smoothed
