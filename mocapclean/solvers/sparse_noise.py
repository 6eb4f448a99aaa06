"""The model that tsmc and trnn share: a take as a low-rank, smooth matrix with sparse noise on its trusted entries."""

from collections.abc import Mapping, Sequence

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SmoothSparseModel, SplitCopies
from mocapclean.take import Solution, Take


class NoisyTake:
    """A take about the mean of its trusted samples, in units of ``unit`` mm.

    start: (F, 3m), the trusted entries with straight lines across the gaps, constant at the ends of the take.
    """

    def __init__(self, take: Take, unit: float) -> None:
        self.take, self.unit = take, unit
        self.data = centred_matrix(take.positions, take.trusted)
        self.start: Floats = self.data.interpolated / unit

    def observe(self, sparsity: float, smoothness: float, order: int = 2) -> SmoothSparseModel:
        """Return the terms of the model other than the rank. sparsity: λ √max(F, 3M), of which λ is the weight."""
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
        fillable: Bools,
        *,
        denoise: bool,
        converged: bool,
        reason: str,
        trace: Sequence[float],
        facts: Mapping[str, float | int | str] | None = None,
    ) -> Solution:
        """Return the Solution for X = ``low`` and its copies: X where untrusted, D − S where trusted."""
        trusted = self.take.trusted
        # S, in millimetres, at the columns of the markers that are trusted in some frame.
        outliers = np.zeros(self.take.positions.shape)
        noise = copies.model.outliers(copies.clean) * self.unit
        outliers[:, self.data.used] = noise.reshape(len(noise), -1, 3)
        # D − S on the trusted samples, X on the others.
        denoised = np.where(trusted[..., None], self.take.positions, 0.0) - outliers
        estimate = self.data.positions(low * self.unit)
        noisy = outliers.any(axis=2)
        return Solution(
            positions=np.where(trusted[..., None], denoised, estimate),
            filled=fillable,
            converged=converged,
            iterations=len(trace),
            reason=reason,
            trace=tuple(trace),
            facts=dict(facts or {}) | {"noisy_samples": int(np.count_nonzero(noisy))},
            outliers=outliers,
            moved=np.asarray(noisy) if denoise else None,
        )
