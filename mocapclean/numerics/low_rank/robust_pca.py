"""A matrix taken apart into a low-rank and a sparse one, by the inexact augmented Lagrangian method.

    min_{A,E}  Σ_{i>N} σ_i(A) + λ ‖E‖₁ over the known entries    subject to  A + E = D

N = 0: Z. Lin, M. Chen, Y. Ma, 2010, arXiv:1009.5055. N > 0, the partial sum: T.-H. Oh et al., 2016,
doi:10.1109/TPAMI.2015.2465956. E is free on the unknown entries.
"""

from dataclasses import dataclass, field

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values, singular_values

_PENALTY_RANGE = 1e7


@dataclass
class Separation:
    """low: A (F, n). sparse: E, 0 on the unknown entries. multiplier: Y. residual: ‖D − A − E‖_F relative to ‖D‖_F.

    trace: the residual after every iteration.
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

    weight: λ; Hu et al. (2017) and the theory of E. J. Candès et al. (2011, doi:10.1145/1970392.1970395) have
    1 / √max(F, n). keep: N, singular values left free. known: (F, n) bool, all by default; elsewhere the matrix is not
    read. penalty: μ times ‖D‖₂ at the start; growth: ρ, its factor in every iteration, until it is 1e7 times as large.
    With growth = 1 and N = 0 the loop tends to the minimiser; growth stops it somewhat short of that.
    """
    seen = np.ones(matrix.shape, dtype=bool) if known is None else known
    values = np.where(seen, matrix, 0.0)
    largest = float(singular_values(values).max(initial=0.0))
    found = Separation(np.zeros_like(values), np.zeros_like(values), np.zeros_like(values))
    if largest == 0.0:
        found.residual, found.converged = 0.0, True
        return found
    norm = float(np.linalg.norm(values))
    mu, limit = penalty / largest, _PENALTY_RANGE * penalty / largest
    scaled = values / (max(largest, float(np.abs(values).max()) / weight) * mu)
    target, unknown = np.empty_like(values), ~seen
    for _ in range(max_iterations):
        np.add(values, scaled, out=target)
        np.subtract(target, found.low, out=found.sparse)
        held = np.clip(found.sparse, -weight / mu, weight / mu)
        held[unknown] = 0.0
        found.sparse -= held
        target -= found.sparse
        shrink_singular_values(target, 1.0 / mu, keep=keep, out=found.low)
        np.subtract(target, found.low, out=target)
        np.subtract(target, scaled, out=held)
        found.residual = float(np.linalg.norm(held)) / norm
        found.trace.append(found.residual)
        scaled, target = target, scaled
        found.converged = found.residual <= tolerance
        if found.converged:
            break
        stiffer = min(growth * mu, limit)
        scaled *= mu / stiffer
        mu = stiffer
    found.multiplier = mu * scaled
    found.sparse[unknown] = 0.0
    return found
