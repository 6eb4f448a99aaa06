"""Operator splitting for a matrix that is of low rank, smooth over frames, and wrong in a few entries.

    min_X  N(X) + λ ‖P_Ω(D − X)‖₁ + (μ/2) ‖OX‖_F²

N is a (truncated) nuclear norm, Ω the known entries, O that of ``numerics.smoothness``. The augmented Lagrangian method
splits X into a smooth copy M and a clean copy C = P_Ω(D) − S, with multipliers Y₁, Y₂ and penalty η. It alternates
between X, whose step belongs to the method that uses this module,

    X = argmin N(X) + η ‖X − Z‖²,     Z = (M + C)/2 + (Y₁ + Y₂)/(2η),

and the copies with their multipliers:

    M = (I + (μ/η) OᵀO)⁻¹ (X − Y₁/η)      S = 𝒮_{λ/η}(D − X + Y₂/η) on Ω, free elsewhere
    Y₁ += η (M − X)                       Y₂ += η (C − X)

The state of the iteration is X − Y/η, before Y is updated: each iteration maps it to itself plus X − (M, C). This is
Douglas-Rachford splitting: J. Eckstein, D. P. Bertsekas, 1992, doi:10.1007/BF01581204.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.smoothness import roughness, smooth

TINY = np.finfo(np.float64).tiny


@dataclass(frozen=True, kw_only=True)
class SmoothSparseModel:
    """The data term and the smoothness term of the model.

    data: (F, n), read where known only. known: (F, n) bool. sparsity: λ. smoothness: μ. order: of O, 1 or 2.
    """

    data: Floats
    known: Bools
    sparsity: float
    smoothness: float
    order: int = 2

    def outliers(self, clean: Floats) -> Floats:
        """Return S (F, n), the data less a clean copy (F, n) on the known entries; 0 elsewhere."""
        return np.where(self.known, self.data - clean, 0.0)

    def cost(self, low_rank: Floats) -> float:
        """Return λ ‖P_Ω(D − X)‖₁ + (μ/2) ‖OX‖_F² of X (F, n)."""
        absolute = np.abs(self.outliers(low_rank)).sum()
        return float(self.sparsity * absolute + self.smoothness / 2 * roughness(low_rank, self.order))


class SplitCopies:
    """The copies M and C with their multipliers.

    state: (k, n F), the rows X − Y/η, with the frames of one column in sequence. Where μ is 0, M and Y₁ are left out
    (k = 1). smooth, clean: M and C, (F, n); M is C where it is left out. Both are valid after ``update``.
    """

    def __init__(self, start: Floats, model: SmoothSparseModel) -> None:
        self.model, self.shape = model, start.shape
        self.n_copies = 2 if model.smoothness else 1
        self.state = np.tile(start.T.ravel(), (self.n_copies, 1))
        self.scale = float(np.linalg.norm(model.data[model.known])) + TINY
        self._data = np.where(model.known, model.data, 0.0)
        self._mask = model.known.astype(float)
        self.clean, self._clipped, self._target, self._difference = (np.empty_like(self._data) for _ in range(4))
        self.smooth = self.clean

    def matrix(self, row: Floats) -> Floats:
        """Return a row of the state as its matrix (F, n), in Fortran order."""
        return row.reshape(self.shape[::-1]).T

    def update(self, penalty: float) -> Floats:
        """Update the copies from the state; return Z (F, n), the target of the step in X.

        The next call overwrites the returned array.
        """
        model, shifted, clipped = self.model, self.matrix(self.state[-1]), self._clipped
        # C = v − clip(v − D, ±λ/η) on the known entries, v = X − Y₂/η; S = D − C is then the soft threshold of D − v.
        threshold = model.sparsity / penalty
        np.subtract(shifted, self._data, out=self.clean)
        np.clip(self.clean, -threshold, threshold, out=clipped)
        clipped *= self._mask
        self.clean -= clipped
        self.clean += self._data
        # Z = C + Y₂/η, for Y₂/η after its update is −clipped
        if self.n_copies == 1:
            return np.subtract(self.clean, clipped, out=self._target)
        # Z = (M + C)/2 + (Y₁ + Y₂)/(2η), reduced to M + (v₂ − v₁)/2 − clipped with the rows v of the state
        other = self.matrix(self.state[0])
        self.smooth = smooth(other, model.smoothness / penalty, model.order)
        np.subtract(shifted, other, out=self._target)
        self._target *= 0.5
        self._target += self.smooth
        self._target -= clipped
        return self._target

    def next_state(self, low_rank: Floats, growth: float = 1.0) -> tuple[Floats, float]:
        """Return the state (k, n F) after a step to X (F, n), and the distance of X from its copies.

        The distance is the largest Frobenius norm of X − copy, relative to the data. growth: the factor of the penalty
        from this iteration to the next.
        """
        image, largest = np.empty_like(self.state), 0.0
        for row, before, copy in zip(image, self.state, self._copies(), strict=True):
            after = self.matrix(row)
            np.subtract(low_rank, copy, out=self._difference)
            largest = max(largest, float(np.linalg.norm(self._difference.T.ravel())))
            # X − Y/(growth η), where −Y/η = v − copy
            np.subtract(self.matrix(before), copy, out=after)
            if growth != 1.0:
                after /= growth
            after += low_rank
        return image, largest / self.scale

    def multipliers(self, penalty: float) -> list[Floats]:
        """Return Y (F, n) of each copy, as of the last ``update``."""
        return [penalty * (copy - self.matrix(row)) for row, copy in zip(self.state, self._copies(), strict=True)]

    def _copies(self) -> list[Floats]:
        return [self.smooth, self.clean][-self.n_copies :]
