"""Interpolation of each coordinate over time, from trusted samples alone."""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints


def linear(positions: Floats, trusted: Bools, frames: Ints | None = None) -> Floats:
    """Return positions (F, M, 3) with untrusted samples interpolated linearly between trusted (F, M) samples.

    Before the first and after the last trusted sample of a marker, that sample is repeated. A marker without trusted
    samples becomes 0. Untrusted samples are not read. frames: (F,), their times; one apart if None is given.
    """
    filled = np.where(trusted[..., None], positions, 0.0)
    frames = np.arange(len(filled)) if frames is None else frames
    for marker in np.flatnonzero(trusted.any(axis=0) & ~trusted.all(axis=0)):
        known = trusted[:, marker]
        for axis in range(3):
            filled[~known, marker, axis] = np.interp(frames[~known], frames[known], filled[known, marker, axis])
    return filled


def monotone(positions: Floats, trusted: Bools) -> Floats:
    """Return positions (F, M, 3) with untrusted samples on monotone piecewise cubics through trusted (F, M) samples.

    The cubics are those of PCHIP: F. N. Fritsch, R. E. Carlson, 1980, doi:10.1137/0717021; their slopes those of
    F. N. Fritsch, J. Butland, 1984, doi:10.1137/0905021. Samples before the first and after the last trusted one
    become 0, and so do markers with fewer than two trusted samples. Untrusted samples are not read.
    """
    from scipy.interpolate import PchipInterpolator  # few methods need it, and it is long to load

    filled = np.where(trusted[..., None], positions, 0.0)
    frames = np.arange(len(filled))
    for marker in np.flatnonzero((trusted.sum(axis=0) > 1) & ~trusted.all(axis=0)):
        known = np.flatnonzero(trusted[:, marker])
        inside = (frames > known[0]) & (frames < known[-1]) & ~trusted[:, marker]
        curve = PchipInterpolator(known, filled[known, marker])
        filled[inside, marker] = curve(frames[inside])
    return filled
