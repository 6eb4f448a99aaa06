"""Truncated nuclear norm in factored form, temporally smooth, with sparse noise.

    min_{X,S}  ‖X‖_r + λ ‖P_Ω(S)‖₁ + (μ/2) ‖OX‖_F²     subject to  P_Ω(X + S) = P_Ω(D),  rank X ≤ d        (3)

‖X‖_r = Σ_{i>r} σ_i leaves the r largest singular values free; the rest is ``tsmc``. X = R Lᵀ with LᵀL = I, R (F, d),
so that ‖X‖_* = ‖R‖_*; the free part is the tangent T = U_r V_rᵀ of the top singular vectors of X before. With the
copies M and C = P_Ω(D) − S and N = (M + C)/2 + (Y₁ + Y₂ + T)/(2η) one iteration is

    R, L = argmin ‖R‖_* + η ‖R Lᵀ − N‖²      then S, M, Y₁, Y₂ as in ``tsmc`` and η ← min(ρη, η_max)

W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, IEEE Signal Processing Letters.

Where this departs from the print, and why:

- The print moves L, the polar factor of NᵀR, and then R = 𝒟_{1/(2η)}(N L). Where R has lost rank that factor is not
  unique. Both at once are the d largest singular values of N, shrunk, and no dearer at the size of a body;
  ``factors="alternating"`` is the printed step. U and V come from X together, not by one half-step each. The fixed
  points are the same.
- The text has no equations for S and M; these are the minimisers. The convergence test names E for S.
- The printed growth ρ = 1.4 freezes X within some 50 iterations near where it started: on long gaps it is little better
  than straight lines and worse than ``tsmc``. ρ = 1.02 gives it the time to leave; with that it is mostly better. The
  penalty grows between X and its copies. ``polish`` goes on with a fixed penalty until X is stationary.
- d, η_max and the start are not printed: d is the rank rule without its limit, η_max 1e10. Gaps start at the mean, so
  that the top singular vectors of a line across them do not protect that line; ``start="interpolated"`` has the line.
  Both ranks are those of the interpolated matrix, as printed.
- Data are about their mean and divided by ``unit``, as in ``tsmc``.

The way through a slow ramp is long and not convex: where several ends are as good, rounding may choose among them.

Cost per iteration: a Gram matrix and two products of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), and a
pentadiagonal solve, O(F M).
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Floats
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.low_rank.shrinkage import (
    shrink_singular_values,
    shrink_truncated,
    spectral_gap_rank,
    top_singular_directions,
)
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SmoothSparseModel, SplitCopies
from mocapclean.parameters import STRICT
from mocapclean.solvers.sparse_noise import NoisyTake
from mocapclean.take import Solution, Take

REFERENCE = (
    "W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, Motion capture data completion via truncated nuclear "
    "norm regularization, IEEE Signal Process. Lett."
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The weights of the model, its ranks, and the ramp of the penalty."""

    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(description="r, 1, singular values left free; auto: the last wide gap of the spectrum"),
    ] = "auto"
    rank_gap: Annotated[float, Field(gt=0, description="θ, mm, least step between singular values for auto")] = 5.644
    rank_limit: Annotated[int, Field(ge=0, description="r_max, 1, largest rank that auto may choose")] = 15
    dimension: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=1)],
        Field(description="d, 1, largest rank of X; auto: the last wide gap without the limit, at least r"),
    ] = "auto"
    factors: Annotated[
        Literal["joint", "alternating"], Field(description="R L', 1, minimise over both factors at once, or in turn")
    ] = "joint"
    start: Annotated[
        Literal["interpolated", "zero"], Field(description="X_0, 1, gaps start as straight lines, or at the mean")
    ] = "zero"
    sparsity: Annotated[float, Field(gt=0, description="λ √max(F, 3M), 1, weight of the noise")] = 100.0
    smoothness: Annotated[float, Field(ge=0, description="μ, 1/unit, weight of the squared differences")] = 100.0
    unit: Annotated[float, Field(gt=0, description="u, mm, length that counts as 1 (CMU: 56.444)")] = 56.444
    penalty: Annotated[float, Field(gt=0, description="η₀, 1/unit, penalty at the start")] = 1e-5
    growth: Annotated[float, Field(ge=1, le=10, description="ρ, 1, factor of the penalty in every iteration")] = 1.02
    penalty_limit: Annotated[float, Field(gt=0, description="η_max, 1/unit, largest penalty")] = 1e10
    tolerance: Annotated[
        float, Field(ge=0, description="ε, 1, distance of X from its copies to stop at, relative to the data")
    ] = 1e-4
    polish: Annotated[
        float, Field(ge=0, description="η_f, 1/unit, fixed penalty to go on with after the ramp; 0: stop there")
    ] = 0.0
    polish_tolerance: Annotated[float, Field(ge=0, description="ε_f, 1, as tolerance, for the fixed penalty")] = 1e-6
    denoise: Annotated[bool, Field(description="S, 1, offer trusted samples less their noise as well")] = False
    max_iterations: Annotated[int, Field(ge=1, description="K, 1, most iterations in all")] = 3000


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence; ``outliers`` is S.

    The trace is the distance of X from its copies, relative to the data.
    """
    problem = NoisyTake(take, params.unit)
    if problem.is_idle(params.denoise):
        return problem.unchanged()
    rank, dimension = choose(problem.start, params)
    start = problem.start if params.start == "interpolated" else problem.data.values / params.unit
    alm = Alm(start, problem.observe(params.sparsity, params.smoothness), rank, dimension, params)
    converged = alm.run()
    reached = "" if converged else f"max_iterations {params.max_iterations} reached; "
    return problem.solution(
        alm.low,
        alm.copies,
        denoise=params.denoise,
        converged=converged,
        reason=f"{reached}X is within {alm.trace[-1]:.1e} of its copies",
        trace=alm.trace,
        facts={"rank": rank, "dimension": dimension},
    )


def choose(start: Floats, params: Params) -> tuple[int, int]:
    """r and d for a start (F, n) in units of ``unit``."""
    gap, most = params.rank_gap / params.unit, min(start.shape)
    rank = spectral_gap_rank(start, gap, params.rank_limit) if params.rank == "auto" else params.rank
    dimension = spectral_gap_rank(start, gap, most) if params.dimension == "auto" else params.dimension
    return min(rank, most), min(max(rank, dimension, 1), most)


def separate(
    matrix: Floats, rank: int, *, growth: float = 1.5, tolerance: float = 1e-7, max_iterations: int = 1000
) -> tuple[Floats, Floats, int]:
    """A matrix (F, n) as the sum of one of rank at most ``rank`` and a sparse one; these and the iterations taken.

    Hu's experiment on synthetic matrices: μ = 0, Ω everything, λ = 1/√max(F, n), d = r, η₀ = 1.25 / ‖D‖₂.
    """
    everything = np.ones(matrix.shape, dtype=bool, order="F")
    weight = 1.0 / max(matrix.shape) ** 0.5
    observation = SmoothSparseModel(data=np.asfortranarray(matrix), known=everything, sparsity=weight, smoothness=0.0)
    penalty = 1.25 / (float(np.linalg.norm(matrix, 2)) or 1.0)
    params = Params(penalty=penalty, growth=growth, tolerance=tolerance, max_iterations=max_iterations)
    alm = Alm(matrix, observation, rank, rank, params)
    alm.run()
    return alm.low, observation.outliers(alm.copies.clean), len(alm.trace)


class Alm:
    """The iteration: X (``low``) against its copies, and the distances between them (``trace``).

    penalty: η of the next iteration. tangent: T (F, n). left: L (n, d), kept where the factors move in turn only.
    """

    def __init__(
        self, start: Floats, observation: SmoothSparseModel, rank: int, dimension: int, params: Params
    ) -> None:
        self.rank, self.dimension, self.params = rank, dimension, params
        self.trace: list[float] = []
        self.penalty = params.penalty
        self.low = np.asfortranarray(start)
        self.alternating = params.factors == "alternating" and dimension < min(start.shape)
        if self.alternating:
            self.left = np.linalg.eigh(start.T @ start)[1][:, : -dimension - 1 : -1]
            self.right = start @ self.left
        self.tangent = top_singular_directions(self.low, rank)
        self.n_copies = 2 if observation.smoothness else 1
        self._move_low(self.low)
        self.copies = SplitCopies(self.low, observation)

    def run(self) -> bool:
        """The ramp, and the fixed penalty after it if asked for; whether X came to agree with its copies."""
        params = self.params
        settled = self._iterate(params.growth, params.tolerance, params.penalty_limit)
        if settled and params.polish:
            settled = self._iterate(1.0, params.polish_tolerance, params.polish)
        return settled

    def _iterate(self, growth: float, tolerance: float, limit: float) -> bool:
        while len(self.trace) < self.params.max_iterations:
            self._move_low(self.copies.update(self.penalty))
            following = min(growth * self.penalty, limit)
            self.copies.state, gap = self.copies.next_state(self.low, following / self.penalty)
            self.penalty = following
            self.trace.append(gap)
            if gap <= tolerance:
                return True
        return False

    def _move_low(self, target: Floats) -> None:
        """X and T from Z (F, n)."""
        threshold = 1.0 / (self.n_copies * self.penalty)
        lifted = np.multiply(self.tangent, threshold, out=self.tangent)
        lifted += target
        if self.alternating:
            across, _, along = np.linalg.svd(lifted.T @ self.right, full_matrices=False)
            self.left = across @ along
            self.right, _ = shrink_singular_values(lifted @ self.left, threshold)
            np.matmul(self.right, self.left.T, out=self.low)
            self.tangent = top_singular_directions(self.right, self.rank) @ self.left.T
        else:
            self.tangent = shrink_truncated(lifted, threshold, self.dimension, self.rank, self.low)
