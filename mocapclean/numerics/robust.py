"""Medians and quantiles of values with NaN, which a few outliers do not move."""

import numpy as np

from mocapclean.arrays import Floats, Ints

MAD_TO_SD = 1.4826  # the SD of a normal distribution over its median absolute deviation, 1 / Φ⁻¹(3/4)


def nan_median(values: Floats, axis: int = 0) -> Floats:
    """Return the median along one axis over the entries that are not NaN; NaN where all entries are NaN.

    The result is that of numpy.nanmedian, which takes about five times as long on arrays of marker distances.
    """
    # Sorting moves NaN to the end; the middle of the finite part is one entry or the mean of two.
    ordered = np.sort(values, axis=axis)
    number = values.shape[axis]
    if number and not np.isnan(ordered.take(-1, axis)).any():
        return np.asarray((ordered.take((number - 1) // 2, axis) + ordered.take(number // 2, axis)) / 2.0)
    count = np.sum(~np.isnan(values), axis=axis, keepdims=True)
    low, high = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[axis] - 1)
    middle = np.take_along_axis(ordered, low, axis) + np.take_along_axis(ordered, high, axis)
    return np.asarray(middle.squeeze(axis) / 2.0)


def nan_quantiles(values: Floats, shares: tuple[float, ...]) -> Floats:
    """Return the quantiles (len(shares), n) of each column of values (F, n) over its entries that are not NaN.

    A quantile between two entries is the lower of them. Columns without a finite entry have NaN.
    """
    return ordered_quantiles(np.sort(values, axis=0), np.sum(~np.isnan(values), axis=0), shares)


def ordered_quantiles(ordered: Floats, count: Ints, shares: tuple[float, ...]) -> Floats:
    """Return ``nan_quantiles`` of columns (F, n) in ascending order, of which only the first ``count`` (n,) count.

    Columns with a count of 0 have NaN.
    """
    rows = [np.floor(share * np.maximum(count - 1, 0)).astype(np.intp) for share in shares]
    quantiles = np.stack([np.take_along_axis(ordered, row[None], axis=0)[0] for row in rows])
    return np.asarray(np.where(count > 0, quantiles, np.nan))


def median(values: Floats) -> float:
    """Return the median of all values; NaN if one of them is NaN, or without any.

    NumPy's own function loads masked arrays with its first call, which takes longer than a small take.
    """
    ordered = np.sort(values, axis=None)
    if not ordered.size or np.isnan(ordered[-1]):
        return float("nan")
    return float((ordered[(ordered.size - 1) // 2] + ordered[ordered.size // 2]) / 2.0)


def quantile(values: Floats, share: float) -> float:
    """Return a quantile of values (n,), n > 0, interpolated linearly between two of them, as ``numpy.quantile`` does.

    NumPy's own function loads masked arrays too.
    """
    place = share * (len(values) - 1)
    low = int(place)
    high = min(low + 1, len(values) - 1)
    below, above = (float(value) for value in np.partition(values, (low, high))[[low, high]])
    rest = place - low
    # From the nearer of the two, so that the result is monotone in the share.
    return below + rest * (above - below) if rest < 0.5 else above - (1.0 - rest) * (above - below)
