"""Likelihoods and regressions from samples, by Gaussian kernels."""

import numpy as np

from mocapclean.arrays import Floats

_DEVIATION_OF_NORMAL = 0.6745  # the median absolute deviation of a normal distribution, in standard deviations
_LEAST_BANDWIDTH = 1e-6  # in sizes of the samples; no sweep was kept


def likelihood(samples: Floats, values: Floats) -> Floats:
    """Return the density (n,) at values (n,) of samples (N,) by a Gaussian kernel, as a share of the kernel's peak.

    The bandwidth is Silverman's for a normal density, s (4 / 3N)^(1/5). s comes from the median absolute deviation,
    which a few outliers do not move. The bandwidth is at least a millionth of the samples' size. B. W. Silverman, 1986,
    Density estimation, eq. 3.28.
    """
    median = np.median(samples)
    deviation = np.median(np.abs(samples - median)) / _DEVIATION_OF_NORMAL or np.ptp(samples)
    silverman = deviation * (4.0 / (3.0 * len(samples))) ** 0.2
    bandwidth = max(silverman, _LEAST_BANDWIDTH * float(np.abs(samples).max())) or 1.0
    density: Floats = np.exp(-0.5 * np.square((values[:, None] - samples) / bandwidth)).mean(axis=1)
    return density


def kernel_regression(features: Floats, values: Floats, queries: Floats, spread: float) -> Floats:
    """Return means (n, d) of values (N, d), weighted by the nearness of their features (N, k) to the queries (n, k).

    A weight falls to one half at a distance of ``spread``. Far from all features the nearest one has all the weight.
    D. F. Specht, 1991, A general regression neural network, doi:10.1109/72.97934.
    """
    squares = np.square(queries[:, None] - features).sum(axis=-1)
    # The nearest features keep a weight of 1, so that no sum of weights underflows.
    squares -= squares.min(axis=1, keepdims=True)
    weights = np.exp(-np.log(2.0) / spread**2 * squares)
    means: Floats = weights @ values / weights.sum(axis=1, keepdims=True)
    return means
