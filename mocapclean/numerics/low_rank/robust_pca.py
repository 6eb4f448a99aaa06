"""Robust principal component analysis: a matrix as a low-rank plus a sparse one, by the inexact augmented Lagrangian.

    min_{A,E}  Σ_{i>N} σ_i(A) + λ ‖E‖₁ over the known entries    subject to  A + E = D

N = 0: Z. Lin, M. Chen, Y. Ma, 2010, arXiv:1009.5055. N > 0, the partial sum: T.-H. Oh et al., 2016,
doi:10.1109/TPAMI.2015.2465956. E is free on the unknown entries.
"""

from dataclasses import dataclass, field

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values, singular_values

# Largest penalty over the first one, as in the program inexact_alm_rpca that Lin et al. (2010) published.
_PENALTY_RANGE = 1e7


@dataclass
class Separation:
    """The low-rank and the sparse part of a matrix, and the state of the iteration.

    low: (F, n), A. sparse: (F, n), E, 0 on the unknown entries. multiplier: (F, n), Y. residual: ‖D − A − E‖_F relative
    to ‖D‖_F. trace: the residual after every iteration.
    """

    low: Floats
    sparse: Floats
    multiplier: Floats
    residual: float = np.inf
    converged: bool = False
    trace: list[float] = field(default_factory=list)


def robust_pca(
    matrix: Floats,
    weight: float,
    *,
    keep: int = 0,
    known: Bools | None = None,
    penalty: float = 1.25,
    growth: float = 1.5,
    tolerance: float = 1e-7,
    max_iterations: int = 1000,
) -> Separation:
    """Separate a matrix (F, n) into a low-rank part and large errors in a few entries.

    weight: λ; 1 / √max(F, n) in Hu et al. (2017), and in E. J. Candès et al., 2011, doi:10.1145/1970392.1970395. keep:
    N, singular values that are not shrunk. known: (F, n) bool, all by default; elsewhere the matrix is not read.
    penalty: μ times ‖D‖₂ at the start; growth: ρ, its factor in every iteration, until it is 1e7 times as large. With
    growth = 1 and N = 0 the loop converges to the minimiser; with growth > 1 it stops somewhat short of it.
    """
    is_known = np.ones(matrix.shape, dtype=bool) if known is None else known
    values = np.where(is_known, matrix, 0.0)
    largest = float(singular_values(values).max(initial=0.0))
    parts = Separation(np.zeros_like(values), np.zeros_like(values), np.zeros_like(values))
    if largest == 0.0:
        parts.residual, parts.converged = 0.0, True
        return parts
    norm = float(np.linalg.norm(values))
    mu, limit = penalty / largest, _PENALTY_RANGE * penalty / largest
    # Y/μ, started from Y = D / max(‖D‖₂, ‖D‖_∞ / λ)
    scaled_multiplier = values / (max(largest, float(np.abs(values).max()) / weight) * mu)
    target, unknown = np.empty_like(values), ~is_known
    for _ in range(max_iterations):
        # E = 𝒮_{λ/μ}(D − A + Y/μ): the soft threshold, as the argument less its clipped part; E is free where unknown
        np.add(values, scaled_multiplier, out=target)
        np.subtract(target, parts.low, out=parts.sparse)
        clipped = np.clip(parts.sparse, -weight / mu, weight / mu)
        clipped[unknown] = 0.0
        parts.sparse -= clipped
        # A = 𝒟_{N,1/μ}(D − E + Y/μ)
        target -= parts.sparse
        shrink_singular_values(target, 1.0 / mu, keep=keep, out=parts.low)
        # Y/μ += D − A − E; the residual is the difference of the multipliers
        np.subtract(target, parts.low, out=target)
        difference = np.subtract(target, scaled_multiplier, out=clipped)
        parts.residual = float(np.linalg.norm(difference)) / norm
        parts.trace.append(parts.residual)
        scaled_multiplier, target = target, scaled_multiplier
        parts.converged = parts.residual <= tolerance
        if parts.converged:
            break
        larger = min(growth * mu, limit)
        scaled_multiplier *= mu / larger
        mu = larger
    parts.multiplier = mu * scaled_multiplier
    parts.sparse[unknown] = 0.0
    return parts
