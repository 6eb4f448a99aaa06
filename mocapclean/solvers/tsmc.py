"""Low rank, temporally stable, with sparse noise: matrix completion that also cleans the trusted samples.

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
- X against (M, S) are two blocks, so the iteration tends to the minimum for every fixed η. A growing penalty, as in
  augmented Lagrangian methods of that time, stops short of it.
- Anderson's extrapolation speeds the iteration up (``memory``; 0 is the plain one).
- λ, μ and η belong to coordinates in CMU's unit of 56.444 mm, so the data are divided by ``unit``; and they are taken
  about their mean, or the answer would depend on the origin of the coordinates.

Cost per iteration: a Gram matrix and a product of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), a pentadiagonal
solve and 4 · memory passes over the matrix, O(F M). Anderson keeps 4 · memory matrices of that size, at most
512 MB; a longer take has a shorter memory.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.anderson_acceleration import AndersonAcceleration
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SplitCopies
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.solvers.sparse_noise import NoisyTake
from mocapclean.take import Solution, Take

REFERENCE = (
    "Y. Feng, J. Xiao, Y. Zhuang, X. Yang, J. J. Zhang, R. Song, 2014, Exploiting temporal stability and low-rank "
    "structure for motion capture data refinement, doi:10.1016/j.ins.2014.03.013"
)

TRAITS = Traits(cleans_complete_takes=True)


@parameters
class Params:
    """The weights of the model, and the iteration."""

    sparsity: Annotated[float, Field(gt=0), About(symbol="λ √max(F, 3M)", text="weight of the noise")] = 100.0
    smoothness: Annotated[
        float, Field(ge=0), About(symbol="μ", unit="1/unit", text="weight of the squared differences")
    ] = 100.0
    order: Annotated[Literal[1, 2], About(symbol="k", text="first or second difference over frames")] = 2
    unit: Annotated[float, Field(gt=0), About(symbol="u", unit="mm", text="length that counts as 1 (CMU: 56.444)")] = (
        56.444
    )
    penalty: Annotated[
        float, Field(gt=0), About(symbol="η", unit="1/unit", text="fixed penalty; only the speed depends on it")
    ] = 1.0
    memory: Annotated[int, Field(ge=0, le=50), About(symbol="m", text="iterations that Anderson extrapolates from")] = (
        10
    )
    tolerance: Annotated[
        float, Field(ge=0), About(symbol="ε", text="distance of X from its copies to stop at, relative to the data")
    ] = 1e-5
    denoise: Annotated[bool, About(symbol="S", text="offer trusted samples less their noise as well")] = False
    max_iterations: Annotated[int, Field(ge=1), About(symbol="K", text="most iterations")] = 2000


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled; ``outliers`` is S.

    The trace is the distance of X from its copies, relative to the data.
    """
    noisy = NoisyTake(take, params.unit)
    copies = SplitCopies(noisy.start, noisy.observe(params.sparsity, params.smoothness, params.order))
    low, trace = minimise(copies, params)
    converged = trace[-1] <= params.tolerance
    state = f"X is within {trace[-1]:.1e} of its copies"
    return noisy.solution(
        low,
        copies,
        fillable,
        denoise=params.denoise,
        converged=converged,
        reason=state if converged else limit_reached(params, "max_iterations", state),
        trace=trace,
    )


def minimise(copies: SplitCopies, params: Params) -> tuple[Floats, list[float]]:
    """Iterate until X (F, n) agrees with its copies; return X and the distances."""
    anderson = AndersonAcceleration(params.memory, copies.state.size)
    threshold = 1.0 / (copies.n_copies * params.penalty)
    low = np.empty(copies.shape, order="F")
    trace: list[float] = []
    while len(trace) < params.max_iterations:
        # S, M and the multipliers; the target is the mean of the copies and multipliers that X is shrunk from.
        target = copies.update(params.penalty)
        # X = 𝒟_{1/(2η)}(target)
        shrink_singular_values(target, threshold, out=low)
        image, distance = copies.next_state(low)
        trace.append(distance)
        if distance <= params.tolerance:
            break
        copies.state = anderson.next_state(copies.state, image)
    return low, trace
