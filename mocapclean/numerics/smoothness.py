"""Roughness of columns over frames, Θ(X) = ‖OX‖_F², and its proximal map.

With the first difference D over F frames, OᵀO = (DᵀD)^k. Order k = 1 has ‖OX‖ = ‖DX‖. Order k = 2 has O = −DᵀD, the
second difference whose first and last rows are the first differences at the ends. The orthonormal cosine transform
(DCT-II) over frames diagonalises OᵀO; its eigenvalues are (4 sin²(πj / 2F))^k, j = 0..F − 1. D. Garcia, 2010,
doi:10.1016/j.csda.2009.09.020. Without ``flat_ends`` those two rows are left out, and motion at constant velocity has
roughness 0.
"""

import numpy as np
import scipy

from mocapclean.arrays import Floats
from mocapclean.numerics.low_rank.differences import add_adjoint, difference, normal_bands


def roughness_bands(n_frames: int, order: int, *, flat_ends: bool = True) -> Floats:
    """Return the lower bands (3, F) of OᵀO, order 1 or 2."""
    if order == 1:
        return normal_bands(n_frames, 0.0, 1.0, 0.0)
    bands = normal_bands(n_frames, 0.0, 0.0, 1.0)
    # The rows (−1, 1, 0, ...) and (..., 0, 1, −1) of −DᵀD add [[1, −1], [−1, 1]] at both ends.
    if flat_ends and n_frames > 1:
        for end in (0, n_frames - 2):
            bands[0, end : end + 2] += 1.0
            bands[1, end] -= 1.0
    return bands


def roughness(values: Floats, order: int) -> float:
    """Return Θ of values (F, n)."""
    differences = difference(values)
    if order == 2:
        second = np.zeros_like(values)
        add_adjoint(second, differences)
        differences = second
    return float(np.sum(differences**2))


def smooth(values: Floats, weight: float, order: int, *, flat_ends: bool = True) -> Floats:
    """Return argmin_Z ½ ‖Z − values‖² + ½ weight ‖OZ‖² for values (F, n), as a new array in Fortran order.

    One banded Cholesky factorisation and solve (LAPACK pbtrf, pbtrs): O(F n) for every F. The cosine transform is
    about as fast where F has small prime factors alone.
    """
    # (I + weight OᵀO) Z = values
    lower = weight * roughness_bands(len(values), order, flat_ends=flat_ends)
    lower[0] += 1.0
    # LAPACK's upper storage: row 2 − k holds the k-th band, shifted right by k.
    upper = np.zeros_like(lower)
    for k in range(min(3, len(values))):
        upper[2 - k, k:] = lower[k, : len(values) - k]
    solution: Floats = scipy.linalg.lapack.dpbtrs(scipy.linalg.lapack.dpbtrf(upper)[0], values)[0]
    return solution
