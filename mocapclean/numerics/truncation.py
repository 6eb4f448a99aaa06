"""One step towards low rank under a truncated nuclear norm."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_GRAM_LIMIT = 1e-6


def shrink_truncated(matrix: Floats, threshold: float, dimension: int, rank: int, out: Floats) -> Floats:
    """Put argmin_X threshold·‖X‖_* + ½ ‖X − matrix‖_F² over rank X ≤ ``dimension`` in ``out``; return U_r V_rᵀ of it.

    matrix, out: (m, n). The first ``dimension`` singular values lose ``threshold``, the others vanish; by
    L. Mirsky, 1960, doi:10.1093/qmath/11.1.50, nothing of that rank is closer. U_r V_rᵀ (m, n), of the ``rank``
    largest values left, is the gradient of their sum; values that vanished or are below 1e-6 σ₁ have no part in it.
    Both come from one eigenproblem of the small side's Gram matrix: O(m n²) for m ≥ n.
    """
    if len(matrix) < matrix.shape[1]:
        return shrink_truncated(matrix.T, threshold, dimension, rank, out.T).T
    squares, vectors = np.linalg.eigh(matrix.T @ matrix)
    values, vectors = np.sqrt(np.maximum(squares[::-1], 0.0)), vectors[:, ::-1]
    n_kept = min(int(np.count_nonzero(values > threshold)), dimension)
    n_top = min(n_kept, rank, int(np.count_nonzero(values > _GRAM_LIMIT * values[:1].sum())))
    vectors = vectors[:, :n_kept]
    coordinates = matrix @ vectors
    np.matmul(coordinates, (1.0 - threshold / values[:n_kept])[:, None] * vectors.T, out=out)
    top: Floats = ((vectors[:, :n_top] / values[:n_top]) @ coordinates[:, :n_top].T).T
    return top
