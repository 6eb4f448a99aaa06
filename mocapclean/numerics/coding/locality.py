"""Locality-constrained linear coding of vectors with holes."""

import numpy as np
from scipy.linalg.lapack import dposv

from mocapclean.arrays import Bools, Floats

_RIDGE = 1e-8


def affine_weights(covariance: Floats, ridge: Floats) -> Floats:
    """argmin wᵀ(C + diag(ridge))w subject to Σw = 1, for C (k, k) symmetric semidefinite and ridge (k,).

    To keep C regular, 1e-8 of its mean diagonal is added.
    """
    system = covariance.copy()
    diagonal = np.diag_indices(len(system))
    system[diagonal] += ridge + _RIDGE * np.trace(system) / len(system) + np.finfo(float).tiny
    _, weights, failed = dposv(system, np.ones(len(system)), lower=1)
    if failed:
        weights = np.linalg.lstsq(system, np.ones(len(system)), rcond=None)[0]
    normalised: Floats = weights / weights.sum()
    return normalised


def locality_ridge(distance: Floats, farthest: float, weight: float, bandwidth: float, exponent: int) -> Floats:
    """λ g^exponent (k,), g = exp((distance − farthest) / bandwidth), Z. Wang et al., 2016, eq. 6."""
    ridge: Floats = weight * np.exp(exponent * (distance - farthest) / bandwidth)
    return ridge


def reconstruct(
    atoms: Floats,
    points: Floats,
    observed: Bools,
    *,
    neighbours: int,
    weight: float,
    bandwidth: float,
    exponent: int,
) -> Floats:
    """Points (n, d) rebuilt from atoms (K, d) that lie near what is observed (n, d) of them.

    Each is Σ w_k d_k with w = argmin ‖x − Σ w_k d_k‖² + λ Σ g_k^exponent w_k² over the observed entries, Σw = 1, among
    the ``neighbours`` nearest atoms (0: all); the unobserved entries are not read. ``bandwidth`` 0 is the fast version
    of J. Wang et al., 2010, doi:10.1109/CVPR.2010.5540018: g = 1 and λ in units of the trace. O(K d + k² (k + m)) for
    one point, m the fewer of its observed and unobserved entries; the Gram matrix of the atoms is formed once.
    """
    seen = np.where(observed, points, 0.0)
    products = seen @ atoms.T
    squares = observed.astype(float) @ (atoms**2).T
    norms = np.einsum("nd,nd->n", seen, seen)
    distance = np.sqrt(np.maximum(squares - 2.0 * products + norms[:, None], 0.0))
    n_near = min(neighbours, len(atoms)) or len(atoms)
    near = np.sort(np.argpartition(distance, n_near - 1, axis=1)[:, :n_near], axis=1)
    gram = atoms @ atoms.T
    rebuilt = np.empty_like(seen)
    for row, chosen in enumerate(near):
        local, visible = atoms[chosen], observed[row]
        if 2 * np.count_nonzero(visible) > len(visible):
            hidden = local[:, ~visible]
            pull = products[row, chosen]
            covariance = gram[np.ix_(chosen, chosen)] - hidden @ hidden.T - pull[:, None] - pull + norms[row]
        else:
            apart = local[:, visible] - seen[row, visible]
            covariance = apart @ apart.T
        if bandwidth:
            ridge = locality_ridge(distance[row, chosen], distance[row].max(), weight, bandwidth, exponent)
        else:
            ridge = np.full(n_near, weight * np.trace(covariance))
        rebuilt[row] = affine_weights(covariance, ridge) @ local
    return rebuilt
