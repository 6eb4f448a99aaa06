"""Truncated nuclear norm in factored form, temporally smooth, with sparse noise.

    min_{X,S}  ‖X‖_r + λ ‖P_Ω(S)‖₁ + (μ/2) ‖OX‖_F²     subject to  P_Ω(X + S) = P_Ω(D),  rank X ≤ d        (3)

‖X‖_r = Σ_{i>r} σ_i leaves the r largest singular values free; the rest is ``tsmc``. X = R Lᵀ with LᵀL = I, R (F, d),
so that ‖X‖_* = ‖R‖_*; the free part is the tangent T = U_r V_rᵀ of the top singular vectors of the previous X. With the
copies M and C = P_Ω(D) − S and N = (M + C)/2 + (Y₁ + Y₂ + T)/(2η) one iteration is

    R, L = argmin ‖R‖_* + η ‖R Lᵀ − N‖²      then S, M, Y₁, Y₂ as in ``tsmc`` and η ← min(ρη, η_max)

W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, IEEE Signal Processing Letters.

Where this departs from the print, and why:

- The print moves L, the polar factor of NᵀR, and then R = 𝒟_{1/(2η)}(N L). Where R has lost rank that factor is not
  unique. Both at once are the d largest singular values of N, shrunk, at the same cost for a matrix of a body's size;
  ``factors="alternating"`` is the printed step. U and V come from X together, not by one half-step each. The fixed
  points are the same.
- The text has no equations for S and M; these are the minimisers. The convergence test names E for S.
- The printed growth ρ = 1.4 freezes X within some 50 iterations near its start: on long gaps it is little better
  than straight lines and worse than ``tsmc``. ρ = 1.02 leaves time to move away; with that it is mostly better. The
  penalty grows between X and its copies. ``polish`` goes on with a fixed penalty until X is stationary.
- d, η_max and the start are not printed: d is the rank rule without its limit, η_max 1e10. Gaps start at the mean, so
  that the top singular vectors of a line across them do not protect that line; ``start="interpolated"`` has the line.
  Both ranks are those of the interpolated matrix, as printed.
- Data are about their mean and divided by ``unit``, as in ``tsmc``.

With a slowly growing penalty the iteration is long and not convex: where several minima are as good, rounding may
choose among them.

Cost per iteration: a Gram matrix and two products of F × 3M, O(F M²), an eigenproblem of 3M, O(M³), and a
pentadiagonal solve, O(F M).
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.shrinkage import (
    shrink_singular_values,
    shrink_truncated,
    spectral_gap_rank,
    top_singular_directions,
)
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SmoothSparseModel, SplitCopies
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.solvers.sparse_noise import NoisyTake
from mocapclean.take import Solution, Take

REFERENCE = (
    "W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, Motion capture data completion via truncated nuclear "
    "norm regularization, IEEE Signal Process. Lett."
)

TRAITS = Traits(cleans_complete_takes=True)

_SEPARATION_PENALTY = 1.25  # η₀ ‖D‖₂ of Hu's experiment on synthetic matrices


@parameters
class Params:
    """The weights of the model, its ranks, and the growth of the penalty."""

    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(),
        About(symbol="r", text="singular values left free; auto: the last wide gap of the spectrum"),
    ] = "auto"
    rank_gap: Annotated[
        float, Field(gt=0), About(symbol="θ", unit="mm", text="least step between singular values for auto")
    ] = 5.644
    rank_limit: Annotated[int, Field(ge=0), About(symbol="r_max", text="largest rank that auto may choose")] = 15
    dimension: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=1)],
        Field(),
        About(symbol="d", text="largest rank of X; auto: the last wide gap without the limit, at least r"),
    ] = "auto"
    factors: Annotated[
        Literal["joint", "alternating"], About(symbol="R L'", text="minimise over both factors at once, or in turn")
    ] = "joint"
    start: Annotated[
        Literal["interpolated", "zero"], About(symbol="X_0", text="gaps start as straight lines, or at the mean")
    ] = "zero"
    sparsity: Annotated[float, Field(gt=0), About(symbol="λ √max(F, 3M)", text="weight of the noise")] = 100.0
    smoothness: Annotated[
        float, Field(ge=0), About(symbol="μ", unit="1/unit", text="weight of the squared differences")
    ] = 100.0
    unit: Annotated[float, Field(gt=0), About(symbol="u", unit="mm", text="length that counts as 1 (CMU: 56.444)")] = (
        56.444
    )
    penalty: Annotated[float, Field(gt=0), About(symbol="η₀", unit="1/unit", text="penalty at the start")] = 1e-5
    growth: Annotated[float, Field(ge=1, le=10), About(symbol="ρ", text="factor of the penalty in every iteration")] = (
        1.02
    )
    penalty_limit: Annotated[float, Field(gt=0), About(symbol="η_max", unit="1/unit", text="largest penalty")] = 1e10
    tolerance: Annotated[
        float, Field(ge=0), About(symbol="ε", text="distance of X from its copies to stop at, relative to the data")
    ] = 1e-4
    polish: Annotated[
        float,
        Field(ge=0),
        About(symbol="η_f", unit="1/unit", text="fixed penalty to go on with after the growing one; 0: stop there"),
    ] = 0.0
    polish_tolerance: Annotated[float, Field(ge=0), About(symbol="ε_f", text="as tolerance, for the fixed penalty")] = (
        1e-6
    )
    denoise: Annotated[bool, About(symbol="S", text="offer trusted samples less their noise as well")] = False
    max_iterations: Annotated[int, Field(ge=1), About(symbol="K", text="most iterations in all")] = 3000


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled; ``outliers`` is S.

    The trace is the distance of X from its copies, relative to the data.
    """
    noisy = NoisyTake(take, params.unit)
    rank, dimension = ranks_of(noisy.start, params)
    start = noisy.start if params.start == "interpolated" else noisy.data.values / params.unit
    iteration = Alm(start, noisy.observe(params.sparsity, params.smoothness), rank, dimension, params)
    converged = iteration.run()
    state = f"X is within {iteration.trace[-1]:.1e} of its copies"
    return noisy.solution(
        iteration.low,
        iteration.copies,
        fillable,
        denoise=params.denoise,
        converged=converged,
        reason=state if converged else limit_reached(params, "max_iterations", state),
        trace=iteration.trace,
        facts={"rank": rank, "dimension": dimension},
    )


def ranks_of(start: Floats, params: Params) -> tuple[int, int]:
    """Return r and d for an interpolated matrix (F, n) in units of ``unit``."""
    gap, most = params.rank_gap / params.unit, min(start.shape)
    rank = spectral_gap_rank(start, gap, params.rank_limit) if params.rank == "auto" else params.rank
    dimension = spectral_gap_rank(start, gap, most) if params.dimension == "auto" else params.dimension
    return min(rank, most), min(max(rank, dimension, 1), most)


def separate(
    matrix: Floats, rank: int, *, growth: float = 1.5, tolerance: float = 1e-7, max_iterations: int = 1000
) -> tuple[Floats, Floats, int]:
    """Return a matrix (F, n) as the sum of one of rank at most ``rank`` and a sparse one, and the iterations taken.

    This is Hu's experiment on synthetic matrices: μ = 0, Ω everything, λ = 1/√max(F, n), d = r, η₀ = 1.25 / ‖D‖₂.
    """
    everything = np.ones(matrix.shape, dtype=bool, order="F")
    weight = 1.0 / max(matrix.shape) ** 0.5
    observation = SmoothSparseModel(data=np.asfortranarray(matrix), known=everything, sparsity=weight, smoothness=0.0)
    penalty = _SEPARATION_PENALTY / (float(np.linalg.norm(matrix, 2)) or 1.0)
    params = Params(penalty=penalty, growth=growth, tolerance=tolerance, max_iterations=max_iterations)
    iteration = Alm(matrix, observation, rank, rank, params)
    iteration.run()
    return iteration.low, observation.outliers(iteration.copies.clean), len(iteration.trace)


class Alm:
    """The augmented Lagrangian iteration: X (``low``) against its copies, and the distances between them (``trace``).

    penalty: η of the next iteration. tangent: T (F, n). left: L (n, d) and right: R (F, d), kept only where the factors
    move in turn.
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
        """Iterate with the growing penalty, then with the fixed one if asked for; return whether X agrees at last."""
        params = self.params
        settled = self._iterate(params.growth, params.tolerance, params.penalty_limit)
        if settled and params.polish:
            settled = self._iterate(1.0, params.polish_tolerance, params.polish)
        return settled

    def _iterate(self, growth: float, tolerance: float, limit: float) -> bool:
        """Iterate until X is within the tolerance of its copies; return whether it came there."""
        while len(self.trace) < self.params.max_iterations:
            self._move_low(self.copies.update(self.penalty))
            # η ← min(ρη, η_max); the multipliers in the state are divided by η, so they scale with it.
            following = min(growth * self.penalty, limit)
            self.copies.state, distance = self.copies.next_state(self.low, following / self.penalty)
            self.penalty = following
            self.trace.append(distance)
            if distance <= tolerance:
                return True
        return False

    def _move_low(self, target: Floats) -> None:
        """Set X and T from the mean of the copies and multipliers (F, n)."""
        # N = target + T / (2η), with 2η the number of copies times η
        threshold = 1.0 / (self.n_copies * self.penalty)
        shifted = np.multiply(self.tangent, threshold, out=self.tangent)
        shifted += target
        if self.alternating:
            # L = the polar factor of NᵀR, then R = 𝒟_{1/(2η)}(N L), X = R Lᵀ, T = U_r V_rᵀ of R, times Lᵀ
            across, _, along = np.linalg.svd(shifted.T @ self.right, full_matrices=False)
            self.left = across @ along
            self.right, _ = shrink_singular_values(shifted @ self.left, threshold)
            np.matmul(self.right, self.left.T, out=self.low)
            self.tangent = top_singular_directions(self.right, self.rank) @ self.left.T
        else:
            # X = the d largest singular values of N, shrunk by 1/(2η)
            self.tangent = shrink_truncated(shifted, threshold, self.dimension, self.rank, self.low)
