"""The working state of a take: positions, their SD, and which samples are known (trusted, or in a short gap)."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mocapclean.numerics import interpolation
from mocapclean.solvers.fillable import enclosed
from mocapclean.solvers.kriging.bones import Bones
from mocapclean.solvers.kriging.bridging import BridgeWeights
from mocapclean.solvers.kriging.distance_limits import DistanceLimits
from mocapclean.solvers.kriging.neighbour_frames import neighbour_frames
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.solvers.kriging.own_path import OwnPath
from mocapclean.solvers.kriging.rest import Rest
from mocapclean.solvers.kriging.short_gaps import bridge_short_gaps, in_short_gaps
from mocapclean.take import Solution, Take
from mocapclean.take.session import Session

if TYPE_CHECKING:
    from mocapclean.solvers.kriging import Params

LONGEST_SHORT_GAP = 1.0 / 24.0  # s, gaps up to it are bridged over time; chosen by hand, no sweep was kept


class TakeState:
    """The state of a take while its gaps are filled; at first only short gaps are filled.

    F are the ``n_own`` frames of the take, then those of its session, of which none is filled.
    positions: (F, M, 3) mm, trusted, filled, or interpolated linearly where not yet filled.
    sd: (F, M) mm per coordinate, NaN where nothing is filled.
    known: (F, M) whether a sample is trusted or in a bridged short gap.
    missing: (F, M) 1.0 where a sample is neither known nor filled, else 0.0.
    begun: (F, M) whether a sample is filled by the solution that the state began with.
    distances, bones, limits: measured on the trusted samples. bridge_weights, own_path: shared by all gaps.
    """

    def __init__(self, take: Take, params: "Params", begun: Solution | None = None) -> None:
        """Take the samples of a take, and of a solution of it that was found with more of them trusted."""
        self.params, self.rate, self.trusted = params, take.rate, take.trusted
        self.n_own = len(take.trusted)
        self.bridge_weights, self.own_path = BridgeWeights(take.rate), OwnPath(take.rate)
        interpolated = interpolation.linear(take.positions, take.trusted)
        own = interpolated, take.trusted
        self.distances = NeighbourDistances.measured(
            *(take.session.after(*own) if take.session else own),
            params.rigidity,
            n_own=self.n_own,
            exact=take.skeleton is not None,
        )
        self.bones = Bones.of_take(take, params.bone_spread, self.distances)
        self.limits = DistanceLimits.measured(interpolated, take.trusted, self.distances)
        self.known = take.trusted | in_short_gaps(take.trusted, max(1, round(LONGEST_SHORT_GAP * take.rate)))
        # A neighbour in a gap at an end of the take is not used: markers lost together there would mislead each other.
        usable = take.trusted | (self.known & enclosed(take.trusted))
        frames_for = partial(neighbour_frames, interpolated, take.trusted, usable, self.distances, params.learnt)
        self.begun = begun.filled & ~take.trusted if begun else np.zeros_like(take.trusted)
        to_bridge = self.known & ~take.trusted & ~self.begun
        self.positions, self.sd = bridge_short_gaps(interpolated, take.trusted, to_bridge, take.rate, frames_for)
        if begun:
            self.positions = np.where(self.begun[..., None], begun.positions, self.positions)
            self.sd = np.where(self.begun, begun.sd if begun.sd is not None else np.nan, self.sd)
        self.missing = np.asarray(~(self.known | self.begun), dtype=float)
        self._rest_of: dict[int, Rest] = {}
        if take.session:
            self._append(take.session)

    def _append(self, session: Session) -> None:
        """Append the frames of a session, which are learnt from and not filled."""
        nowhere = np.zeros_like(session.trusted)
        positions = interpolation.linear(session.positions, session.trusted)
        self.positions = np.concatenate([self.positions, positions])
        self.sd = np.concatenate([self.sd, np.full(nowhere.shape, np.nan)])
        self.trusted = np.concatenate([self.trusted, session.trusted])
        self.known = np.concatenate([self.known, session.trusted])
        self.begun = np.concatenate([self.begun, nowhere])
        self.missing = np.concatenate([self.missing, np.asarray(~session.trusted, dtype=float)])

    def rest(self, marker: int) -> Rest:
        """Return how a marker moves beside stretches of the take, from its known samples."""
        if marker not in self._rest_of:
            self._rest_of[marker] = Rest(
                self.positions[:, marker], self.known[:, marker], self.rate, self.params.rigidity
            )
        return self._rest_of[marker]
