"""The working state of a take: positions, their SD, and which samples are known (trusted, or in a short gap)."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mocapclean.numerics import interpolation
from mocapclean.solvers.fillable import enclosed
from mocapclean.solvers.kriging.bones import Bones
from mocapclean.solvers.kriging.bridging import BridgeWeights
from mocapclean.solvers.kriging.drift_kriging import DriftKriging
from mocapclean.solvers.kriging.neighbour_frames import neighbour_frames
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.solvers.kriging.short_gaps import bridge_short_gaps, in_short_gaps
from mocapclean.take import Take

if TYPE_CHECKING:
    from mocapclean.solvers.kriging import Params

LONGEST_SHORT_GAP = 1.0 / 24.0  # s, gaps up to it are bridged over time; chosen by hand, no sweep was kept


class TakeState:
    """The state of a take while its gaps are filled; at first only short gaps are filled.

    positions: (F, M, 3) mm, trusted, filled, or interpolated linearly where not yet filled.
    sd: (F, M) mm per coordinate, NaN where nothing is filled.
    known: (F, M) whether a sample is trusted or in a bridged short gap.
    missing: (F, M) 1.0 where a sample is neither known nor filled, else 0.0.
    distances, bones: measured on the trusted samples. bridge_weights, drift_kriging: shared by all gaps.
    """

    def __init__(self, take: Take, params: "Params") -> None:
        self.params, self.rate, self.trusted = params, take.rate, take.trusted
        self.bridge_weights, self.drift_kriging = BridgeWeights(take.rate), DriftKriging(take.rate)
        interpolated = interpolation.linear(take.positions, take.trusted)
        self.distances = NeighbourDistances.measured(
            interpolated, take.trusted, params.rigidity, exact=take.skeleton is not None
        )
        self.bones = Bones.of_take(take, params.bone_spread, self.distances)
        self.known = take.trusted | in_short_gaps(take.trusted, max(1, round(LONGEST_SHORT_GAP * take.rate)))
        # A neighbour in a gap at an end of the take is not used: markers lost together there would mislead each other.
        usable = take.trusted | (self.known & enclosed(take.trusted))
        frames_for = partial(neighbour_frames, interpolated, take.trusted, usable, self.distances, params.learnt)
        self.positions, self.sd = bridge_short_gaps(interpolated, take.trusted, self.known, take.rate, frames_for)
        self.missing = np.asarray(~self.known, dtype=float)
