"""Truncated nuclear norm regularisation: only the singular values beyond the r largest are kept small.

    min_X  ‖X‖_r = Σ_{i>r} σ_i(X)    subject to  X = D on the trusted entries

X (F, 3M) is the take with frames in rows, D the trusted positions about their mean, over their spread. The outer loop
puts its tangent ⟨AᵀB, X⟩ (A, B the top r singular vectors of X) in the place of the concave part −Σ_{i≤r} σ_i, the
inner loop is an ADMM with W = X, multiplier Y and penalty ρ:

    X = 𝒟_{1/ρ}(W − Y/ρ)    W = X + (AᵀB + Y)/ρ, trusted entries held    Y += ρ (X − W)

Y. Hu, D. Zhang, J. Ye, X. Li, X. He, 2013, doi:10.1109/TPAMI.2012.271 (TNNR-ADMM).

Where this departs from the print, and why:

- Y = −AᵀB on the untrusted entries from the first iteration on, so the loop is that of ``ialm`` with one more term.
- W is the answer, not X, so that trusted entries are exact; at convergence they are the same.
- The multiplier starts at 0 (the authors' code sets it to the data) and is kept from one outer step to the next.
- The authors try every rank up to 20 and take the best against the truth. Here it is that of ``trnn`` (``rank`` auto)
  and raised step by step (``rank_schedule``), each stage starting from the last; an empty schedule is one rank.
- ρ is given times ‖D‖₂ (theirs is 0.05 for grey values up to 255), and the steps are over-relaxed. The defaults come
  from benchmarks/low_rank_sweep.py.

``trnn2`` with both weights 0 is the same model.

Cost per inner iteration: that of ``ialm``.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.nuclear_norm_completion import NuclearNormCompletion
from mocapclean.numerics.low_rank.shrinkage import singular_values, top_singular_directions
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

REFERENCE = (
    "Y. Hu, D. Zhang, J. Ye, X. Li, X. He, 2013, Fast and accurate matrix completion via truncated nuclear norm "
    "regularization, doi:10.1109/TPAMI.2012.271"
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The rank, and the two loops."""

    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(description="r, 1, singular values left free; auto: the last wide gap of the interpolated spectrum"),
    ] = "auto"
    rank_gap: Annotated[
        float, Field(gt=0, description="θ, mm, least step between singular values for rank auto (Hu et al. 2017)")
    ] = 5.644
    rank_limit: Annotated[int, Field(ge=0, description="r_max, 1, largest rank that auto may choose")] = 15
    rank_schedule: Annotated[
        tuple[Annotated[int, Field(ge=0, strict=True)], ...],
        Field(strict=False, description="r_s, 1, ranks passed through on the way to r; empty: start at r"),
    ] = (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12)
    penalty: Annotated[float, Field(gt=0, description="ρ‖D‖₂, 1, penalty of the inner ADMM")] = 20.0
    relaxation: Annotated[
        float, Field(gt=0, lt=2, description="α, 1, factor of every step, above 1 to go further; 1 as printed")
    ] = 1.7
    tolerance: Annotated[
        float, Field(ge=0, description="ε, 1, relative residual and change to end an inner loop at")
    ] = 2e-4
    outer_tolerance: Annotated[
        float, Field(ge=0, description="ε₀, 1, relative change over an outer step to stop at")
    ] = 1e-3
    inner_iterations: Annotated[int, Field(ge=1, description="k, 1, most iterations of one inner loop")] = 200
    outer_iterations: Annotated[int, Field(ge=1, description="l, 1, most outer steps at the last rank; one before")] = (
        10
    )
    max_iterations: Annotated[int, Field(ge=1, description="K, 1, most inner iterations in all")] = 3000


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence; the trace is ‖X‖_r of the answer after every outer step."""
    wanted = fillable(take.trusted)
    data = centred_matrix(take.positions, take.trusted)
    if not wanted.any():
        return Solution(positions=data.positions(data.values), filled=wanted, reason="nothing to fill")
    values = data.values / data.spread
    largest = float(singular_values(values).max(initial=0.0)) or 1.0
    completion = NuclearNormCompletion(
        values, data.known, penalty=params.penalty / largest, relaxation=params.relaxation
    )
    rank = data.gap_rank(params.rank_gap, params.rank_limit) if params.rank == "auto" else params.rank
    rank = min(rank, *values.shape)
    converged, trace = _raise_rank(completion, rank, params)
    return Solution(
        positions=data.positions(completion.filled * data.spread),
        filled=wanted,
        converged=converged,
        iterations=len(completion.trace),
        reason=_reason(converged, completion, params),
        trace=tuple(trace),
        facts={"rank": rank, "spread_mm": data.spread},
    )


def _raise_rank(completion: NuclearNormCompletion, rank: int, params: Params) -> tuple[bool, list[float]]:
    """Raise the rank through the schedule; whether the last stage converged, and the objectives."""
    trace: list[float] = []
    for stage in [*(r for r in params.rank_schedule if r < rank), rank]:
        converged = False
        for _ in range(params.outer_iterations if stage == rank else 1):
            left = params.max_iterations - len(completion.trace)
            if converged or left == 0:
                break
            converged = _step(completion, stage, min(left, params.inner_iterations), params)
            trace.append(float(singular_values(completion.filled)[stage:].sum()))
    return converged, trace


def _step(completion: NuclearNormCompletion, rank: int, most: int, params: Params) -> bool:
    """One outer step; whether its inner loop converged and it hardly changed the matrix."""
    before = completion.filled.copy()
    settled = completion.run(
        tangent=top_singular_directions(completion.filled, rank),
        tolerance=params.tolerance,
        change_tolerance=params.tolerance,
        max_iterations=most,
    )
    change = float(np.linalg.norm(completion.filled - before))
    return settled and (rank == 0 or change <= params.outer_tolerance * float(np.linalg.norm(before)))


def _reason(converged: bool, completion: NuclearNormCompletion, params: Params) -> str:
    if converged:
        return f"inner and outer changes are within {params.tolerance:g} and {params.outer_tolerance:g}"
    if len(completion.trace) == params.max_iterations:
        return f"max_iterations {params.max_iterations} reached; residual {completion.residual:.1e}"
    return f"outer_iterations {params.outer_iterations} reached; residual {completion.residual:.1e}"
