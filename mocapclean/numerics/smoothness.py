"""Roughness of columns over frames, Θ(X) = ‖OX‖_F², and its proximal map.

With the first difference D over F frames, OᵀO = (DᵀD)^k: ‖OX‖ = ‖DX‖ for order k = 1, and for k = 2 O = −DᵀD, the
second difference whose first and last rows are the first differences at the ends. The orthonormal cosine transform
(DCT-II) over frames diagonalises OᵀO; its eigenvalues are (4 sin²(πj / 2F))^k, j = 0..F − 1. D. Garcia, 2010,
doi:10.1016/j.csda.2009.09.020. With ``flat_ends`` off, those two rows are left out and steady motion costs nothing.
"""

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs

from mocapclean.arrays import Floats
from mocapclean.numerics.low_rank.differences import add_adjoint, difference, normal_bands


def roughness_bands(n_frames: int, order: int, *, flat_ends: bool = True) -> Floats:
    """Lower bands (3, F) of OᵀO, order 1 or 2."""
    if order == 1:
        return normal_bands(n_frames, 0.0, 1.0, 0.0)
    bands = normal_bands(n_frames, 0.0, 0.0, 1.0)
    if flat_ends and n_frames > 1:
        for end in (0, n_frames - 2):
            bands[0, end : end + 2] += 1.0
            bands[1, end] -= 1.0
    return bands


def roughness(values: Floats, order: int) -> float:
    """Θ of values (F, n)."""
    steps = difference(values)
    if order == 2:
        ends = np.zeros_like(values)
        add_adjoint(ends, steps)
        steps = ends
    return float(np.sum(steps**2))


def smooth(values: Floats, weight: float, order: int, *, flat_ends: bool = True) -> Floats:
    """argmin_Z ½ ‖Z − values‖² + ½ weight ‖OZ‖² for values (F, n), as a new array in Fortran order.

    One banded Cholesky factorisation and solve (LAPACK pbtrf, pbtrs): O(F n), whatever the prime factors of F, and
    about as fast as the cosine transforms where F has none but small ones.
    """
    lower = weight * roughness_bands(len(values), order, flat_ends=flat_ends)
    lower[0] += 1.0
    upper = np.zeros_like(lower)
    for k in range(min(3, len(values))):
        upper[2 - k, k:] = lower[k, : len(values) - k]
    solution: Floats = dpbtrs(dpbtrf(upper)[0], values)[0]
    return solution
