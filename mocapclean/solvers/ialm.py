"""Inexact augmented Lagrangians: least nuclear norm through the trusted entries, or low rank and sparse errors.

    min_X      ‖X‖_*             subject to  X = D on the trusted entries                      (mode completion)
    min_{X,E}  ‖X‖_* + λ ‖E‖₁    subject to  X + E = D, E free on the untrusted entries        (mode robust)

X (F, 3M) is the take with frames in rows, D the trusted positions about their mean, over their spread. With W the
completed matrix and Y the multiplier, mode completion iterates

    X = 𝒟_{1/μ}(W + Y/μ)    W = X on the untrusted entries    Y += μ (D − X) on the trusted ones    μ *= ρ

and mode robust, λ = error_weight / √max(F, 3M), robust principal component analysis,

    E = 𝒮_{λ/μ}(D − X + Y/μ)    X = 𝒟_{1/μ}(D − E + Y/μ)    Y += μ (D − X − E)    μ *= ρ

Z. Lin, M. Chen, Y. Ma, 2010, arXiv:1009.5055.

Where this departs from the print, and why:

- ``schedule="paper"`` starts at μ = 0.3 / ‖D‖₂ and multiplies by ρ = 1.2172 + 1.8588 q (q the trusted share) once
  min(μ, √μ) ‖ΔW‖ / ‖D‖ is below 1e-5 √((1 − q) / q). A growing μ freezes the iterate before the optimum, and a
  small one wastes the first hundred iterations. ``"fixed"`` keeps μ = penalty / ‖D‖₂, over-relaxes and extrapolates:
  it tends to the minimiser.
- The last test is on ‖ΔW‖ / ‖D‖ itself, not on the product with min(μ, √μ), which depends on the unit of length.
- Mode robust starts at μ = 1.25 / ‖D‖₂ as printed. The printed ρ = 1.5 freezes the untrusted entries, which have no
  error term, before they have arrived; ``growth`` is smaller. Turning the world changes the answer, since errors are
  counted coordinate by coordinate. The printed ``error_weight`` is 1; defaults come from benchmarks/low_rank_sweep.py.

Cost per iteration: a Gram matrix and a product of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), and 4 · memory
passes over the matrix, O(F M).
"""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.low_rank.centred_matrix import CentredMatrix, centred_matrix
from mocapclean.numerics.low_rank.nuclear_norm_completion import NuclearNormCompletion
from mocapclean.numerics.low_rank.robust_pca import robust_pca
from mocapclean.numerics.low_rank.shrinkage import singular_values
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

REFERENCE = (
    "Z. Lin, M. Chen, Y. Ma, 2010, The augmented Lagrange multiplier method for exact recovery of corrupted low-rank "
    "matrices, arXiv:1009.5055"
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The problem, the course of the penalty, and where to stop."""

    mode: Annotated[
        Literal["completion", "robust"], Field(description="E, 1, trust the trusted entries, or find errors in them")
    ] = "completion"
    schedule: Annotated[
        Literal["fixed", "paper"],
        Field(description="μ_k, 1, completion: fixed and over-relaxed, or growing as printed"),
    ] = "fixed"
    penalty: Annotated[float, Field(gt=0, description="μ‖D‖₂, 1, penalty of the fixed schedule")] = 80.0
    relaxation: Annotated[
        float, Field(gt=0, lt=2, description="α, 1, fixed schedule: factor of every step, above 1 to go further")
    ] = 1.7
    memory: Annotated[
        int, Field(ge=0, le=50, description="m, 1, fixed schedule: iterations that Anderson extrapolates from")
    ] = 10
    error_weight: Annotated[
        float, Field(gt=0, description="λ√max(F,3M), 1, robust: weight of the sparse errors; 1 as printed")
    ] = 2.0
    growth: Annotated[
        float, Field(ge=1, description="ρ, 1, robust: factor of the penalty in every iteration; 1.5 as printed")
    ] = 1.05
    tolerance: Annotated[
        Literal["auto"] | Annotated[float, Field(ge=0)],
        Field(description="ε, 1, relative residual and change to stop at; auto: 2e-4 completion, 1e-7 robust"),
    ] = "auto"
    max_iterations: Annotated[int, Field(ge=1, description="K, 1, most iterations")] = 1000


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence; the trace is the relative residual.

    In mode robust the Solution's outliers are E on the trusted samples, in mm.
    """
    return separate(take, params, (0,))


def separate(take: Take, params: Params, ranks: Sequence[int], stage_iterations: int = 1) -> Solution:
    """The solution with as many singular values left free as the last of ``ranks`` says.

    Mode completion passes through the others on the way, each for at most ``stage_iterations``.
    """
    wanted = fillable(take.trusted)
    data = centred_matrix(take.positions, take.trusted)
    if not wanted.any():
        return Solution(positions=data.positions(data.values), filled=wanted, reason="nothing to fill")
    if params.mode == "robust":
        return _separate(data, wanted, params, ranks[-1])
    return _complete(data, wanted, params, ranks, stage_iterations)


def _complete(
    data: CentredMatrix, wanted: Bools, params: Params, ranks: Sequence[int], stage_iterations: int
) -> Solution:
    values = data.values / data.spread
    largest = float(singular_values(values).max(initial=0.0)) or 1.0
    share = float(data.known.mean())
    tolerance = 2e-4 if params.tolerance == "auto" else params.tolerance
    fixed = params.schedule == "fixed"
    completion = NuclearNormCompletion(
        values,
        data.known,
        penalty=(params.penalty if fixed else 0.3) / largest,
        relaxation=params.relaxation if fixed else 1.0,
        memory=params.memory if fixed and not ranks[-1] else 0,
    )
    converged = False
    for rank in ranks:
        left = params.max_iterations - len(completion.trace)
        converged = completion.run(
            keep=rank,
            growth=1.0 if fixed else 1.2172 + 1.8588 * share,
            settled=1e-5 * ((1.0 - share) / share) ** 0.5,
            tolerance=tolerance,
            change_tolerance=tolerance,
            max_iterations=left if rank == ranks[-1] else min(left, stage_iterations),
        )
    return Solution(
        positions=data.positions(completion.filled * data.spread),
        filled=wanted,
        converged=converged,
        iterations=len(completion.trace),
        reason=_reason(converged, params, completion.residual, tolerance),
        trace=tuple(completion.trace),
        facts={"kept": ranks[-1], "spread_mm": data.spread},
    )


def _separate(data: CentredMatrix, wanted: Bools, params: Params, keep: int) -> Solution:
    tolerance = 1e-7 if params.tolerance == "auto" else params.tolerance
    found = robust_pca(
        data.values / data.spread,
        params.error_weight / max(data.values.shape) ** 0.5,
        keep=keep,
        known=data.known,
        growth=params.growth,
        tolerance=tolerance,
        max_iterations=params.max_iterations,
    )
    outliers = data.positions(found.sparse * data.spread) - np.where(data.used[:, None], data.centre, 0.0)
    return Solution(
        positions=data.positions(found.low * data.spread),
        filled=wanted,
        converged=found.converged,
        iterations=len(found.trace),
        reason=_reason(found.converged, params, found.residual, tolerance),
        trace=tuple(found.trace),
        facts={"kept": keep, "spread_mm": data.spread, "n_outlying_entries": int(np.count_nonzero(found.sparse))},
        outliers=outliers,
    )


def _reason(converged: bool, params: Params, residual: float, tolerance: float) -> str:
    if converged:
        return f"residual and change are within {tolerance:g}"
    return f"max_iterations {params.max_iterations} reached; residual {residual:.1e}"
