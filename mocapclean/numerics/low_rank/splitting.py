"""Low rank, smooth and sparsely corrupted: the splitting of such a model into one low-rank and two easy parts.

    min_X  N(X) + λ ‖P_Ω(D − X)‖₁ + (μ/2) ‖OX‖_F²

N is a (truncated) nuclear norm, Ω the known entries, O of ``numerics.smoothness``. The augmented Lagrangian method
with a smooth copy M and a clean copy C = P_Ω(D) − S of X, multipliers Y₁, Y₂ and penalty η alternates between X,

    X = argmin N(X) + η ‖X − Z‖²,     Z = (M + C)/2 + (Y₁ + Y₂)/(2η),                 (the method's own part)

and the copies with their multipliers, which this module holds:

    M = (I + (μ/η) OᵀO)⁻¹ (X − Y₁/η)      S = 𝒮_{λ/η}(D − X + Y₂/η) on Ω, free elsewhere
    Y₁ += η (M − X)                       Y₂ += η (C − X)

X − Y/η before the update is all that need be remembered; the update maps it to itself plus X − (M, C). This is
Douglas-Rachford splitting: J. Eckstein, D. P. Bertsekas, 1992, doi:10.1007/BF01581204.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.smoothness import roughness, smooth

TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The data term and the smoothness term of the model.

    data: (F, n), read where known only. known: (F, n) bool. sparsity: λ. smoothness: μ. order: of O, 1 or 2.
    """

    data: Floats
    known: Bools
    sparsity: float
    smoothness: float
    order: int = 2

    def outliers(self, clean: Floats) -> Floats:
        """S (F, n): what a clean copy leaves of the known entries; 0 elsewhere."""
        return np.where(self.known, self.data - clean, 0.0)

    def cost(self, low_rank: Floats) -> float:
        """λ ‖P_Ω(D − X)‖₁ + (μ/2) ‖OX‖_F²."""
        absolute = np.abs(self.outliers(low_rank)).sum()
        return float(self.sparsity * absolute + self.smoothness / 2 * roughness(low_rank, self.order))


class Copies:
    """M and C with their multipliers.

    state: (k, n F), the rows X − Y/η, with the frames of one column side by side. Where μ is 0, M and Y₁ are left out
    (k = 1). smooth, clean: M and C, (F, n); M is C where it is left out. Both hold after ``settle``.
    """

    def __init__(self, start: Floats, observation: Observation) -> None:
        self.observation, self.shape = observation, start.shape
        self.n_copies = 2 if observation.smoothness else 1
        self.state = np.tile(start.T.ravel(), (self.n_copies, 1))
        self.scale = float(np.linalg.norm(observation.data[observation.known])) + TINY
        self._data = np.where(observation.known, observation.data, 0.0)
        self._mask = observation.known.astype(float)
        self.clean, self._pull, self._target, self._gap = (np.empty_like(self._data) for _ in range(4))
        self.smooth = self.clean

    def matrix(self, row: Floats) -> Floats:
        """A row of the state as its matrix (F, n), in Fortran order."""
        return row.reshape(self.shape[::-1]).T

    def settle(self, penalty: float) -> Floats:
        """Move the copies to the state's; Z (F, n), the target of the step in X, to be used before the next call."""
        given, before, pull = self.observation, self.matrix(self.state[-1]), self._pull
        threshold = given.sparsity / penalty
        np.subtract(before, self._data, out=self.clean)
        np.clip(self.clean, -threshold, threshold, out=pull)
        pull *= self._mask
        self.clean -= pull
        self.clean += self._data
        if self.n_copies == 1:
            return np.subtract(self.clean, pull, out=self._target)
        other = self.matrix(self.state[0])
        self.smooth = smooth(other, given.smoothness / penalty, given.order)
        np.subtract(before, other, out=self._target)
        self._target *= 0.5
        self._target += self.smooth
        self._target -= pull
        return self._target

    def image(self, low_rank: Floats, growth: float = 1.0) -> tuple[Floats, float]:
        """The state after a step to X, and how far X is from its copies, relative to the data.

        growth: the factor by which the penalty grows from this iteration to the next.
        """
        image, largest = np.empty_like(self.state), 0.0
        for row, before, copy in zip(image, self.state, self._copies(), strict=True):
            after = self.matrix(row)
            np.subtract(low_rank, copy, out=self._gap)
            largest = max(largest, float(np.linalg.norm(self._gap.T.ravel())))
            np.subtract(self.matrix(before), copy, out=after)
            if growth != 1.0:
                after /= growth
            after += low_rank
        return image, largest / self.scale

    def multipliers(self, penalty: float) -> list[Floats]:
        """Y of each copy, (F, n), as the last ``settle`` left them."""
        return [penalty * (c - self.matrix(row)) for row, c in zip(self.state, self._copies(), strict=True)]

    def _copies(self) -> list[Floats]:
        return [self.smooth, self.clean][-self.n_copies :]
