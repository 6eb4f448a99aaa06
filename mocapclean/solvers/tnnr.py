"""Truncated nuclear norm regularisation: only the singular values beyond the r largest are kept small.

    min_X  ‖X‖_r = Σ_{i>r} σ_i(X)    subject to  X = D on the trusted entries

X (F, 3M) is the take with frames in rows, D the trusted positions about their mean, divided by their spread. The outer
loop replaces the concave part −Σ_{i≤r} σ_i by its tangent ⟨AᵀB, X⟩ (A, B the top r singular vectors of X). The inner
loop is an ADMM with W = X, multiplier Y and penalty ρ:

    X = 𝒟_{1/ρ}(W − Y/ρ)    W = X + (AᵀB + Y)/ρ, trusted entries fixed   Y += ρ (X − W)

Y. Hu, D. Zhang, J. Ye, X. Li, X. He, 2013, doi:10.1109/TPAMI.2012.271 (TNNR-ADMM).

Where this departs from the print, and why:

- Y = −AᵀB on the untrusted entries from the first iteration on, so the loop is that of ``ialm`` with one more term.
- W is the answer, not X, so that trusted entries are exact; at convergence they are the same.
- The multiplier starts at 0 (the authors' code sets it to the data) and is kept from one outer step to the next.
- The authors try every rank up to 20 and take the one nearest to the truth. Here the rank is that of ``trnn`` (``rank``
  auto), and it is raised step by step (``rank_schedule``), each stage starting from the last; an empty schedule is one
  rank.
- The parameter is ρ‖D‖₂ (the authors' ρ is 0.05 for grey values up to 255), and the steps are over-relaxed. The
  defaults come from benchmarks/low_rank_sweep.py.

``trnn2`` with both weights 0 is the same model.

Cost per inner iteration: that of ``ialm``.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.nuclear_norm_completion import NuclearNormCompletion
from mocapclean.numerics.low_rank.shrinkage import singular_values, top_singular_directions
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = (
    "Y. Hu, D. Zhang, J. Ye, X. Li, X. He, 2013, Fast and accurate matrix completion via truncated nuclear norm "
    "regularization, doi:10.1109/TPAMI.2012.271"
)

TRAITS = Traits()


@parameters
class Params:
    """The rank, and the two loops."""

    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(),
        About(symbol="r", text="singular values left free; auto: the last wide gap of the interpolated spectrum"),
    ] = "auto"
    rank_gap: Annotated[
        float,
        Field(gt=0),
        About(symbol="θ", unit="mm", text="least step between singular values for rank auto (Hu et al. 2017)"),
    ] = 5.644
    rank_limit: Annotated[int, Field(ge=0), About(symbol="r_max", text="largest rank that auto may choose")] = 15
    rank_schedule: Annotated[
        tuple[Annotated[int, Field(ge=0, strict=True)], ...],
        Field(strict=False),
        About(symbol="r_s", text="ranks passed through before r; empty: start at r"),
    ] = (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12)
    penalty: Annotated[float, Field(gt=0), About(symbol="ρ‖D‖₂", text="penalty of the inner ADMM")] = 20.0
    relaxation: Annotated[
        float, Field(gt=0, lt=2), About(symbol="α", text="factor of every step, above 1 to go further; 1 as printed")
    ] = 1.7
    tolerance: Annotated[
        float, Field(ge=0), About(symbol="ε", text="relative residual and change to end an inner loop at")
    ] = 2e-4
    outer_tolerance: Annotated[
        float, Field(ge=0), About(symbol="ε₀", text="relative change over an outer step to stop at")
    ] = 1e-3
    inner_iterations: Annotated[int, Field(ge=1), About(symbol="k", text="most iterations of one inner loop")] = 200
    outer_iterations: Annotated[
        int, Field(ge=1), About(symbol="l", text="most outer steps at the last rank; one before")
    ] = 10
    max_iterations: Annotated[int, Field(ge=1), About(symbol="K", text="most inner iterations in all")] = 3000


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled.

    The trace is ‖X‖_r of the answer after every outer step.
    """
    data = centred_matrix(take.positions, take.trusted)
    values = data.values / data.spread
    norm = float(singular_values(values).max(initial=0.0)) or 1.0
    completion = NuclearNormCompletion(values, data.known, penalty=params.penalty / norm, relaxation=params.relaxation)
    rank = data.gap_rank(params.rank_gap, params.rank_limit) if params.rank == "auto" else params.rank
    rank = min(rank, *values.shape)
    converged, trace = _raise_rank(completion, rank, params)
    return Solution(
        positions=data.positions(completion.filled * data.spread),
        filled=fillable,
        converged=converged,
        iterations=len(completion.trace),
        reason=_reason(converged, completion, params),
        trace=tuple(trace),
        facts={"rank": rank, "spread_mm": data.spread},
    )


def _raise_rank(completion: NuclearNormCompletion, rank: int, params: Params) -> tuple[bool, list[float]]:
    """Raise the rank through the schedule; return whether the last stage converged, and the objectives."""
    trace: list[float] = []
    for stage in [*(r for r in params.rank_schedule if r < rank), rank]:
        converged = False
        for _ in range(params.outer_iterations if stage == rank else 1):
            remaining = params.max_iterations - len(completion.trace)
            if converged or remaining == 0:
                break
            converged = _outer_step(completion, stage, min(remaining, params.inner_iterations), params)
            trace.append(float(singular_values(completion.filled)[stage:].sum()))
    return converged, trace


def _outer_step(completion: NuclearNormCompletion, rank: int, most_iterations: int, params: Params) -> bool:
    """Take one outer step; return whether its inner loop converged and the matrix changed little over it."""
    before = completion.filled.copy()
    # The tangent AᵀB at the present W stays fixed over the inner loop.
    settled = completion.run(
        tangent=top_singular_directions(completion.filled, rank),
        tolerance=params.tolerance,
        change_tolerance=params.tolerance,
        max_iterations=most_iterations,
    )
    change = float(np.linalg.norm(completion.filled - before))
    return settled and (rank == 0 or change <= params.outer_tolerance * float(np.linalg.norm(before)))


def _reason(converged: bool, completion: NuclearNormCompletion, params: Params) -> str:
    if converged:
        return f"inner and outer changes are within {params.tolerance:g} and {params.outer_tolerance:g}"
    limit = "max_iterations" if len(completion.trace) == params.max_iterations else "outer_iterations"
    return limit_reached(params, limit, f"residual {completion.residual:.1e}")
