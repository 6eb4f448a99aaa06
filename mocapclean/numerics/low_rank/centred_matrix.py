"""A take as the matrix that low-rank methods complete."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics import interpolation
from mocapclean.numerics.low_rank.shrinkage import spectral_gap_rank


@dataclass(frozen=True)
class CentredMatrix:
    """The markers with trusted samples as a matrix: frames in rows, x, y, z of a marker in neighbouring columns.

    values: (F, 3m) positions less ``centre``, 0 where not known. known: (F, 3m) bool. centre: (3,). used: (M,) bool,
    the markers that the matrix has.
    """

    values: Floats
    known: Bools
    centre: Floats
    used: Bools

    @cached_property
    def spread(self) -> float:
        """The root mean square of the known values; 1 where all are 0."""
        return float(np.linalg.norm(self.values)) / max(int(self.known.sum()), 1) ** 0.5 or 1.0

    @cached_property
    def interpolated(self) -> Floats:
        """The values (F, 3m) with unknown entries interpolated linearly, and constant beyond the known ones."""
        known = self.known[:, ::3]
        return interpolation.linear(self.values.reshape(*known.shape, 3), known).reshape(self.values.shape)

    def gap_rank(self, gap: float, limit: int) -> int:
        """Return the rank of the interpolated matrix by its spectral gap, at most ``limit``."""
        return spectral_gap_rank(self.interpolated, gap, limit)

    def positions(self, estimate: Floats) -> Floats:
        """Return an estimate (F, 3m) of the values as positions (F, M, 3); 0 for markers that are not used."""
        positions = np.zeros((len(self.values), len(self.used), 3))
        positions[:, self.used] = estimate.reshape(len(estimate), np.count_nonzero(self.used), 3) + self.centre
        return positions


def centred_matrix(positions: Floats, trusted: Bools, *, about_mean: bool = True) -> CentredMatrix:
    """Return the matrix of positions (F, M, 3) about the mean of the trusted (F, M) samples, or about the origin."""
    used: Bools = np.any(trusted, axis=0)
    centre = positions[trusted].mean(axis=0) if about_mean and used.any() else np.zeros(3)
    values = np.where(trusted[:, used, None], positions[:, used] - centre, 0.0)
    known = np.repeat(trusted[:, used], 3, axis=1)
    return CentredMatrix(values.reshape(known.shape), known, centre, used)
