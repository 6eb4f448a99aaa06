"""Truncated nuclear norm with first and second differences: low rank beyond r, few and simple accelerations.

    min_X  ‖X‖_r + β₁ ‖D₁X‖₁ + β₂ ‖D₂X‖_*     subject to  X = M on the trusted entries,              (4), (5)

X (F, 3M) is the take with frames in rows, ‖X‖_r = Σ_{i>r} σ_i, D₁ the first difference over frames, D₂ = D₁D₁,
‖·‖₁ the sum of magnitudes. ‖X‖_r is a difference of convex functions: the outer loop replaces its concave part by
its tangent ⟨AᵀB, X⟩ (A, B the top r singular vectors), the inner loop is an ADMM with W = (X, X, D₁X, D₂X):

    X   = argmin Σ c_i ‖G_i X − W_i + U_i‖²  with the trusted entries held       (U_i the multipliers / ρ)
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
- One scalar spread normalises the data as printed, but the mean is taken for x, y and z apart: with one mean for
  all three the answer would depend on where the origin is.
- The data are the trusted entries only, and X starts as the linear interpolation with held ends, not with zeros.
- From an interpolated start the top singular vectors contain the interpolated gaps and protect them. So the rank
  is raised step by step (``rank_schedule``), each stage starting from the last; an empty schedule and a number
  for ``rank`` is the method as printed.
- The paper gives no weights, rank, penalty or limits. Those here come from benchmarks/trnn2_sweep.py.

Cost per iteration: two Gram matrices and products of F × 3M, O(F M²), two eigenproblems of 3M, O(M³), and one
pentadiagonal solve over the missing entries.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics import interpolation
from mocapclean.numerics.low_rank.differences import FreeSystem, add_adjoint, difference, normal_bands, times_bands
from mocapclean.numerics.low_rank.shrinkage import (
    shrink_singular_values,
    singular_values,
    spectral_gap_rank,
    top_singular_directions,
)
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

REFERENCE = "R. Imamura, M. Okuda, 2018, motion capture recovery by truncated nuclear norm and differences"
CHECK_EVERY = 10
TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The weights of the model, its rank, and the two loops."""

    rank: Annotated[
        Literal["auto"] | Annotated[int, Field(ge=0)],
        Field(description="r, 1, singular values left free; auto: the last wide gap of the spectrum"),
    ] = "auto"
    rank_gap: Annotated[
        float, Field(gt=0, description="θ, mm, least step between singular values for rank auto (Hu et al. 2017)")
    ] = 5.644
    rank_limit: Annotated[int, Field(ge=0, description="r_max, 1, largest rank that auto may choose")] = 15
    rank_schedule: Annotated[
        tuple[Annotated[int, Field(ge=0, strict=True)], ...],
        Field(strict=False, description="r_s, 1, ranks passed through on the way to r; empty: start at r"),
    ] = (0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 12)
    first_weight: Annotated[float, Field(ge=0, description="β₁, 1, weight of the first difference")] = 1e-2
    second_weight: Annotated[float, Field(ge=0, description="β₂, 1, weight of the second difference")] = 10.0
    penalty: Annotated[float, Field(gt=0, description="ρ, 1, penalty of the inner ADMM")] = 0.3
    form: Annotated[
        Literal["uniform", "paper"], Field(description="c, 1, penalty weights of the blocks: 1 or (1, 1, β₁, β₂)")
    ] = "uniform"
    x_step: Annotated[
        Literal["exact", "paper"], Field(description="X, 1, minimise over the free entries, or overwrite as printed")
    ] = "exact"
    d2: Annotated[
        Literal["clean", "paper"], Field(description="D₂, 1, end of the second difference: left out, or D₁D₁")
    ] = "clean"
    tolerance: Annotated[
        float, Field(ge=0, description="ε, 1, relative size of the primal and dual residuals to stop at")
    ] = 3e-4
    inner_iterations: Annotated[int, Field(ge=1, description="k, 1, most iterations of one inner loop")] = 80
    outer_iterations: Annotated[int, Field(ge=1, description="l, 1, most outer steps at the last rank; one before")] = 3
    max_iterations: Annotated[int, Field(ge=1, description="K, 1, most inner iterations in all")] = 3000


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence, edges included.

    The trace is the objective of the printed (4), in normalised units, after every outer step.
    """
    trusted, wanted = take.trusted, fillable(take.trusted)
    known = np.where(trusted[..., None], take.positions, 0.0)
    if not wanted.any():
        return Solution(positions=known, filled=wanted, reason="nothing to fill")
    used = trusted.any(axis=0)
    centre = known[trusted].mean(axis=0)
    spread = float(np.sqrt(np.mean((known[trusted] - centre) ** 2))) or 1.0
    start = interpolation.linear(take.positions[:, used], trusted[:, used])
    x = ((start - centre) / spread).reshape(len(start), -1)
    rank = min(_rank(x, spread, params), *x.shape)
    admm = Admm(x, ~trusted[:, used], params)
    converged, trace = _continue_rank(admm, rank, params)
    estimate = np.zeros_like(known)
    estimate[:, used] = admm.x.reshape(start.shape) * spread + centre
    return Solution(
        positions=np.where(wanted[..., None], estimate, known),
        filled=wanted,
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
    if admm.iterations == params.max_iterations:
        return f"max_iterations {params.max_iterations} reached; residual {admm.residual:.1e}"
    return f"outer_iterations {params.outer_iterations} reached; residual {admm.residual:.1e}"


def _continue_rank(admm: "Admm", rank: int, params: Params) -> tuple[bool, list[float]]:
    """Raise the rank through the schedule; whether the last stage converged, and the objectives."""
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
    """The inner loop and what it carries from one convex problem to the next.

    x: (F, 3M) the iterate, exact where trusted. For the blocks i = 1, 3, 4, ``u`` is the multiplier divided by ρ
    and ``q`` is W − U, used up by the step in X; block 2 needs none, see the head of this module.
    """

    def __init__(self, x: Floats, missing: Bools, params: Params) -> None:
        self.x, self.params, self.iterations, self.residual = x, params, 0, np.inf
        beta1, beta2 = params.first_weight, params.second_weight
        paper = params.form == "paper"
        self.c3, self.c4 = ((b if paper else 1.0) if b else 0.0 for b in (beta1, beta2))
        self.t1, self.t3, self.t4 = (t / params.penalty for t in ((1, 1, 1) if paper else (1, beta1, beta2)))
        self.keep_end = params.d2 == "paper"
        self.known = ~missing
        self.values = _samples(x)[self.known.ravel()]
        free = missing if params.x_step == "exact" else np.ones_like(missing)
        bands = normal_bands(len(x), 2.0, self.c3, self.c4, keep_end=self.keep_end)
        self.system = FreeSystem(bands, free)
        held = np.where(np.repeat(free, 3, axis=1), 0.0, x)
        self.pull = self._free(times_bands(bands, held))
        self.d1 = difference(x)
        self.d2 = difference(self.d1, keep_end=self.keep_end)
        self.q1, self.q3, self.q4 = x.copy(), self.c3 * self.d1, self.c4 * self.d2
        self.u1, self.u3, self.u4 = (np.zeros_like(block) for block in (x, self.d1, self.d2))

    def _free(self, matrix: Floats) -> Floats:
        samples: Floats = _samples(matrix).take(self.system.places, axis=0, mode="clip")
        return samples

    def minimise(self, rank: int) -> bool:
        """Minimise the convex problem tangent at x; whether both residuals came below the tolerance."""
        params = self.params
        tangent = self._free(top_singular_directions(self.x, rank)) / params.penalty
        for k in range(1, params.inner_iterations + 1):
            self._move_x(tangent)
            self._move_blocks()
            self.iterations += 1
            if k % CHECK_EVERY == 0:
                self.residual = self._residual(tangent)
                if self.residual <= params.tolerance:
                    return True
            if self.iterations == params.max_iterations:
                break
        return False

    def _move_x(self, tangent: Floats) -> None:
        add_adjoint(self.q3, self.q4, keep_end=self.keep_end)
        add_adjoint(self.q1, self.q3)
        solution = self.system.solve(self._free(self.q1) + self._free(self.x) + tangent - self.pull)
        _samples(self.x)[self.system.places] = solution
        if self.params.x_step == "paper":
            _samples(self.x)[self.known.ravel()] = self.values

    def _move_blocks(self) -> None:
        difference(self.x, out=self.d1)
        difference(self.d1, keep_end=self.keep_end, out=self.d2)
        self.u1 += self.x
        shrink_singular_values(self.u1, self.t1, out=self.q1)
        self.u1 -= self.q1
        self.q1 -= self.u1
        if self.c3:
            self.u3 += self.d1
            np.clip(self.u3, -self.t3, self.t3, out=self.q3)
            self.u3 -= self.q3
            self.u3 -= self.q3
            self.u3, self.q3 = self.q3, self.u3
            self.q3 *= self.c3
        else:
            self.q3.fill(0.0)
        if self.c4:
            self.u4 += self.d2
            shrink_singular_values(self.u4, self.t4, out=self.q4)
            self.u4 -= self.q4
            self.q4 -= self.u4
            self.q4 *= self.c4

    def _residual(self, tangent: Floats) -> float:
        """The larger of the primal residual, relative to X, and the dual one, relative to the multiplier of X."""
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
        """‖X‖_r + β₁ ‖D₁X‖₁ + β₂ ‖D₂X‖_* of the iterate."""
        params = self.params
        total = singular_values(self.x)[rank:].sum()
        total += params.first_weight * np.abs(self.d1).sum()
        total += params.second_weight * singular_values(self.d2).sum()
        return float(total)


def _samples(matrix: Floats) -> Floats:
    return matrix.reshape(-1, 3)
