"""Inexact augmented Lagrangians: least nuclear norm through the trusted entries, or low rank and sparse errors.

    min_X      ‖X‖_*             subject to  X = D on the trusted entries                      (mode completion)
    min_{X,E}  ‖X‖_* + λ ‖E‖₁    subject to  X + E = D, E free on the untrusted entries        (mode robust)

X (F, 3M) is the take with frames in rows, D the trusted positions about their mean, divided by their spread. With W the
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
  error term, before they reach the minimum; ``growth`` is smaller. Errors are counted in each coordinate by itself, so
  rotating the world changes the answer. The printed ``error_weight`` is 1; defaults come from
  benchmarks/low_rank_sweep.py.

Cost per iteration: a Gram matrix and a product of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), and 4 · memory
passes over the matrix, O(F M).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.numerics.low_rank.centred_matrix import CentredMatrix, centred_matrix
from mocapclean.numerics.low_rank.nuclear_norm_completion import NuclearNormCompletion
from mocapclean.numerics.low_rank.robust_pca import robust_pca
from mocapclean.numerics.low_rank.shrinkage import singular_values
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = (
    "Z. Lin, M. Chen, Y. Ma, 2010, The augmented Lagrange multiplier method for exact recovery of corrupted low-rank "
    "matrices, arXiv:1009.5055"
)

TRAITS = Traits()

_COMPLETION_TOLERANCE = 2e-4  # tolerance auto of mode completion; no sweep was kept
_ROBUST_TOLERANCE = 1e-7  # tolerance auto of mode robust; the default of the authors' program


@dataclass(frozen=True, kw_only=True)
class PaperSchedule:
    """The growing penalty of mode completion as printed."""

    start: float = 0.3
    """μ₀ ‖D‖₂."""

    least_growth: float = 1.2172
    """ρ where no entry is trusted."""

    growth_per_share: float = 1.8588
    """The slope of ρ over the trusted share q of the entries."""

    settled: float = 1e-5
    """The penalty grows once min(μ, √μ) ‖ΔW‖ / ‖D‖ is below this times √((1 − q) / q)."""


_PAPER_SCHEDULE = PaperSchedule()


@parameters
class Params:
    """The problem, the schedule of the penalty, and the stopping rule."""

    mode: Annotated[
        Literal["completion", "robust"], About(symbol="E", text="trust the trusted entries, or find errors in them")
    ] = "completion"
    schedule: Annotated[
        Literal["fixed", "paper"],
        About(symbol="μ_k", text="completion: fixed and over-relaxed, or growing as printed"),
    ] = "fixed"
    penalty: Annotated[float, Field(gt=0), About(symbol="μ‖D‖₂", text="penalty of the fixed schedule")] = 80.0
    relaxation: Annotated[
        float, Field(gt=0, lt=2), About(symbol="α", text="fixed schedule: factor of every step, above 1 to go further")
    ] = 1.7
    memory: Annotated[
        int, Field(ge=0, le=50), About(symbol="m", text="fixed schedule: iterations that Anderson extrapolates from")
    ] = 10
    error_weight: Annotated[
        float, Field(gt=0), About(symbol="λ√max(F,3M)", text="robust: weight of the sparse errors; 1 as printed")
    ] = 2.0
    growth: Annotated[
        float, Field(ge=1), About(symbol="ρ", text="robust: factor of the penalty in every iteration; 1.5 as printed")
    ] = 1.05
    tolerance: Annotated[
        Literal["auto"] | Annotated[float, Field(ge=0)],
        Field(),
        About(symbol="ε", text="relative residual and change to stop at; auto: 2e-4 completion, 1e-7 robust"),
    ] = "auto"
    max_iterations: Annotated[int, Field(ge=1), About(symbol="K", text="most iterations")] = 1000


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled; the trace is the relative residual.

    In mode robust the Solution's outliers are E on the trusted samples, in mm.
    """
    return fill_with_ranks(take, params, fillable, (0,))


def fill_with_ranks(
    take: Take, params: Params, fillable: Bools, ranks: Sequence[int], stage_iterations: int = 1
) -> Solution:
    """Return the solution with the last of ``ranks`` as the number of singular values left free.

    Mode completion passes through the other ranks first, each for at most ``stage_iterations``.
    """
    data = centred_matrix(take.positions, take.trusted)
    if params.mode == "robust":
        return _separate(data, fillable, params, ranks[-1])
    return _complete(data, fillable, params, ranks, stage_iterations)


def _complete(
    data: CentredMatrix, fillable: Bools, params: Params, ranks: Sequence[int], stage_iterations: int
) -> Solution:
    """Return the solution of mode completion."""
    values = data.values / data.spread
    norm = float(singular_values(values).max(initial=0.0)) or 1.0
    share = float(data.known.mean())
    tolerance = _COMPLETION_TOLERANCE if params.tolerance == "auto" else params.tolerance
    paper, fixed = _PAPER_SCHEDULE, params.schedule == "fixed"
    completion = NuclearNormCompletion(
        values,
        data.known,
        penalty=(params.penalty if fixed else paper.start) / norm,
        relaxation=params.relaxation if fixed else 1.0,
        memory=params.memory if fixed and not ranks[-1] else 0,
    )
    converged = False
    for rank in ranks:
        remaining = params.max_iterations - len(completion.trace)
        converged = completion.run(
            keep=rank,
            growth=1.0 if fixed else paper.least_growth + paper.growth_per_share * share,
            settled=paper.settled * ((1.0 - share) / share) ** 0.5,
            tolerance=tolerance,
            change_tolerance=tolerance,
            max_iterations=remaining if rank == ranks[-1] else min(remaining, stage_iterations),
        )
    return Solution(
        positions=data.positions(completion.filled * data.spread),
        filled=fillable,
        converged=converged,
        iterations=len(completion.trace),
        reason=_reason(converged, params, completion.residual, tolerance),
        trace=tuple(completion.trace),
        facts={"kept": ranks[-1], "spread_mm": data.spread},
    )


def _separate(data: CentredMatrix, fillable: Bools, params: Params, rank: int) -> Solution:
    """Return the solution of mode robust."""
    tolerance = _ROBUST_TOLERANCE if params.tolerance == "auto" else params.tolerance
    result = robust_pca(
        data.values / data.spread,
        params.error_weight / max(data.values.shape) ** 0.5,
        keep=rank,
        known=data.known,
        growth=params.growth,
        tolerance=tolerance,
        max_iterations=params.max_iterations,
    )
    # E is a difference of positions, so it has no centre.
    outliers = data.positions(result.sparse * data.spread) - np.where(data.used[:, None], data.centre, 0.0)
    n_outlying = int(np.count_nonzero(result.sparse))
    return Solution(
        positions=data.positions(result.low * data.spread),
        filled=fillable,
        converged=result.converged,
        iterations=len(result.trace),
        reason=_reason(result.converged, params, result.residual, tolerance),
        trace=tuple(result.trace),
        facts={"kept": rank, "spread_mm": data.spread, "n_outlying_entries": n_outlying},
        outliers=outliers,
    )


def _reason(converged: bool, params: Params, residual: float, tolerance: float) -> str:
    if converged:
        return f"residual and change are within {tolerance:g}"
    return limit_reached(params, "max_iterations", f"residual {residual:.1e}")
