"""Singular value thresholding: the low-rank matrix through the trusted entries.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the trusted entries

Z (F, 3M) is the take with frames in rows and B its trusted entries. With a large τ the second term hardly counts and
Z comes near the matrix of least nuclear norm. As printed, the multipliers ascend the dual from y = B:

    Z = 𝒟_τ(y)    y += δ (B − Z) on the trusted entries

J.-F. Cai, E. J. Candès, Z. Shen, 2010, doi:10.1137/080738970; for motion capture R. Y. Q. Lai, P. C. Yuen, K. K. W.
Lee, 2011; the settings are those of "BSVT" in C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5,
whose lengths are in units of 56.444 mm: τ = 8 √(F · 3M), δ = 1.5 (0.75 for comparison), and a root mean square
residual of 0.01 over the trusted entries to stop at.

Where this departs from the print, and why:

- ``iteration="accelerated"`` solves the same problem by Douglas-Rachford splitting with Anderson's extrapolation, in
  some tens of iterations; ``"paper"`` is the iteration above.
- While ‖y‖₂ ≤ τ, Z is 0 and y only grows: ``"paper"`` skips those iterations, which changes nothing.
- ``origin="mean"`` takes positions about the mean of the trusted samples, so that moving the world moves the answer;
  the paper's numbers come from positions as they are in the file (``"file"``).
- Tan's limit of iterations is not printed.

The iterate is the low-rank matrix everywhere, so its trusted entries differ from B by the residual.

Cost per iteration: a Gram matrix and a product of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), and 4 · memory passes
over the matrix, O(F M).
"""

from typing import Annotated, Literal

from mocapclean.arrays import Bools
from mocapclean.numerics.low_rank.centred_matrix import CentredMatrix, centred_matrix
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds, no_bounds
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import Iterate, threshold_by_dual_ascent
from mocapclean.numerics.low_rank.thresholding_by_newton import threshold_by_newton
from mocapclean.numerics.low_rank.thresholding_by_splitting import threshold_by_splitting
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = "J.-F. Cai, E. J. Candès, Z. Shen, 2010, A singular value thresholding algorithm, doi:10.1137/080738970"

TRAITS = Traits()

NEWTON_BELOW = 2e-5
"""Tolerance in spreads of the take below which Newton's method serves, if distances are bounded.

The splitting reaches 2e-5 within some hundreds of iterations, on takes with thousands of bounds 1e-6 not in thousands.
"""


@parameters
class Params:
    """The threshold, and the iteration to the minimum."""

    threshold: Annotated[
        float, Field(gt=0), About(symbol="τ / √(3FM)", unit="mm", text="threshold per root of the entries")
    ] = 451.556
    tolerance: Annotated[
        float,
        Field(ge=0),
        About(symbol="tol", unit="mm", text="root mean square residual of the trusted entries to stop at"),
    ] = 0.564444
    iteration: Annotated[
        Literal["accelerated", "paper"], About(symbol="k", text="extrapolated splitting, or the printed plain ascent")
    ] = "accelerated"
    penalty: Annotated[
        float,
        Field(gt=0),
        About(symbol="ρ", text="accelerated: ‖B‖₂ over the threshold of a step; only the speed depends on it"),
    ] = 80.0
    memory: Annotated[
        int, Field(ge=0, le=50), About(symbol="m", text="accelerated: iterations that Anderson extrapolates from")
    ] = 10
    step: Annotated[
        float, Field(gt=0, lt=2), About(symbol="δ", text="step of the plain ascent; 0.75 in comparisons")
    ] = 1.5
    origin: Annotated[
        Literal["mean", "file"], About(symbol="o", text="positions about their mean, or as they are in the file")
    ] = "mean"
    max_iterations: Annotated[int, Field(ge=1), About(symbol="k_max", text="most iterations, after the kick-start")] = (
        5000
    )


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled; the trace is the residual in mm."""
    data = centred_matrix(take.positions, take.trusted, about_mean=params.origin == "mean")
    result = minimise(data, no_bounds(data.values.size // 3), params, step=params.step, excess_tolerance=0.0)
    residual = f"{result.residual:.2g} mm"
    return Solution(
        positions=data.positions(result.matrix),
        filled=fillable,
        converged=result.converged,
        iterations=len(result.trace),
        reason=f"the residual is {residual}"
        if result.converged
        else limit_reached(params, "max_iterations", f"residual {residual}"),
        trace=tuple(result.trace),
    )


def minimise(
    data: CentredMatrix, edges: DistanceBounds, params: Params, *, step: float, excess_tolerance: float
) -> Iterate:
    """Return the low-rank matrix within the bounds on ``edges``.

    step: δ of the printed ascent. excess_tolerance: mm by which an edge may be too long at the end.
    """
    # τ from τ / √(3FM): a norm over all entries
    threshold = params.threshold * data.values.size**0.5
    if params.iteration == "paper":
        return threshold_by_dual_ascent(
            data.values,
            data.known,
            edges,
            threshold=threshold,
            step=step,
            tolerance=params.tolerance,
            excess_tolerance=excess_tolerance,
            max_iterations=params.max_iterations,
        )
    if len(edges.lengths) and params.tolerance < NEWTON_BELOW * data.spread:
        return threshold_by_newton(
            data.values,
            data.known,
            edges,
            threshold=threshold,
            tolerance=params.tolerance,
            excess_tolerance=excess_tolerance,
            max_iterations=params.max_iterations,
        )
    return threshold_by_splitting(
        data.values,
        data.known,
        edges,
        threshold=threshold,
        penalty=params.penalty,
        memory=params.memory,
        tolerance=params.tolerance,
        excess_tolerance=excess_tolerance,
        max_iterations=params.max_iterations,
    )
