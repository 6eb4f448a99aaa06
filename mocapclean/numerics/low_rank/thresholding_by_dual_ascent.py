"""Singular value thresholding as printed: gradient ascent on the dual, with and without bounds on distances.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the known entries,  ‖C_i z‖ ≤ d_i for every i

Without bounds: J.-F. Cai, E. J. Candès, Z. Shen, 2010, doi:10.1137/080738970; with bounds: C.-H. Tan, J. Hou,
L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5. The multipliers are y of the equalities, and (p_i, s_i) in the
second-order cone {‖p‖ ≤ s} of the inequalities. The minimiser for given multipliers is Z = 𝒟_τ(y + Σ C_iᵀ p_i), and
the dual gradient is (B − Z, −C z, −d).
"""

from dataclasses import dataclass, field

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values, singular_values

_TINY = np.finfo(np.float64).tiny


@dataclass(kw_only=True)
class Iterate:
    """The state of an iterative solver of the problem.

    matrix: (F, n), Z. residual: root mean square of B − Z over the known entries. excess: largest excess over a bound.
    trace: the residual after every iteration. converged: whether residual and excess are within their tolerances.
    contradictory: whether the bounds were found to exclude each other.
    """

    matrix: Floats
    residual: float = np.inf
    excess: float = np.inf
    trace: list[float] = field(default_factory=list)
    converged: bool = False
    contradictory: bool = False


@dataclass(kw_only=True)
class DualIterate(Iterate):
    """The state of the dual ascent, with its multipliers.

    equality: (F, n), y. vectors: (N, 3), p. heights: (N,), s. skipped: iterations that the kick-start left out.
    """

    equality: Floats
    vectors: Floats
    heights: Floats
    skipped: int


def project_to_cones(vectors: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """Return the nearest points of the cones ‖p‖ ≤ s to vectors (N, 3) and heights (N,)."""
    # Inside the cone: the point itself; inside the polar cone: 0; else ‖p‖ and s become (‖p‖ + s) / 2.
    norms = np.sqrt(np.einsum("nc,nc->n", vectors, vectors))
    projected = np.where(norms <= heights, heights, np.maximum((norms + heights) / 2.0, 0.0))
    return vectors * (np.minimum(projected, norms) / np.maximum(norms, _TINY))[:, None], projected


def threshold_by_dual_ascent(
    values: Floats,
    known: Bools,
    bounds: DistanceBounds,
    *,
    threshold: float,
    step: float,
    tolerance: float,
    excess_tolerance: float,
    max_iterations: int,
) -> DualIterate:
    """Iterate until residual and excess are within their tolerances; return the last iterate.

    values: (F, n), B where known and 0 elsewhere. threshold: τ. step: below 2 / ‖AᵀA + CᵀC‖. The kick-start is exact:
    while ‖y‖₂ ≤ τ, Z is 0 and so are all p_i and s_i, and y grows by the step times B.
    """
    mask = known.astype(float)
    scale = max(int(known.sum()), 1) ** -0.5
    n_bounds = len(bounds.lengths)
    skipped = _skipped_iterations(float(singular_values(values).max(initial=0.0)), threshold, step)
    now = DualIterate(
        matrix=np.zeros_like(values),
        equality=values * (1 + skipped * step),
        vectors=np.zeros((n_bounds, 3)),
        heights=np.zeros(n_bounds),
        skipped=skipped,
    )
    residual, total = np.empty_like(values), np.empty_like(values)
    while len(now.trace) < max_iterations:
        # Z = 𝒟_τ(y + Σ C_iᵀ p_i)
        np.copyto(total, now.equality)
        bounds.add_adjoint(total, now.vectors)
        shrink_singular_values(total, threshold, out=now.matrix)
        np.subtract(values, now.matrix, out=residual)
        residual *= mask
        differences = bounds.differences(now.matrix)
        now.residual, now.excess = scale * float(np.linalg.norm(residual)), bounds.excess(differences)
        now.trace.append(now.residual)
        if now.residual <= tolerance and now.excess <= excess_tolerance:
            now.converged = True
            break
        # y += δ (B − Z) on the known entries; (p, s) := projection of (p − δ C z, s − δ d)
        residual *= step
        now.equality += residual
        now.vectors, now.heights = project_to_cones(
            now.vectors - step * differences, now.heights - step * bounds.lengths
        )
    return now


def _skipped_iterations(norm: float, threshold: float, step: float) -> int:
    """Return the number of steps δ for which (1 + k δ) ‖B‖₂ ≤ τ, with ``norm`` ‖B‖₂."""
    return max(int((threshold / norm - 1.0) / step), 0) if norm > 0 else 0
