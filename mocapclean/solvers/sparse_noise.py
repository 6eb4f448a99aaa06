"""What tsmc and trnn share: from a take to a low-rank, smooth and sparsely corrupted matrix, and back."""

from collections.abc import Mapping, Sequence

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SmoothSparseModel, SplitCopies
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take


class NoisyTake:
    """A take about the mean of what is trusted, in units of ``unit`` mm.

    start: (F, 3m), straight lines across the gaps, held at the ends.
    """

    def __init__(self, take: Take, unit: float) -> None:
        self.take, self.unit = take, unit
        self.wanted = fillable(take.trusted)
        self.data = centred_matrix(take.positions, take.trusted)
        self.start: Floats = self.data.interpolated / unit

    def is_idle(self, denoise: bool) -> bool:
        """Whether there is nothing to fill, nor to denoise if that is asked for."""
        return not self.wanted.any() and not (denoise and self.take.trusted.any())

    def unchanged(self) -> Solution:
        """The answer where there is nothing to do."""
        return Solution(positions=self.data.positions(self.data.values), filled=self.wanted, reason="nothing to fill")

    def observe(self, sparsity: float, smoothness: float, order: int = 2) -> SmoothSparseModel:
        """The terms of the model beside its rank; ``sparsity`` is λ √max(F, 3M)."""
        return SmoothSparseModel(
            data=np.asfortranarray(self.data.values / self.unit),
            known=np.asfortranarray(self.data.known),
            sparsity=sparsity / max(self.start.shape) ** 0.5,
            smoothness=smoothness,
            order=order,
        )

    def solution(
        self,
        low: Floats,
        copies: SplitCopies,
        *,
        denoise: bool,
        converged: bool,
        reason: str,
        trace: Sequence[float],
        facts: Mapping[str, float | int | str] | None = None,
    ) -> Solution:
        """The answer from X = ``low`` and its copies: X where untrusted, D − S where trusted."""
        trusted = self.take.trusted
        outliers = np.zeros(self.take.positions.shape)
        noise = copies.model.outliers(copies.clean) * self.unit
        outliers[:, self.data.used] = noise.reshape(len(noise), -1, 3)
        kept = np.where(trusted[..., None], self.take.positions, 0.0) - outliers
        estimate = self.data.positions(low * self.unit)
        return Solution(
            positions=np.where(trusted[..., None], kept, estimate),
            filled=self.wanted,
            converged=converged,
            iterations=len(trace),
            reason=reason,
            trace=tuple(trace),
            facts=dict(facts or {}) | {"noisy_samples": int(np.count_nonzero(outliers.any(axis=2)))},
            outliers=outliers,
            moved=np.asarray(outliers.any(axis=2)) if denoise else None,
        )
