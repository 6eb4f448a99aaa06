"""Universal kriging over time: best linear unbiased prediction in a short gap, around an unknown linear trend.

    [ K + noise I   D ] [weights]   [k]
    [ Dᵀ            0 ] [  ...  ] = [d]      D, d: 1 and the time, at the samples and at the gap

The processes are Matérn ones of smoothness 5/2 and one of smoothness 1/2. N. Cressie, 1993,
doi:10.1002/9781119115151, section 3.4. The leave-one-out errors are read off the inverse of the system: O. Dubrule,
1983, doi:10.1007/BF01033232.
"""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.frame_selection import REFERENCE_RATE
from mocapclean.solvers.kriging.matern import matern

MAX_PER_SIDE = 12  # samples on each side of a gap that it is bridged from; chosen by hand, no sweep was kept
MATERN_KERNELS = tuple((length, noise) for length in (8.0, 20.0, 50.0) for noise in (1e-6, 1e-5, 1e-3, 3e-2))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the process variance; chosen by hand, no sweep was kept."""
POLYGON_LENGTH = 300.0
"""Length in frames at 120 Hz of the process of smoothness 1/2, exp(-d/ℓ).

It is much longer than a short gap, so the conditional mean is a polygon through the samples, which does not overshoot
where a track jumps or rattles. Chosen by hand; no sweep was kept.
"""
N_KERNELS = len(MATERN_KERNELS) + 1  # the Matérn kernels and the polygon
MIN_VARIANCE = 1e-9  # of the process variance, keeps a division by the kriging variance finite


class DriftWeights(NamedTuple):
    """Kriging of one gap by K kernels from k samples.

    weights: (K, length, k) of the samples. variance: (K, length) as a share of the process variance. leave_one_out:
    (K, k, k) matrices Q: sample i less its prediction from the other samples is (Q y)_i / Q_ii, with variance 1 / Q_ii.
    """

    weights: Floats
    variance: Floats
    leave_one_out: Floats


class DriftKriging:
    """Kriging weights at one frame rate, Hz, kept for each pattern of samples; the polygon's kernel comes last."""

    def __init__(self, rate: float) -> None:
        scale = rate / REFERENCE_RATE
        self.lengths = np.array([length * scale for length, _ in MATERN_KERNELS])[:, None, None]
        self.noises = np.append([noise for _, noise in MATERN_KERNELS], 0.0)
        self.polygon_length = POLYGON_LENGTH * scale
        self._kept: dict[tuple[bytes, int], DriftWeights] = {}

    def weights(self, samples: Ints, length: int) -> DriftWeights:
        """Return the weights of samples at frames (k,), counted from the first frame of a gap of ``length`` frames."""
        key = samples.tobytes(), length
        if key not in self._kept:
            self._kept[key] = self._solve(samples, length)
        return self._kept[key]

    def _covariance(self, frames: Ints, others: Ints) -> Floats:
        """Return the covariances (K, n, m) between frames (n,) and others (m,)."""
        distances = (frames[:, None] - others).astype(float)
        polygon = np.exp(-np.abs(distances) / self.polygon_length)
        return np.concatenate([matern(distances[None], self.lengths), polygon[None]])

    def _solve(self, samples: Ints, length: int) -> DriftWeights:
        """Return what ``weights`` returns, from the linear system of the module's docstring."""
        k, gap = len(samples), np.arange(length)
        # The drift: a constant, and the time in units that keep its column near 1.
        drift = np.stack([np.ones(k), samples / MAX_PER_SIDE])
        system = np.zeros((N_KERNELS, k + 2, k + 2))
        system[:, :k, :k] = self._covariance(samples, samples) + self.noises[:, None, None] * np.eye(k)
        system[:, k:, :k], system[:, :k, k:] = drift, drift.T
        right = np.empty((N_KERNELS, k + 2, length))
        right[:, :k] = self._covariance(samples, gap)
        right[:, k:] = np.stack([np.ones(length), gap / MAX_PER_SIDE])
        # One factorisation gives the weights and the inverse.
        identity = np.broadcast_to(np.eye(k + 2), system.shape)
        solved = np.linalg.solve(system, np.concatenate([right, identity], axis=2))
        solved, inverse = solved[..., :length], solved[..., length:]
        variance = 1.0 + self.noises[:, None] - np.einsum("gkn,gkn->gn", right, solved)
        weights = np.asarray(solved[:, :k].swapaxes(1, 2), dtype=np.float64)
        return DriftWeights(weights, np.maximum(variance, MIN_VARIANCE), np.asarray(inverse[:, :k, :k]))
