"""Fill one part of a gap: choose its neighbours and frames, run all predictors, and combine their predictions."""

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.solvers.kriging.bridging import PlanBridges
from mocapclean.solvers.kriging.frame_selection import (
    MIN_TRAINING,
    REFERENCE_RATE,
    adjacent_frames,
    training_frames,
    window_offsets,
    window_starts,
)
from mocapclean.solvers.kriging.hinge import find_ends
from mocapclean.solvers.kriging.prediction import PredictionInput, predict_all
from mocapclean.solvers.kriging.predictors import PREDICTORS, applicable
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan
from mocapclean.solvers.kriging.stacking import combine
from mocapclean.solvers.kriging.take_state import TakeState

# The constants below were chosen by hand on the captures of `mocapclean bench markers`; no sweep was kept.
ADJACENT_REACH = 1.0 / 3.0  # s on each side of a gap in which samples are sought to bridge it from
WINDOW_EDGE = 5  # frames at 120 Hz in which the marker is also known, on each bridged side of a window
HELD_OUT_MARGIN = 3  # frames around a window that are held out of the regression with it
MAX_REUSED_VARIANCE = 0.25  # of the mean variance of the segment, up to which a filled sample is bridged from


class GapSegment:
    """A segment of a gap of one marker: the frames ``start`` to ``stop``, predicted from the neighbours known in all.

    neighbours: (q,) columns in descending order of their weight. hinge_ends: two indices into them, or empty.
    known: (F,) the samples of the marker that are known. incomplete_training: whether the segment was learnt from
    frames that lack many neighbours; set by ``fill``.
    """

    def __init__(self, state: TakeState, marker: int, start: int, stop: int) -> None:
        self.state, self.marker, self.start, self.stop = state, marker, start, stop
        # Neighbours that are known in the whole segment.
        weights = np.where(state.known[start:stop].all(axis=0), state.distances.weights(marker), 0.0)
        heaviest = np.argsort(-weights, kind="stable")[: max(p.n_features for p in PREDICTORS)]
        self.neighbours = heaviest[weights[heaviest] > 0.0]
        self.known = state.known[:, marker]
        self.hinge_ends = find_ends(state.distances, marker, self.neighbours)
        self.incomplete_training = False

    def fill(self) -> tuple[Floats, Floats]:
        """Return positions (L, 3) and SD (L,) per coordinate, mm; NaN without neighbours or enough known samples."""
        length = self.stop - self.start
        if not len(self.neighbours) or np.count_nonzero(self.known) < MIN_TRAINING:
            return np.full((length, 3), np.nan), np.full(length, np.nan)
        state, plan = self.state, self._plan()
        inputs = PredictionInput(
            distances=state.distances,
            marker=self.marker,
            neighbours=self.neighbours,
            hinge_ends=self.hinge_ends,
            plan=plan,
            bridges=PlanBridges(plan, state.bridge_weights),
            held_out=plan.held_out(HELD_OUT_MARGIN),
            positions=state.positions[plan.frames][:, self.neighbours],
            target=state.positions[plan.frames, self.marker],
            error_floor=state.params.noise**2,
        )
        results = predict_all(applicable(len(self.neighbours), bool(self.hinge_ends)), inputs)
        return combine(results, plan, state.params.noise, state.params.shrinkage)

    def _plan(self) -> SamplingPlan:
        """Return the frames to learn, test and bridge from, where possible frames in which all neighbours are known."""
        state, n_frames = self.state, len(self.known)
        missing_share = self._missing_share()
        reach = max(1, round(ADJACENT_REACH * state.rate))
        bridgeable = self.known | self._well_filled()
        before, after = adjacent_frames(bridgeable, self.start, self.stop, reach, state.rate)
        # Windows are bridged from the same sides as the gap.
        edge = max(1, round(WINDOW_EDGE * state.rate / REFERENCE_RATE))
        has_before, has_after = len(before) > 0, len(after) > 0
        edges = edge * has_before, edge * has_after
        length = self.stop - self.start
        starts, length = window_starts(self.known, missing_share, length, state.params.windows, edges)
        inside, adjacent = window_offsets(length, state.rate, has_before, has_after)
        # Adjacent frames beyond the take are clipped to it and counted as unknown.
        unclipped = starts[:, None] + np.append(inside, adjacent)
        windows = np.clip(unclipped, 0, n_frames - 1)
        training, self.incomplete_training = training_frames(self.known, missing_share, state.params.learnt)
        return SamplingPlan(
            training=training,
            windows=windows,
            inside=inside,
            adjacent=adjacent,
            adjacent_known=((windows == unclipped) & self.known[windows])[:, len(inside) :],
            gap_adjacent=np.append(before[::-1], after),
            gap=np.arange(self.start, self.stop),
        )

    def _missing_share(self) -> Floats:
        """Return the share (F,) of the neighbours, by weight, that is missing in each frame of the take."""
        weights = np.zeros(len(self.state.distances.mean))
        weights[self.neighbours] = self.state.distances.weights(self.marker)[self.neighbours]
        return np.asarray(self.state.missing @ (weights / weights.sum()), dtype=np.float64)

    def _well_filled(self) -> Bools:
        """Return the filled samples (F,) of the marker elsewhere whose variance is at most a quarter of that of this
        part.
        """
        sd = self.state.sd[:, self.marker]
        own_variance = np.square(sd[self.start : self.stop]).mean()
        well_filled: Bools = ~self.known & (np.square(sd) <= MAX_REUSED_VARIANCE * own_variance)
        well_filled[self.start : self.stop] = False
        return well_filled
