"""Completion of a matrix by the alternating direction method, with three shapes of the nuclear norm.

    min_X  Σ_{i>N} σ_i(X) − ⟨T, X⟩    subject to  X = D on the known entries

N = 0 and T = 0 is the nuclear norm, N > 0 the partial sum of singular values, T = U_r V_rᵀ the truncated nuclear norm.
With W the completed matrix, Y the multiplier and μ the penalty, one iteration is

    X = 𝒟_{N,1/μ}(W + Y/μ)    W = X on the unknown entries    Y += μ (D − X) on the known entries

The multiplier of the unknown entries is T, from the first iteration on.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.extrapolation import Anderson
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values


class Completion:
    """The loop and what it carries from one problem to the next.

    low: (F, n), X. filled: (F, n), W, which is D on the known entries. residual: ‖D − X‖_F over the known entries;
    change: ‖W − W before‖_F; both relative to ‖D‖_F. trace: the residual after every iteration.
    """

    def __init__(
        self, start: Floats, known: Bools, *, penalty: float, relaxation: float = 1.0, memory: int = 0
    ) -> None:
        """Start from W = start (F, n), which is D on the known entries, and the multiplier 0.

        relaxation: in (0, 2), the factor of every step; above 1 it hastens convergence: J. Eckstein, D. P. Bertsekas,
        1992, doi:10.1007/BF01581204. memory: that of Anderson's extrapolation, which hastens it more; 0: none.
        """
        self.filled, self.penalty, self.relaxation, self._memory = start.copy(), penalty, relaxation, memory
        self.low, self.residual, self.change = np.zeros_like(start), np.inf, np.inf
        self.trace: list[float] = []
        self._known, self._mask = known, known.astype(float)
        self._norm = float(np.linalg.norm(start[known])) or 1.0
        self._input = start.copy()
        self._step, self._open = np.empty_like(start), np.empty_like(start)

    @property
    def multiplier(self) -> Floats:
        """Y (F, n)."""
        return self.penalty * (self._input - self.filled)

    def run(
        self,
        *,
        keep: int = 0,
        tangent: Floats | None = None,
        growth: float = 1.0,
        settled: float = 0.0,
        tolerance: float,
        change_tolerance: float,
        max_iterations: int,
    ) -> bool:
        """Iterate until residual and change are within their tolerances; whether they came to be.

        keep: N. tangent: T (F, n). growth: what the penalty is multiplied by when min(μ, √μ) · change is within
        ``settled``.
        """
        aim = self.filled if tangent is None else self.filled + tangent / self.penalty
        np.copyto(self._input, aim, where=~self._known)
        self._ahead = Anderson(self._memory, self._input.size)
        for _ in range(max_iterations):
            self._iterate(keep)
            if self.residual <= tolerance and self.change <= change_tolerance:
                return True
            if growth > 1.0 and min(self.penalty, self.penalty**0.5) * self.change <= settled:
                self._input -= self.filled
                self._input /= growth
                self._input += self.filled
                self.penalty *= growth
                self._ahead = Anderson(self._memory, self._input.size)
        return False

    def _iterate(self, keep: int) -> None:
        shrink_singular_values(self._input, 1.0 / self.penalty, keep=keep, out=self.low)
        np.subtract(self.low, self.filled, out=self._open)
        np.multiply(self._open, self._mask, out=self._step)
        self._open -= self._step
        self.residual = float(np.linalg.norm(self._step)) / self._norm
        self.change = self.relaxation * float(np.linalg.norm(self._open)) / self._norm
        self.trace.append(self.residual)
        np.subtract(self._open, self._step, out=self._step)
        if self.relaxation != 1.0:
            self._open *= self.relaxation
            self._step *= self.relaxation
        if self._memory:
            np.subtract(self._ahead.next(self._input, self._input + self._step), self._input, out=self._step)
            np.multiply(self._step, self._mask, out=self._open)
            np.subtract(self._step, self._open, out=self._open)
        self.filled += self._open
        self._input += self._step
