"""Kriging weights over time that carry regression residuals across a gap and its windows, for several Matérn kernels.

A bridge is the conditional mean of a Matérn process in a gap or window, given the samples adjacent to it.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.frame_selection import REFERENCE_RATE
from mocapclean.solvers.kriging.matern import bridges
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan

KERNELS = ((5.0, 1e-2), (10.0, 1e-2), (20.0, 1e-2), (40.0, 1e-2), (80.0, 1e-2), (20.0, 1e-1), (60.0, 1e-1))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the variance of the process.

The lengths double from 1/24 s to 2/3 s. Chosen on the captures of `mocapclean bench markers`; no sweep was kept.
"""


class BridgeWeights:
    """Simple kriging weights and variances at one frame rate, Hz, kept for each pattern of times."""

    def __init__(self, rate: float) -> None:
        lengths, noises = np.transpose(KERNELS)
        self.kernels = lengths * rate / REFERENCE_RATE, noises
        self._kept: dict[tuple[bytes, bytes], tuple[Floats, Floats]] = {}

    def bridge(self, known: Ints, wanted: Ints) -> tuple[Floats, Floats]:
        """Return the weights (kernels, n, k) of frames known (k,) at frames wanted (n,), and variances (kernels, n)."""
        key = _key(known, wanted)
        if key not in self._kept:
            self.prepare([(known, wanted)])
        return self._kept[key]

    def prepare(self, patterns: Iterable[tuple[Ints, Ints]]) -> None:
        """Compute the weights of pairs of frames known and wanted together, to be returned by ``bridge``."""
        alike: dict[tuple[int, int], dict[tuple[bytes, bytes], tuple[Ints, Ints]]] = {}
        for known, wanted in patterns:
            if (key := _key(known, wanted)) not in self._kept:
                alike.setdefault((len(known), len(wanted)), {})[key] = known - wanted[0], wanted - wanted[0]
        for of_size in alike.values():
            known, wanted = (np.stack(frames) for frames in zip(*of_size.values(), strict=True))
            self._kept.update(zip(of_size, zip(*bridges(known, wanted, *self.kernels), strict=True), strict=True))


def _key(known: Ints, wanted: Ints) -> tuple[bytes, bytes]:
    """Return what is equal for equal patterns of times anywhere in the take.

    The covariance depends on differences of times alone, so that these share their weights.
    """
    return (known - wanted[0]).tobytes(), (wanted - wanted[0]).tobytes()


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
        self.groups = [
            WindowGroup(windows, known, bridge_weights.bridge(plan.adjacent[known], plan.inside)[0])
            for windows, known in plan.known_patterns
        ]
        self._shape = len(plan.windows), len(KERNELS), len(plan.inside), len(plan.adjacent)

    def window_weights(self) -> Floats:
        """Return the weights (w, kernels, m, s) of all adjacent frames of each window, 0 where they are not known."""
        if len(self.groups) == 1 and len(self.groups[0].known) == self._shape[3]:
            return np.broadcast_to(self.groups[0].weights, self._shape)
        weights = np.zeros(self._shape)
        for windows, known, of_known in self.groups:
            weights[
                windows[:, None, None, None],
                np.arange(self._shape[1])[:, None, None],
                np.arange(self._shape[2])[:, None],
                known,
            ] = of_known
        return weights


def patterns_of(plan: SamplingPlan) -> Iterator[tuple[Ints, Ints]]:
    """Yield the pairs of frames known and wanted of the bridges of a plan."""
    yield plan.gap_adjacent, plan.gap
    yield plan.adjacent, plan.inside
    for _, known in plan.known_patterns:
        yield plan.adjacent[known], plan.inside
