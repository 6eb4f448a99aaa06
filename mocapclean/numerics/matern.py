"""Kriging over time with the Matérn covariance of smoothness 5/2.

    k(d) = (1 + s + s²/3) exp(−s),   s = √5 |d| / ℓ

A process with it has two derivatives, so its conditional mean joins what it is given without a corner. B. Matérn, 1960;
M. L. Stein, 1999, doi:10.1007/978-1-4612-1494-6.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def matern(distances: NDArray[Any], length: float | Floats) -> Floats:
    """The covariance at distances of any shape, in the unit of ``length`` (ℓ); 1 at distance 0."""
    scaled = np.abs(distances) * (np.sqrt(5.0) / length)
    covariance: Floats = (1.0 + scaled + scaled * scaled / 3.0) * np.exp(-scaled)
    return covariance


def bridge(known: Floats, wanted: Floats, length: float, noise: float) -> tuple[Floats, Floats]:
    """The weights (n, k) of values at times ``known`` (k,) in the conditional mean at times ``wanted`` (n,).

    And the conditional variance (n,), as a share of the process's own. noise: the variance of the values' own errors,
    as a share of it too. Without known times the weights are empty and the variance is 1.
    """
    if not len(known):
        return np.zeros((len(wanted), 0)), np.ones(len(wanted))
    own = matern(known[:, None] - known, length)
    own[np.diag_indices_from(own)] += noise
    across = matern(known[:, None] - wanted, length)
    weights = np.linalg.solve(own, across)
    variance = 1.0 - np.einsum("kn,kn->n", across, weights)
    return np.asarray(weights.T, dtype=np.float64), np.maximum(variance, 0.0)
