"""Smoothing over time by a Gaussian."""

from mocapclean.arrays import Floats


def smoothed(values: Floats, sigma: float) -> Floats:
    """Return values (n, ...) convolved along their first axis with a Gaussian of this SD, in rows, cut off at 4 SD.

    The values are reflected at both ends.
    """
    from scipy.ndimage import gaussian_filter1d  # long to load, and the help of the commands needs the callers

    found: Floats = gaussian_filter1d(values, sigma, axis=0)
    return found
