"""Partial singular value thresholding: the first N singular values are free, the others are small.

    min_X      Σ_{i>N} σ_i(X)             subject to  X = D on the trusted entries             (mode completion)
    min_{X,E}  Σ_{i>N} σ_i(X) + λ ‖E‖₁    subject to  X + E = D, E free on the untrusted       (mode robust)

The iterations are those of ``ialm`` with another shrinkage, which leaves the first N singular values unchanged:
argmin_X ½‖X − Q‖² + τ Σ_{i>N} σ_i(X) = U diag(σ_1 .. σ_N, max(σ_{N+1} − τ, 0), ..) Vᵀ. N = 0 is ``ialm``.

T.-H. Oh, Y.-W. Tai, J.-C. Bazin, H. Kim, I. S. Kweon, 2016, doi:10.1109/TPAMI.2015.2465956.

Departures, modes and cost are those of ``ialm``, and:

- The problem is not convex, so the answer depends on the start. In mode completion N is raised step by step
  (``rank_schedule``), each stage starting from the last, the first from 0 (the mean) on the untrusted entries; an
  empty schedule starts at N. The growing penalty (``schedule="paper"``) does not settle there with N > 1.
  Only N = 0 is extrapolated.
- The paper takes N as known; the defaults here come from benchmarks/low_rank_sweep.py. ``rank`` auto is the rule of
  ``trnn``; with its 15 values the completion often does not settle in ``max_iterations``.
"""

from typing import Annotated, Literal

from mocapclean.arrays import Bools
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers import ialm
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = (
    "T.-H. Oh, Y.-W. Tai, J.-C. Bazin, H. Kim, I. S. Kweon, 2016, Partial sum minimization of singular values in "
    "robust PCA, doi:10.1109/TPAMI.2015.2465956"
)

TRAITS = Traits()


@parameters
class Params(ialm.Params):
    """The parameters of ``ialm``, and the number of free singular values."""

    penalty: Annotated[float, Field(gt=0), About(symbol="μ‖D‖₂", text="penalty of the fixed schedule")] = 300.0
    relaxation: Annotated[
        float, Field(gt=0, lt=2), About(symbol="α", text="fixed schedule: factor of every step, above 1 to go further")
    ] = 1.0
    growth: Annotated[
        float, Field(ge=1), About(symbol="ρ", text="robust: factor of the penalty in every iteration; 1.5 as printed")
    ] = 1.02
    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(),
        About(symbol="N", text="singular values left free; auto: the last wide gap of the interpolated spectrum"),
    ] = 6
    rank_gap: Annotated[
        float,
        Field(gt=0),
        About(symbol="θ", unit="mm", text="least step between singular values for rank auto (Hu et al. 2017)"),
    ] = 5.644
    rank_limit: Annotated[int, Field(ge=0), About(symbol="N_max", text="largest rank that auto may choose")] = 15
    rank_schedule: Annotated[
        tuple[Annotated[int, Field(ge=0, strict=True)], ...],
        Field(strict=False),
        About(symbol="N_s", text="completion: ranks passed through before N; empty: start at N"),
    ] = (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12)
    stage_iterations: Annotated[
        int, Field(ge=1), About(symbol="k", text="most iterations at a rank passed through")
    ] = 100


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled; trace and outliers are those of ``ialm``."""
    rank = params.rank
    if rank == "auto":
        rank = centred_matrix(take.positions, take.trusted).gap_rank(params.rank_gap, params.rank_limit)
    ranks = [*(r for r in params.rank_schedule if r < rank), rank]
    return ialm.fill_with_ranks(take, params, fillable, ranks, params.stage_iterations)
