"""Universal kriging over time: best linear unbiased prediction in a short gap, around an unknown linear trend.

    [ K + noise I   D ] [weights]   [k]
    [ Dᵀ            0 ] [  ...  ] = [d]      D, d: 1 and the time, at the samples and at the gap

The processes are Matérn ones of smoothness 5/2 and one of smoothness 1/2. N. Cressie, 1993,
doi:10.1002/9781119115151, section 3.4. The leave-one-out errors are read off the inverse of the system: O. Dubrule,
1983, doi:10.1007/BF01033232.
"""

from collections.abc import Iterable
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


Pattern = tuple[Ints, int]
"""The frames (k,) of the samples that a gap is bridged from, counted from its first frame, and its length."""


class DriftWeights(NamedTuple):
    """Kriging of one gap by K kernels from k samples.

    weights: (K, length, k) of the samples. variance: (K, length) as a share of the process variance.
    """

    weights: Floats
    variance: Floats


class DriftKriging:
    """Kriging weights at one frame rate, Hz, kept for each pattern of samples; the polygon's kernel comes last."""

    def __init__(self, rate: float) -> None:
        scale = rate / REFERENCE_RATE
        self.lengths = np.array([length * scale for length, _ in MATERN_KERNELS])[:, None]
        self.noises = np.append([noise for _, noise in MATERN_KERNELS], 0.0)
        self.polygon_length = POLYGON_LENGTH * scale
        self._covariance = np.zeros((N_KERNELS, 0))
        self._kept: dict[tuple[bytes, int], DriftWeights] = {}

    def weights(self, samples: Ints, length: int) -> DriftWeights:
        """Return the weights of samples at frames (k,), counted from the first frame of a gap of ``length`` frames."""
        key = samples.tobytes(), length
        if key not in self._kept:
            self.prepare([(samples, length)])
        return self._kept[key]

    def prepare(self, patterns: Iterable[Pattern]) -> None:
        """Compute the weights of patterns together, to be returned by ``weights``."""
        alike: dict[tuple[int, int], dict[bytes, Ints]] = {}
        for samples, length in patterns:
            if (samples.tobytes(), length) not in self._kept:
                alike.setdefault((len(samples), length), {})[samples.tobytes()] = samples
        for (_, length), of_size in alike.items():
            weights, variance = self._solve(np.stack(list(of_size.values())), length)
            for key, *found in zip(of_size, weights, variance, strict=True):
                self._kept[key, length] = DriftWeights(*found)

    def leave_one_out(self, samples: Ints) -> Floats:
        """Return matrices Q (K, k, k) of samples at frames (k,).

        Sample i less its prediction from the other samples is (Q y)_i / Q_ii, and the variance of that is 1 / Q_ii.
        """
        return np.asarray(np.linalg.inv(self._systems(samples[None])[0])[:, : len(samples), : len(samples)])

    def _solve(self, samples: Ints, length: int) -> tuple[Floats, Floats]:
        """Return the weights (P, K, length, k) and variances (P, K, length) for P patterns of samples (P, k)."""
        n_patterns, k = samples.shape
        gap = np.arange(length)
        right = np.empty((n_patterns, N_KERNELS, k + 2, length))
        right[:, :, :k] = self._covariances(np.abs(samples[..., None] - gap))
        right[:, :, k:] = np.stack([np.ones(length), gap / MAX_PER_SIDE])
        solved = np.linalg.solve(self._systems(samples), right)
        variance = 1.0 + self.noises[:, None] - np.einsum("pgkn,pgkn->pgn", right, solved)
        weights: Floats = np.asarray(solved[:, :, :k].swapaxes(2, 3), dtype=np.float64)
        return weights, np.maximum(variance, MIN_VARIANCE)

    def _systems(self, samples: Ints) -> Floats:
        """Return the matrices (P, K, k + 2, k + 2) of the linear systems for samples (P, k)."""
        n_patterns, k = samples.shape
        # The drift: a constant, and the time in units that keep its column near 1
        drift = np.stack([np.ones(samples.shape), samples / MAX_PER_SIDE], axis=1)[:, None]
        systems = np.zeros((n_patterns, N_KERNELS, k + 2, k + 2))
        systems[:, :, :k, :k] = self._covariances(np.abs(samples[..., None] - samples[:, None]))
        systems[:, :, range(k), range(k)] += self.noises[:, None]
        systems[:, :, k:, :k], systems[:, :, :k, k:] = drift, drift.swapaxes(2, 3)
        return systems

    def _covariances(self, distances: Ints) -> Floats:
        """Return the covariances (P, K, n, m) at distances (P, n, m), frames.

        The covariance at each whole distance is computed once and then looked up.
        """
        if distances.max(initial=0) >= self._covariance.shape[1]:
            frames = np.arange(2 * distances.max() + 1.0)
            self._covariance = np.concatenate(
                [matern(frames, self.lengths), np.exp(-frames / self.polygon_length)[None]]
            )
        return np.asarray(self._covariance[:, distances].swapaxes(0, 1))
