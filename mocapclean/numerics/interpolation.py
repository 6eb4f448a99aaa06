"""Interpolation of each coordinate over time, from the trusted samples alone."""

import numpy as np
from scipy.interpolate import PchipInterpolator

from mocapclean.arrays import Bools, Floats


def linear(positions: Floats, trusted: Bools) -> Floats:
    """Fill positions (F, M, 3) linearly between trusted (F, M) samples; the ends hold the nearest trusted sample.

    A marker trusted nowhere becomes 0. Untrusted samples are not read.
    """
    filled = np.where(trusted[..., None], positions, 0.0)
    frames = np.arange(len(filled))
    for marker in np.flatnonzero(trusted.any(axis=0) & ~trusted.all(axis=0)):
        known = trusted[:, marker]
        for axis in range(3):
            filled[~known, marker, axis] = np.interp(frames[~known], frames[known], filled[known, marker, axis])
    return filled


def monotone(positions: Floats, trusted: Bools) -> Floats:
    """Fill positions (F, M, 3) by monotone piecewise cubics (PCHIP) through the trusted (F, M) samples.

    Samples outside the first and last trusted one, and markers trusted fewer than twice, become 0. Untrusted
    samples are not read. F. N. Fritsch, R. E. Carlson, 1980, doi:10.1137/0717021; the slopes are those of
    F. N. Fritsch, J. Butland, 1984, doi:10.1137/0905021.
    """
    filled = np.where(trusted[..., None], positions, 0.0)
    frames = np.arange(len(filled))
    for marker in np.flatnonzero((trusted.sum(axis=0) > 1) & ~trusted.all(axis=0)):
        known = np.flatnonzero(trusted[:, marker])
        inside = (frames > known[0]) & (frames < known[-1]) & ~trusted[:, marker]
        curve = PchipInterpolator(known, filled[known, marker])
        filled[inside, marker] = curve(frames[inside])
    return filled
