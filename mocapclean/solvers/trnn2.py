"""Truncated nuclear norm with first and second differences: low rank beyond r, few and simple accelerations.

    min_X  ‖X‖_r + β₁ ‖D₁X‖₁ + β₂ ‖D₂X‖_*     subject to  X = M on the trusted entries,              (4), (5)

X (F, 3M) is the take with frames in rows, ‖X‖_r = Σ_{i>r} σ_i, D₁ the first difference over frames, D₂ = D₁D₁,
‖·‖₁ the sum of magnitudes. ‖X‖_r is a difference of convex functions: the outer loop replaces its concave part by
its tangent ⟨AᵀB, X⟩ (A, B the top r singular vectors), the inner loop is an ADMM with W = (X, X, D₁X, D₂X):

    X   = argmin Σ c_i ‖G_i X − W_i + U_i‖²  with the trusted entries fixed      (U_i the multipliers / ρ)
    W₁  = 𝒟_{1/ρ}(X + U₁)    W₃ = 𝒮_{β₁/(c₃ρ)}(D₁X + U₃)    W₄ = 𝒟_{β₂/(c₄ρ)}(D₂X + U₄)    U_i += G_i X − W_i

R. Imamura, M. Okuda, 2018.

Where this departs from the print, and why:

- ``form="uniform"`` has c = (1, 1, 1, 1), the ADMM of the printed (9). The printed updates (10)-(15) are the
  ADMM with c = (1, 1, β₁, β₂), ``form="paper"``; both have the same minimisers, the former converges faster.
  A block whose β is 0 is left out.
- The printed (11) solves for X without the constraint and then overwrites the trusted entries. As the differences
  couple the frames, that is no minimiser; ``x_step="exact"`` solves for the free entries, given the trusted ones.
- The square D₁D₁ has a first difference in its last but one row; ``d2="clean"`` leaves it out.
- W₂ = X and U₂ = −AᵀB/ρ from the first iteration on, so neither is stored.
- One scalar spread normalises the data as printed, but x, y and z have a mean each: with one mean for
  all three the answer would depend on the origin of the coordinates.
- The data are the trusted entries only. X starts as the linear interpolation, constant at the ends, not with zeros.
- From an interpolated start the top singular vectors contain the interpolated gaps and protect them. So the rank
  is raised step by step (``rank_schedule``), each stage starting from the last; an empty schedule and a number
  for ``rank`` are the method as printed.
- The paper gives no weights, rank, penalty or limits. Those here come from benchmarks/trnn2_sweep.py.

Cost per iteration: two Gram matrices and products of F × 3M, O(F M²), two eigenproblems of 3M, O(M³), and one
pentadiagonal solve over the missing entries.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics import interpolation
from mocapclean.numerics.low_rank.differences import FreeSystem, add_adjoint, difference, normal_bands, times_bands
from mocapclean.numerics.low_rank.shrinkage import (
    shrink_singular_values,
    singular_values,
    spectral_gap_rank,
    top_singular_directions,
)
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = "R. Imamura, M. Okuda, 2018, motion capture recovery by truncated nuclear norm and differences"

TRAITS = Traits()

CHECK_EVERY = 10  # iterations from one computation of the residuals to the next; no sweep was kept
TINY = np.finfo(np.float64).tiny  # keeps a quotient of norms finite where both are 0


@parameters
class Params:
    """The weights of the model, its rank, and the two loops."""

    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(),
        About(symbol="r", text="singular values left free; auto: the last wide gap of the spectrum"),
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
    first_weight: Annotated[float, Field(ge=0), About(symbol="β₁", text="weight of the first difference")] = 1e-2
    second_weight: Annotated[float, Field(ge=0), About(symbol="β₂", text="weight of the second difference")] = 10.0
    penalty: Annotated[float, Field(gt=0), About(symbol="ρ", text="penalty of the inner ADMM")] = 0.3
    form: Annotated[
        Literal["uniform", "paper"], About(symbol="c", text="penalty weights of the blocks: 1 or (1, 1, β₁, β₂)")
    ] = "uniform"
    x_step: Annotated[
        Literal["exact", "paper"], About(symbol="X", text="minimise over the free entries, or overwrite as printed")
    ] = "exact"
    d2: Annotated[
        Literal["clean", "paper"], About(symbol="D₂", text="end of the second difference: left out, or D₁D₁")
    ] = "clean"
    tolerance: Annotated[
        float, Field(ge=0), About(symbol="ε", text="relative size of the primal and dual residuals to stop at")
    ] = 3e-4
    inner_iterations: Annotated[int, Field(ge=1), About(symbol="k", text="most iterations of one inner loop")] = 80
    outer_iterations: Annotated[
        int, Field(ge=1), About(symbol="l", text="most outer steps at the last rank; one before")
    ] = 3
    max_iterations: Annotated[int, Field(ge=1), About(symbol="K", text="most inner iterations in all")] = 3000


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled.

    The trace is the objective of the printed (4), in normalised units, after every outer step.
    """
    trusted = take.trusted
    known = np.where(trusted[..., None], take.positions, 0.0)
    # M: the positions about their mean, divided by one spread, gaps interpolated
    used = trusted.any(axis=0)
    centre = known[trusted].mean(axis=0)
    spread = float(np.sqrt(np.mean((known[trusted] - centre) ** 2))) or 1.0
    start = interpolation.linear(take.positions[:, used], trusted[:, used])
    x = ((start - centre) / spread).reshape(len(start), -1)
    rank = min(_rank(x, spread, params), *x.shape)
    admm = Admm(x, ~trusted[:, used], params)
    converged, trace = _raise_rank(admm, rank, params)
    estimate = np.zeros_like(known)
    estimate[:, used] = admm.x.reshape(start.shape) * spread + centre
    return Solution(
        positions=np.where(fillable[..., None], estimate, known),
        filled=fillable,
        converged=converged,
        iterations=admm.iterations,
        reason=_reason(converged, admm, params),
        trace=tuple(trace),
        facts={"rank": rank, "spread_mm": spread},
    )


def _rank(x: Floats, spread: float, params: Params) -> int:
    if params.rank == "auto":
        return spectral_gap_rank(x, params.rank_gap / spread, params.rank_limit)
    return params.rank


def _reason(converged: bool, admm: "Admm", params: Params) -> str:
    if converged:
        return f"primal and dual residuals are within {params.tolerance:g} at the last rank"
    limit = "max_iterations" if admm.iterations == params.max_iterations else "outer_iterations"
    return limit_reached(params, limit, f"residual {admm.residual:.1e}")


def _raise_rank(admm: "Admm", rank: int, params: Params) -> tuple[bool, list[float]]:
    """Raise the rank through the schedule; return whether the last stage converged, and the objectives."""
    trace: list[float] = []
    for stage in [*(r for r in params.rank_schedule if r < rank), rank]:
        before, converged = np.inf, False
        for _ in range(params.outer_iterations if stage == rank else 1):
            if converged or admm.iterations == params.max_iterations:
                break
            settled = admm.minimise(stage)
            trace.append(admm.objective(stage))
            converged = settled and (stage == 0 or before - trace[-1] <= params.tolerance * trace[-1])
            before = trace[-1]
    return converged, trace


class Admm:
    """The inner loop, and its state from one convex problem to the next.

    x: (F, 3M) the iterate, exact where trusted. For the blocks i = 1, 3, 4, ``u`` is the multiplier divided by ρ, ``c``
    the weight, ``t`` the threshold times c, and ``q`` is W − U, consumed by the step in X. Block 2 needs none of them,
    see the docstring of this module.
    """

    def __init__(self, x: Floats, missing: Bools, params: Params) -> None:
        self.x, self.params, self.iterations, self.residual = x, params, 0, np.inf
        # c_i is 1, or (1, 1, β₁, β₂) in the paper's form; 0 leaves a block out. t_i = c_i times the threshold.
        beta1, beta2 = params.first_weight, params.second_weight
        paper = params.form == "paper"
        self.c3, self.c4 = ((b if paper else 1.0) if b else 0.0 for b in (beta1, beta2))
        self.t1, self.t3, self.t4 = (t / params.penalty for t in ((1, 1, 1) if paper else (1, beta1, beta2)))
        self.keep_end = params.d2 == "paper"
        # The normal equations of the step in X over its free entries, and the pull of the fixed ones.
        self.known = ~missing
        self.values = _samples(x)[self.known.ravel()]
        free = missing if params.x_step == "exact" else np.ones_like(missing)
        bands = normal_bands(len(x), 2.0, self.c3, self.c4, keep_end=self.keep_end)
        self.system = FreeSystem(bands, free)
        fixed = np.where(np.repeat(free, 3, axis=1), 0.0, x)
        self.pull, self.free_x = self._free(times_bands(bands, fixed)), self._free(x)
        # W_i = G_i X and U_i = 0
        self.d1 = difference(x)
        self.d2 = difference(self.d1, keep_end=self.keep_end)
        self.q1, self.q3, self.q4 = x.copy(), self.c3 * self.d1, self.c4 * self.d2
        self.u1, self.u3, self.u4 = (np.zeros_like(block) for block in (x, self.d1, self.d2))

    def _free(self, matrix: Floats) -> Floats:
        """Return the free samples (n, 3) of a matrix (F, 3M)."""
        samples: Floats = _samples(matrix).take(self.system.places, axis=0, mode="clip")
        return samples

    def minimise(self, rank: int) -> bool:
        """Minimise the convex problem tangent at x; return whether both residuals came below the tolerance."""
        params = self.params
        # AᵀB / ρ
        tangent = self._free(top_singular_directions(self.x, rank)) / params.penalty
        force = tangent - self.pull
        for k in range(1, params.inner_iterations + 1):
            self._move_x(force)
            self._move_blocks()
            self.iterations += 1
            if k % CHECK_EVERY == 0:
                self.residual = self._residual(tangent)
                if self.residual <= params.tolerance:
                    return True
            if self.iterations == params.max_iterations:
                break
        return False

    def _move_x(self, force: Floats) -> None:
        """Set X = argmin Σ c_i ‖G_i X − W_i + U_i‖² over the free entries; force: the tangent less the pull."""
        # q₁ + D₁ᵀ (q₃ + D₂ᵀ q₄), then block 2 with W₂ = X and U₂ = −AᵀB/ρ
        add_adjoint(self.q3, self.q4, keep_end=self.keep_end)
        add_adjoint(self.q1, self.q3)
        right_side = self._free(self.q1)
        right_side += self.free_x
        right_side += force
        self.free_x = self.system.solve(right_side)
        _samples(self.x)[self.system.places] = self.free_x
        if self.params.x_step == "paper":
            # (11): overwrite the trusted entries
            _samples(self.x)[self.known.ravel()] = self.values
            self.free_x = self._free(self.x)

    def _move_blocks(self) -> None:
        """Set W_i and U_i from X, and q_i = c_i (W_i − U_i)."""
        difference(self.x, out=self.d1)
        difference(self.d1, keep_end=self.keep_end, out=self.d2)
        # W₁ = 𝒟_{1/ρ}(X + U₁), U₁ += X − W₁
        self.u1 += self.x
        shrink_singular_values(self.u1, self.t1, out=self.q1)
        self.u1 -= self.q1
        self.q1 -= self.u1
        if self.c3:
            # V = D₁X + U₃; U₃ = V clipped to ±β₁/(c₃ρ), W₃ = V − U₃, so W₃ − U₃ = V − 2 U₃
            self.u3 += self.d1
            np.clip(self.u3, -self.t3, self.t3, out=self.q3)
            self.u3 -= self.q3
            self.u3 -= self.q3
            self.u3, self.q3 = self.q3, self.u3
            self.q3 *= self.c3
        else:
            self.q3.fill(0.0)
        if self.c4:
            # W₄ = 𝒟_{β₂/(c₄ρ)}(D₂X + U₄), U₄ += D₂X − W₄
            self.u4 += self.d2
            shrink_singular_values(self.u4, self.t4, out=self.q4)
            self.u4 -= self.q4
            self.q4 -= self.u4
            self.q4 *= self.c4

    def _residual(self, tangent: Floats) -> float:
        """Return the larger of the primal residual, relative to X, and the dual one, relative to U₁."""
        # Primal: G_i X − W_i, with W_i = q_i / c_i + U_i; dual: Σ c_i G_iᵀ U_i less the tangent
        gaps = [np.linalg.norm(self.x - self.q1 - self.u1)]
        gradient, inner = self.u1.copy(), np.zeros_like(self.u3)
        if self.c3:
            gaps.append(np.sqrt(self.c3) * np.linalg.norm(self.d1 - self.q3 / self.c3 - self.u3))
            inner += self.c3 * self.u3
        if self.c4:
            gaps.append(np.sqrt(self.c4) * np.linalg.norm(self.d2 - self.q4 / self.c4 - self.u4))
            add_adjoint(inner, self.c4 * self.u4, keep_end=self.keep_end)
        add_adjoint(gradient, inner)
        slope = self._free(gradient) - tangent
        if self.params.x_step == "paper":
            slope = self.system.solve(slope)[~self.known.ravel()[self.system.places]]
        primal, dual = np.linalg.norm(gaps), np.linalg.norm(slope)
        return float(max(primal / (np.linalg.norm(self.x) + TINY), dual / (np.linalg.norm(self.u1) + TINY)))

    def objective(self, rank: int) -> float:
        """Return ‖X‖_r + β₁ ‖D₁X‖₁ + β₂ ‖D₂X‖_* of the iterate."""
        params = self.params
        total = singular_values(self.x)[rank:].sum()
        total += params.first_weight * np.abs(self.d1).sum()
        total += params.second_weight * singular_values(self.d2).sum()
        return float(total)


def _samples(matrix: Floats) -> Floats:
    """Return the samples (F M, 3) of a matrix (F, 3M), as a view."""
    return matrix.reshape(-1, 3)
