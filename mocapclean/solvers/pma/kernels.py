"""Likelihoods and regressions from samples, by Gaussian kernels."""

import numpy as np

from mocapclean.arrays import Floats

_DEVIATION_OF_NORMAL = 0.6745  # the median absolute deviation of a normal distribution, in standard deviations
_LEAST_BANDWIDTH = 1e-6  # in sizes of the samples; no sweep was kept
_LEAST_EXPONENT = -600.0  # 1e-261, far below every weight that counts; exponentials that underflow are slow


class Density:
    """The density of samples (N,) by a Gaussian kernel, as a share of the kernel's peak.

    The bandwidth is Silverman's for a normal density, s (4 / 3N)^(1/5). s comes from the median absolute deviation,
    which a few outliers do not move. The bandwidth is at least a millionth of the samples' size. B. W. Silverman, 1986,
    Density estimation, eq. 3.28.
    """

    def __init__(self, samples: Floats) -> None:
        median = np.median(samples)
        deviation = np.median(np.abs(samples - median)) / _DEVIATION_OF_NORMAL or np.ptp(samples)
        silverman = deviation * (4.0 / (3.0 * len(samples))) ** 0.2
        bandwidth = max(silverman, _LEAST_BANDWIDTH * float(np.abs(samples).max())) or 1.0
        self._samples, self._bandwidth = samples, bandwidth

    def at(self, values: Floats) -> Floats:
        """Return the density (n,) at values (n,)."""
        # exp(−½ ((v − s) / b)²)
        exponents = values[:, None] - self._samples
        exponents /= self._bandwidth
        np.square(exponents, out=exponents)
        exponents *= -0.5
        np.maximum(exponents, _LEAST_EXPONENT, out=exponents)
        density: Floats = np.exp(exponents, out=exponents).mean(axis=1)
        return density


def kernel_regression(features: Floats, values: Floats, queries: Floats, spread: float) -> Floats:
    """Return means (n, d) of values (N, d), weighted by the nearness of their features (N, k) to the queries (n, k).

    A weight falls to one half at a distance of ``spread``. Far from all features the nearest one has all the weight.
    D. F. Specht, 1991, A general regression neural network, doi:10.1109/72.97934.
    """
    squares = np.zeros((len(queries), len(features)))
    for query, feature in zip(queries.T, features.T, strict=True):
        offsets = query[:, None] - feature
        squares += np.square(offsets, out=offsets)
    # The nearest features keep a weight of 1, so that no sum of weights underflows.
    squares -= squares.min(axis=1, keepdims=True)
    squares *= -np.log(2.0) / spread**2
    weights = np.exp(squares, out=squares)
    means: Floats = weights @ values / weights.sum(axis=1, keepdims=True)
    return means
