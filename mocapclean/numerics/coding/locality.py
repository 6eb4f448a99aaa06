"""Locality-constrained linear coding of vectors with unobserved entries."""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats

# Ridge that keeps a covariance regular, relative to its mean diagonal; chosen by hand.
_RIDGE = 1e-8


def affine_weights(covariance: Floats, ridge: Floats) -> Floats:
    """Return argmin wᵀ(C + diag(ridge))w subject to Σw = 1, for C (k, k) symmetric semidefinite and ridge (k,).

    To keep C regular, 1e-8 of its mean diagonal is added.
    """
    # w is proportional to (C + diag(ridge))⁻¹ 1
    system = covariance.copy()
    diagonal = np.diag_indices(len(system))
    system[diagonal] += ridge + _RIDGE * np.trace(system) / len(system) + np.finfo(float).tiny
    _, weights, failed = scipy.linalg.lapack.dposv(system, np.ones(len(system)), lower=1)
    if failed:
        weights = np.linalg.lstsq(system, np.ones(len(system)), rcond=None)[0]
    normalised: Floats = weights / weights.sum()
    return normalised


def locality_ridge(distance: Floats, farthest: float, weight: float, bandwidth: float, exponent: int) -> Floats:
    """Return λ g^exponent (k,), g = exp((distance − farthest) / bandwidth); λ is ``weight``.

    Z. Wang et al., 2016, eq. 6.
    """
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
    """Return points (n, d) reconstructed from atoms (K, d) that are near their observed (n, d) entries.

    Each is Σ w_k d_k with w = argmin ‖x − Σ w_k d_k‖² + λ Σ g_k^exponent w_k² over the observed entries, Σw = 1, among
    the ``neighbours`` nearest atoms (0: all). Unobserved entries are not read. ``bandwidth`` 0 is the fast version of
    J. Wang et al., 2010, doi:10.1109/CVPR.2010.5540018: g = 1, and λ in units of the trace of the covariance.
    O(K d + k² (k + m)) for one point, m the fewer of its observed and unobserved entries; the Gram matrix of the atoms
    is formed once.
    """
    known = np.where(observed, points, 0.0)
    # Distances over the observed entries: ‖x‖² − 2 x·d + ‖d‖²
    products = known @ atoms.T
    squares = observed.astype(float) @ (atoms**2).T
    norms = np.einsum("nd,nd->n", known, known)
    distance = np.sqrt(np.maximum(squares - 2.0 * products + norms[:, None], 0.0))
    n_near = min(neighbours, len(atoms)) or len(atoms)
    near = np.sort(np.argpartition(distance, n_near - 1, axis=1)[:, :n_near], axis=1)
    gram = atoms @ atoms.T
    reconstructed = np.empty_like(known)
    for row, chosen in enumerate(near):
        local, visible = atoms[chosen], observed[row]
        # C_kl = (d_k − x)·(d_l − x) over the observed entries, from whichever entries are fewer
        if 2 * np.count_nonzero(visible) > len(visible):
            hidden = local[:, ~visible]
            product = products[row, chosen]
            covariance = gram[np.ix_(chosen, chosen)] - hidden @ hidden.T - product[:, None] - product + norms[row]
        else:
            offsets = local[:, visible] - known[row, visible]
            covariance = offsets @ offsets.T
        if bandwidth:
            ridge = locality_ridge(distance[row, chosen], distance[row].max(), weight, bandwidth, exponent)
        else:
            ridge = np.full(n_near, weight * np.trace(covariance))
        reconstructed[row] = affine_weights(covariance, ridge) @ local
    return reconstructed
