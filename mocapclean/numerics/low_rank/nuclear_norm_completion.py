"""Matrix completion by the alternating direction method of multipliers, with three forms of the nuclear norm.

    min_X  Σ_{i>N} σ_i(X) − ⟨T, X⟩    subject to  X = D on the known entries

N = 0 and T = 0 is the nuclear norm, N > 0 the partial sum of singular values, T = U_r V_rᵀ the truncated nuclear norm.
With the completed matrix W, the multiplier Y and the penalty μ, one iteration is

    X = 𝒟_{N,1/μ}(W + Y/μ)    W = X on the unknown entries    Y += μ (D − X) on the known entries

The multiplier of the unknown entries is T throughout.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.anderson_acceleration import AndersonAcceleration
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values


class NuclearNormCompletion:
    """The iteration and its state, which one problem hands on to the next.

    low: (F, n), X. filled: (F, n), W, which is D on the known entries. penalty: μ. residual: ‖D − X‖_F over the known
    entries; change: ‖W − W before‖_F; both relative to ‖D‖_F. trace: the residual after every iteration.
    """

    def __init__(
        self, start: Floats, known: Bools, *, penalty: float, relaxation: float = 1.0, memory: int = 0
    ) -> None:
        """Start from W = start (F, n), which is D on the known entries, and the multiplier 0.

        relaxation: in (0, 2), the factor of every step; above 1 it hastens convergence: J. Eckstein, D. P. Bertsekas,
        1992, doi:10.1007/BF01581204. memory: that of Anderson acceleration, which hastens convergence more; 0: none.
        """
        self.filled, self.penalty, self.relaxation, self._memory = start.copy(), penalty, relaxation, memory
        self.low, self.residual, self.change = np.zeros_like(start), np.inf, np.inf
        self.trace: list[float] = []
        self._known, self._mask = known, known.astype(float)
        self._norm = float(np.linalg.norm(start[known])) or 1.0
        self._shifted = start.copy()  # W + Y/μ, the state of the fixed-point iteration
        self._step, self._unknown_step = np.empty_like(start), np.empty_like(start)

    @property
    def multiplier(self) -> Floats:
        """Y (F, n)."""
        return self.penalty * (self._shifted - self.filled)

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
        """Iterate until residual and change are within their tolerances; return whether they are.

        keep: N. tangent: T (F, n). growth: the factor of the penalty after an iteration with
        min(μ, √μ) · change ≤ ``settled``.
        """
        # Y = T on the unknown entries
        target = self.filled if tangent is None else self.filled + tangent / self.penalty
        np.copyto(self._shifted, target, where=~self._known)
        self._acceleration = AndersonAcceleration(self._memory, self._shifted.size)
        for _ in range(max_iterations):
            self._iterate(keep)
            if self.residual <= tolerance and self.change <= change_tolerance:
                return True
            if growth > 1.0 and min(self.penalty, self.penalty**0.5) * self.change <= settled:
                # Y stays while μ grows: W + Y/(growth μ)
                self._shifted -= self.filled
                self._shifted /= growth
                self._shifted += self.filled
                self.penalty *= growth
                self._acceleration = AndersonAcceleration(self._memory, self._shifted.size)
        return False

    def _iterate(self, keep: int) -> None:
        """Make one iteration in the form of a step of W + Y/μ: X − W on unknown entries, D − X on known ones."""
        shrink_singular_values(self._shifted, 1.0 / self.penalty, keep=keep, out=self.low)
        np.subtract(self.low, self.filled, out=self._unknown_step)
        np.multiply(self._unknown_step, self._mask, out=self._step)  # X − D on the known entries
        self._unknown_step -= self._step
        self.residual = float(np.linalg.norm(self._step)) / self._norm
        self.change = self.relaxation * float(np.linalg.norm(self._unknown_step)) / self._norm
        self.trace.append(self.residual)
        np.subtract(self._unknown_step, self._step, out=self._step)
        if self.relaxation != 1.0:
            self._unknown_step *= self.relaxation
            self._step *= self.relaxation
        if self._memory:
            # The accelerated step in place of the plain one; its unknown entries are the step of W.
            accelerated = self._acceleration.next_state(self._shifted, self._shifted + self._step)
            np.subtract(accelerated, self._shifted, out=self._step)
            np.multiply(self._step, self._mask, out=self._unknown_step)
            np.subtract(self._step, self._unknown_step, out=self._unknown_step)
        self.filled += self._unknown_step
        self._shifted += self._step
