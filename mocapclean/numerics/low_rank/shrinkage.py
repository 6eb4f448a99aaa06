"""Proximal maps of the nuclear norm and its truncated forms, the gradient of the truncated part, and its rank."""

import numpy as np

from mocapclean.arrays import Floats

# Singular values below this share of the largest are not taken from the Gram matrix: squaring leaves them at most four
# correct digits in double precision.
_GRAM_LIMIT = 1e-6


def _gram_spectrum(matrix: Floats) -> tuple[Floats, Floats]:
    """Return the singular values, descending, and right singular vectors (n, n) of a matrix (m, n), by its Gram matrix.

    The vectors are columns. The absolute error of a singular value is of the order of 1e-16 σ₁² / σ.
    """
    squares, vectors = np.linalg.eigh(matrix.T @ matrix)
    return np.sqrt(np.maximum(squares[::-1], 0.0)), vectors[:, ::-1]


def singular_values(matrix: Floats) -> Floats:
    """Return the singular values, descending, of a matrix (m, n); those below 1e-8 σ₁ are not resolved."""
    gram = matrix.T @ matrix if len(matrix) >= matrix.shape[1] else matrix @ matrix.T
    values: Floats = np.sqrt(np.maximum(np.linalg.eigvalsh(gram)[::-1], 0.0))
    return values


def shrink_singular_values(
    matrix: Floats, threshold: float, *, keep: int = 0, out: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the proximal map of threshold·Σ_{i>keep} σ_i at a matrix (m, n), and its singular values, descending.

    Every singular value but the first ``keep`` is reduced by ``threshold``, to 0 at least. The result is written to
    ``out`` if given. keep = 0 is the nuclear norm: J.-F. Cai, E. J. Candès, Z. Shen, 2010, doi:10.1137/080738970;
    keep > 0 is T.-H. Oh et al., 2016, doi:10.1109/TPAMI.2015.2465956. The Gram matrix of the smaller side is
    decomposed instead of the matrix: O(m n²) multiplications at BLAS speed plus O(n³) for m ≥ n. Its rounding errors
    concern small values, which the threshold sets to 0 anyway; for very small thresholds a full SVD is taken.
    """
    if len(matrix) < matrix.shape[1]:
        shrunk, values = shrink_singular_values(matrix.T, threshold, keep=keep, out=None if out is None else out.T)
        return shrunk.T, values
    result = np.empty(matrix.shape) if out is None else out
    values, vectors = _gram_spectrum(matrix)
    largest = values[0] if values.size else 0.0
    if threshold < _GRAM_LIMIT * largest:
        left, values, rows = np.linalg.svd(matrix, full_matrices=False)
        shrunk_values = _soft_threshold(values, threshold, keep)
        np.matmul(left * shrunk_values, rows, out=result)
        return result, shrunk_values
    # U diag(s') Vᵀ = M V diag(s'/s) Vᵀ, multiplied in the cheaper order
    shrunk_values = _soft_threshold(values, threshold, keep)
    n_kept = np.count_nonzero(shrunk_values)
    vectors = vectors[:, :n_kept]
    weights = shrunk_values[:n_kept] / values[:n_kept]
    if 2 * n_kept < matrix.shape[1]:
        np.matmul(matrix @ vectors, weights[:, None] * vectors.T, out=result)
    else:
        np.matmul(matrix, (vectors * weights) @ vectors.T, out=result)
    return result, shrunk_values


def _soft_threshold(values: Floats, threshold: float, keep: int) -> Floats:
    """Return the values less ``threshold``, 0 at least; the first ``keep`` unchanged."""
    reduced = np.maximum(values - threshold, 0.0)
    reduced[:keep] = values[:keep]
    return reduced


def shrink_truncated(matrix: Floats, threshold: float, dimension: int, rank: int, out: Floats) -> Floats:
    """Put argmin_X threshold·‖X‖_* + ½ ‖X − matrix‖_F² over rank X ≤ ``dimension`` in ``out``; return its U_r V_rᵀ.

    matrix, out: (m, n). The first ``dimension`` singular values are reduced by ``threshold``, the others become 0; by
    L. Mirsky, 1960, doi:10.1093/qmath/11.1.50, no matrix of that rank is closer. U_r V_rᵀ (m, n) is the gradient of
    the sum of the ``rank`` largest values that remain, without values of 0 or below 1e-6 σ₁. Both come from one
    eigenproblem of the smaller side's Gram matrix: O(m n²) for m ≥ n.
    """
    if len(matrix) < matrix.shape[1]:
        return shrink_truncated(matrix.T, threshold, dimension, rank, out.T).T
    values, vectors = _gram_spectrum(matrix)
    n_kept = min(int(np.count_nonzero(values > threshold)), dimension)
    n_top = min(n_kept, rank, int(np.count_nonzero(values > _GRAM_LIMIT * values[:1].sum())))
    vectors = vectors[:, :n_kept]
    coordinates = matrix @ vectors
    np.matmul(coordinates, (1.0 - threshold / values[:n_kept])[:, None] * vectors.T, out=out)
    top: Floats = ((vectors[:, :n_top] / values[:n_top]) @ coordinates[:, :n_top].T).T
    return top


def top_singular_directions(matrix: Floats, rank: int) -> Floats:
    """Return U_r V_rᵀ (m, n) of the ``rank`` largest singular values: the gradient of their sum, of spectral norm 1.

    Directions whose singular value is below 1e-6 σ₁ are left out, as rounding errors of the Gram matrix.
    """
    if len(matrix) < matrix.shape[1]:
        return top_singular_directions(matrix.T, rank).T
    values, vectors = _gram_spectrum(matrix)
    n_kept = np.count_nonzero(values[:rank] > _GRAM_LIMIT * values[:1].sum())
    vectors = vectors[:, :n_kept]
    return (matrix @ (vectors / values[:n_kept])) @ vectors.T


def spectral_gap_rank(matrix: Floats, gap: float, limit: int) -> int:
    """Return the largest i with σ_i − σ_{i+1} ≥ gap, at most ``limit``; 0 where no difference is that large.

    matrix: (m, n); σ beyond the last counts as 0. W. Hu et al., 2017, section on the choice of r.
    """
    values = singular_values(matrix)
    differences = values - np.append(values[1:], 0.0)
    wide = np.flatnonzero(differences >= gap)
    return min(int(wide[-1]) + 1, limit) if wide.size else 0
