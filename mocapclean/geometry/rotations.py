"""The orthogonal Procrustes problem for rotations in space: the rotation that fits one set of vectors to another."""

import numpy as np

from mocapclean.arrays import Floats

# Most Newton iterations for the largest root; chosen by hand, no sweep was kept.
_MOST_ITERATIONS = 60
# Step at which Newton's iteration for λ ends. λ is between 1 and √3, so the next step would be of the order of its
# square, 1e-18.
_LAST_STEP = 1e-9
# Least denominator of Markley's formula, (σ₁ + σ₂)(σ₂ + σ₃)(σ₃ + σ₁) for unit H; below it, the formula is too
# inaccurate and singular vectors are used. Chosen by hand.
_LEAST_DENOMINATOR = 1e-5


def fit_rotations(moments: Floats) -> Floats:
    """Return the rotations R (n, 3, 3), det R = 1, that maximise tr(Rᵀ H) for matrices H (n, 3, 3).

    With the largest root λ of (λ² − ‖H‖²)² − 8 λ det H − 4 ‖cof H‖² = 0, which is max tr(Rᵀ H),

        R = ((κ + ‖H‖²) H + λ cof H − H Hᵀ H) / (κ λ − det H),   κ = (λ² − ‖H‖²) / 2:

    F. L. Markley, 1993, Attitude determination using vector observations: a fast optimal matrix algorithm. Newton's
    iteration finds λ from above. One step of N. J. Higham, 1986, doi:10.1137/0907079, removes rounding errors. Where H
    is near rank 1 the rotation is not unique; singular vectors give one of them.
    """
    columns = np.ascontiguousarray(np.moveaxis(moments, 0, 2))
    return np.moveaxis(fit_rotations_of_columns(columns), 2, 0)


def fit_rotations_of_columns(moments: Floats) -> Floats:
    """Return the rotations (3, 3, n) of ``fit_rotations`` for matrices H (3, 3, n)."""
    # H scaled to ‖H‖ = 1
    size = np.sqrt(np.einsum("ijn,ijn->n", moments, moments))
    unit = moments / np.where(size > 0.0, size, 1.0)
    cofactors = _cofactors(unit)
    determinant = np.einsum("jn,jn->n", unit[0], cofactors[0])
    squared_cofactors = np.einsum("ijn,ijn->n", cofactors, cofactors)
    root = _largest_root(determinant, squared_cofactors)
    # Markley's formula
    kappa = 0.5 * (root * root - 1.0)
    denominator = kappa * root - determinant
    singular = denominator < _LEAST_DENOMINATOR
    cube = np.einsum("ikn,kln->iln", np.einsum("ijn,kjn->ikn", unit, unit), unit)
    fitted = ((kappa + 1.0) * unit + root * cofactors - cube) / np.where(singular, 1.0, denominator)
    # Higham's step (R + R⁻ᵀ) / 2, for R⁻ᵀ = cof R / det R and det R = 1
    rotations: Floats = 0.5 * (fitted + _cofactors(fitted))
    if singular.any():
        rotations[:, :, singular] = np.moveaxis(fit_rotations_by_svd(np.moveaxis(moments[:, :, singular], 2, 0)), 0, 2)
    return rotations


def _largest_root(determinant: Floats, squared_cofactors: Floats) -> Floats:
    """Return the largest root λ (n,) of (λ² − 1)² − 8 λ det H − 4 ‖cof H‖², by Newton's iteration from √3 ≥ λ."""
    root = np.full(len(determinant), np.sqrt(3.0))
    for _ in range(_MOST_ITERATIONS):
        excess = root * root - 1.0
        slope = 4.0 * root * excess - 8.0 * determinant
        polynomial = excess * excess - 8.0 * root * determinant - 4.0 * squared_cofactors
        step = polynomial / np.maximum(slope, _LEAST_DENOMINATOR)
        root -= step
        # slope = 8 · denominator at the root, so matrices that end up with singular vectors need not converge
        if np.all((step < _LAST_STEP) | (slope < 8.0 * _LEAST_DENOMINATOR)):
            break
    return root


def fit_rotations_by_svd(moments: Floats) -> Floats:
    """Return the rotations R (n, 3, 3), det R = 1, that maximise tr(Rᵀ H) for matrices H (n, 3, 3).

    They come from the singular vectors of H: W. Kabsch, 1976, doi:10.1107/S0567739476001873. ``fit_rotations`` is
    several times faster.
    """
    left, _, right = np.linalg.svd(moments)
    # The direction of the least singular value is reversed where U Vᵀ is a reflection.
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)


def _cofactors(matrices: Floats) -> Floats:
    """Return the cofactors (3, 3, n) of matrices (3, 3, n): row i is the cross product of the other two rows."""
    cofactors = np.empty_like(matrices)
    for i in range(3):
        (x, y, z), (u, v, w) = matrices[i - 2], matrices[i - 1]
        cofactors[i, 0], cofactors[i, 1], cofactors[i, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return cofactors
