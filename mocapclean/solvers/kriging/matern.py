"""The Matérn covariance of smoothness 5/2, and simple kriging weights over time computed with it.

    k(d) = (1 + s + s²/3) exp(−s),   s = √5 |d| / ℓ

A process with this covariance has two derivatives, so its conditional mean joins the known values without a corner.
B. Matérn, 1960; M. L. Stein, 1999, doi:10.1007/978-1-4612-1494-6.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Floats, Ints


def matern(distances: NDArray[Any], length: float | Floats) -> Floats:
    """Return the covariance at distances of any shape, in the unit of ``length`` (ℓ); 1 at distance 0."""
    scaled = np.abs(distances) * (np.sqrt(5.0) / length)
    covariance: Floats = (1.0 + scaled + scaled * scaled / 3.0) * np.exp(-scaled)
    return covariance


def bridges(known: Ints, wanted: Ints, lengths: Floats, noises: Floats) -> tuple[Floats, Floats]:
    """Return the simple kriging weights (P, K, n, k) of values at known times (P, k) for wanted times (P, n), and the
    variances.

    The second array is the conditional variance (P, K, n), as a share of the variance of the process. There are K
    processes, with ``lengths`` (K,) and ``noises`` (K,): the variance of the errors of the known values, as the same
    share. Times are whole numbers. Without known times the weights are empty and the variance is 1.
    """
    if not known.size:
        shape = len(wanted), len(lengths), wanted.shape[1]
        return np.zeros((*shape, 0)), np.ones(shape)
    own, across = np.abs(known[:, :, None] - known[:, None]), np.abs(known[:, :, None] - wanted[:, None])
    # Times are whole, so the covariance is computed once for each distance and then looked up.
    covariance = matern(np.arange(max(own.max(), across.max()) + 1), lengths[:, None])
    # weights = (K + noise I)⁻¹ k,   variance = 1 - kᵀ (K + noise I)⁻¹ k
    systems = covariance[:, own].swapaxes(0, 1) + noises[:, None, None] * np.eye(known.shape[1])
    right = covariance[:, across].swapaxes(0, 1)
    solved = np.linalg.solve(systems, right)
    variance = 1.0 - np.einsum("pgkn,pgkn->pgn", right, solved)
    return np.asarray(solved.swapaxes(2, 3), dtype=np.float64), np.maximum(variance, 0.0)
