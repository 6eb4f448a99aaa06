"""Gaussian kernels: likelihoods and regressions from samples."""

import numpy as np

from mocapclean.arrays import Floats

_NORMAL = 0.6745  # of a standard deviation: the median distance from the median
_NARROW = 1e-6


def likelihood(samples: Floats, values: Floats) -> Floats:
    """The density (n,) at values (n,) of samples (N,) by a Gaussian kernel, as a part of the kernel's own peak.

    The bandwidth is Silverman's for a normal density, s (4 / 3N)^(1/5), with s from the median distance from the
    median, which a few wild samples do not move; at least a millionth of the samples' size. B. W. Silverman, 1986,
    Density estimation, eq. 3.28.
    """
    middle = np.median(samples)
    spread = np.median(np.abs(samples - middle)) / _NORMAL or np.ptp(samples)
    width = max(spread * (4.0 / (3.0 * len(samples))) ** 0.2, _NARROW * float(np.abs(samples).max())) or 1.0
    found: Floats = np.exp(-0.5 * np.square((values[:, None] - samples) / width)).mean(axis=1)
    return found


def kernel_regression(features: Floats, values: Floats, queries: Floats, spread: float) -> Floats:
    """Means (n, d) of values (N, d), weighted by how near their features (N, k) are to the queries (n, k).

    A weight falls to one half at a distance of ``spread``. Far from all features the nearest one counts alone.
    D. F. Specht, 1991, A general regression neural network, doi:10.1109/72.97934.
    """
    squares = np.square(queries[:, None] - features).sum(axis=-1)
    squares -= squares.min(axis=1, keepdims=True)
    weights = np.exp(-np.log(2.0) / spread**2 * squares)
    found: Floats = weights @ values / weights.sum(axis=1, keepdims=True)
    return found
