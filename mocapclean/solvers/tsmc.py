"""Low rank, temporally stable, with sparse noise: matrix completion that also cleans what it is given.

    min_{X,S}  ‖X‖_* + λ ‖P_Ω(S)‖₁ + (μ/2) ‖OX‖_F²     subject to  P_Ω(X + S) = P_Ω(D)

X (F, 3M) is the take with frames in rows, D its trusted entries Ω, S the noise, ‖·‖_* the sum of the singular values,
O the second difference over frames with first differences at the ends (``order`` 1: the first difference). With
smooth and clean copies M and C = P_Ω(D) − S of X, multipliers Y₁, Y₂ and a fixed penalty η one iteration is

    X = 𝒟_{1/(2η)}((M + C)/2 + (Y₁ + Y₂)/(2η))    M = (I + (μ/η) OᵀO)⁻¹ (X − Y₁/η)    Y₁ += η (M − X)
    S = 𝒮_{λ/η}(D − X + Y₂/η) on Ω, free elsewhere                                     Y₂ += η (C − X)

Y. Feng, J. Xiao, Y. Zhuang, X. Yang, J. J. Zhang, R. Song, 2014, doi:10.1016/j.ins.2014.03.013.

Where this departs from the print, and why:

- The paper's own equations were not at hand. The model is as W. Hu et al. (2017) and R. Imamura, M. Okuda (2018) state
  it; the operator and the values of λ and μ are Hu's; the solver is derived here.
- X against (M, S) are two blocks, so the iteration tends to the minimum for every fixed η. A growing penalty, as
  augmented Lagrangian methods of that time have it, stops short of it.
- Anderson's extrapolation of the iteration (``memory``; 0 is the plain one).
- λ, μ and η belong to coordinates in CMU's unit of 56.444 mm, so the data are divided by ``unit``; and they are taken
  about their mean, or the answer would depend on where the origin is.

Cost per iteration: a Gram matrix and a product of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), a pentadiagonal
solve and 4 · memory passes over the matrix, O(F M). Anderson keeps 4 · memory matrices of that size, at most
512 MB; a longer take has a shorter memory.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Floats
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.low_rank.anderson_acceleration import AndersonAcceleration
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SplitCopies
from mocapclean.parameters import STRICT
from mocapclean.solvers.sparse_noise import NoisyTake
from mocapclean.take import Solution, Take

REFERENCE = (
    "Y. Feng, J. Xiao, Y. Zhuang, X. Yang, J. J. Zhang, R. Song, 2014, Exploiting temporal stability and low-rank "
    "structure for motion capture data refinement, doi:10.1016/j.ins.2014.03.013"
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The weights of the model, and the iteration."""

    sparsity: Annotated[float, Field(gt=0, description="λ √max(F, 3M), 1, weight of the noise")] = 100.0
    smoothness: Annotated[float, Field(ge=0, description="μ, 1/unit, weight of the squared differences")] = 100.0
    order: Annotated[Literal[1, 2], Field(description="k, 1, first or second difference over frames")] = 2
    unit: Annotated[float, Field(gt=0, description="u, mm, length that counts as 1 (CMU: 56.444)")] = 56.444
    penalty: Annotated[float, Field(gt=0, description="η, 1/unit, fixed penalty; only the speed depends on it")] = 1.0
    memory: Annotated[int, Field(ge=0, le=50, description="m, 1, iterations that Anderson extrapolates from")] = 10
    tolerance: Annotated[
        float, Field(ge=0, description="ε, 1, distance of X from its copies to stop at, relative to the data")
    ] = 1e-5
    denoise: Annotated[bool, Field(description="S, 1, offer trusted samples less their noise as well")] = False
    max_iterations: Annotated[int, Field(ge=1, description="K, 1, most iterations")] = 2000


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence; ``outliers`` is S.

    The trace is the distance of X from its copies, relative to the data.
    """
    problem = NoisyTake(take, params.unit)
    if problem.is_idle(params.denoise):
        return problem.unchanged()
    copies = SplitCopies(problem.start, problem.observe(params.sparsity, params.smoothness, params.order))
    low, trace = minimise(copies, params)
    converged = trace[-1] <= params.tolerance
    reached = "" if converged else f"max_iterations {params.max_iterations} reached; "
    return problem.solution(
        low,
        copies,
        denoise=params.denoise,
        converged=converged,
        reason=f"{reached}X is within {trace[-1]:.1e} of its copies",
        trace=trace,
    )


def minimise(copies: SplitCopies, params: Params) -> tuple[Floats, list[float]]:
    """Iterate until X (F, n) agrees with its copies; X and the distances."""
    memory = AndersonAcceleration(params.memory, copies.state.size)
    threshold = 1.0 / (copies.n_copies * params.penalty)
    low = np.empty(copies.shape, order="F")
    trace: list[float] = []
    while len(trace) < params.max_iterations:
        target = copies.update(params.penalty)
        shrink_singular_values(target, threshold, out=low)
        image, gap = copies.next_state(low)
        trace.append(gap)
        if gap <= params.tolerance:
            break
        copies.state = memory.next_state(copies.state, image)
    return low, trace
