"""Kriging weights over time that carry regression residuals across a gap and its windows, for several Matérn kernels.

A bridge is the conditional mean of a Matérn process in a gap or window, given the samples adjacent to it.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.frame_selection import REFERENCE_RATE
from mocapclean.solvers.kriging.matern import bridge
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan

KERNELS = ((5.0, 1e-2), (10.0, 1e-2), (20.0, 1e-2), (40.0, 1e-2), (80.0, 1e-2), (20.0, 1e-1), (60.0, 1e-1))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the variance of the process.

The lengths double from 1/24 s to 2/3 s. Chosen on the captures of `mocapclean bench markers`; no sweep was kept.
"""
N_CACHED = 64  # patterns of times whose weights are kept; chosen by hand for speed, without effect on results


class BridgeWeights:
    """Simple kriging weights and variances at one frame rate, Hz; the most recently used time patterns are cached."""

    def __init__(self, rate: float) -> None:
        lengths, noises = np.transpose(KERNELS)
        self.kernels = lengths * rate / REFERENCE_RATE, noises
        self._cached = lru_cache(maxsize=N_CACHED)(self._solve)

    def bridge(self, known: Ints, wanted: Ints) -> tuple[Floats, Floats]:
        """Return the weights (kernels, n, k) of frames known (k,) at frames wanted (n,), and variances (kernels, n)."""
        # The covariance depends on differences of times alone: equal patterns anywhere in the take share their weights.
        return self._cached((known - wanted[0]).tobytes(), (wanted - wanted[0]).tobytes())

    def _solve(self, known: bytes, wanted: bytes) -> tuple[Floats, Floats]:
        """Return the same as ``bridge``, for frames given as bytes, which can be keys of a cache."""
        return bridge(np.frombuffer(known, dtype=np.intp), np.frombuffer(wanted, dtype=np.intp), *self.kernels)


class WindowGroup(NamedTuple):
    """Windows whose adjacent samples are known in the same pattern.

    windows: (g,) indices of the windows. known: (k,) indices of the adjacent frames that are known. weights: (kernels,
    m, k) of these in the bridge.
    """

    windows: Ints
    known: Ints
    weights: Floats


class PlanBridges:
    """The bridges of one sampling plan, shared by all predictors.

    gap_weights: (kernels, L, k) of the samples adjacent to the gap.
    gap_variance, window_variance: (kernels, L) and (kernels, m), as shares of the variance of the process.
    groups: the windows by the pattern of their known adjacent frames.
    """

    def __init__(self, plan: SamplingPlan, bridge_weights: BridgeWeights) -> None:
        self.gap_weights, self.gap_variance = bridge_weights.bridge(plan.gap_adjacent, plan.gap)
        self.window_variance = bridge_weights.bridge(plan.adjacent, plan.inside)[1]
        windows_of: dict[bytes, list[int]] = {}
        for k, pattern in enumerate(plan.adjacent_known):
            windows_of.setdefault(pattern.tobytes(), []).append(k)
        self.groups = []
        for windows in windows_of.values():
            known = np.flatnonzero(plan.adjacent_known[windows[0]])
            weights, _ = bridge_weights.bridge(plan.adjacent[known], plan.inside)
            self.groups.append(WindowGroup(np.array(windows), known, weights))
        self._shape = len(plan.windows), len(KERNELS), len(plan.inside), len(plan.adjacent)

    def window_weights(self) -> Floats:
        """Return the weights (w, kernels, m, s) of all adjacent frames of each window, 0 where they are not known."""
        weights = np.zeros(self._shape)
        for windows, known, of_known in self.groups:
            weights[np.ix_(windows, range(len(KERNELS)), range(self._shape[2]), known)] = of_known
        return weights
