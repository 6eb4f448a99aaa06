"""One part of a gap: its neighbours and frames, and its answer from what the predictors give."""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.robust import median
from mocapclean.solvers.kriging.extrapolation import pose_growth
from mocapclean.solvers.kriging.frame_selection import (
    MIN_TRAINING,
    REFERENCE_RATE,
    adjacent_frames,
    session_frames,
    training_frames,
    window_offsets,
    window_starts,
)
from mocapclean.solvers.kriging.hinge import find_ends
from mocapclean.solvers.kriging.predictors import PREDICTORS
from mocapclean.solvers.kriging.regression_kriging import KrigingResult
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan
from mocapclean.solvers.kriging.stacking import combine, window_errors_ratio
from mocapclean.solvers.kriging.take_state import TakeState

# The constants below were chosen by hand on the captures of `mocapclean bench markers`; no sweep was kept.
ADJACENT_REACH = 1.0 / 3.0  # s on each side of a gap in which samples are sought to bridge it from
WINDOW_EDGE = 5  # frames at 120 Hz in which the marker is also known, on each bridged side of a window
AT_REST = 0b111  # the kind of a gap beside which the marker rests, on both sides at one place
CLEARLY_BETTER = 4.0
"""Ratio of mean square errors in windows from which a gap is predicted from the marker's own path alone.

With 2 the co-occluded gaps of ten takes of `mocapclean bench markers` became worse, with 4 they did not.
"""
LONGEST_MIXED = 0.1
"""Longest gap, s, in which the own path is stacked with the predictors that follow neighbours.

In gaps of up to 10 frames at 120 Hz it took off 12 % of the error on ten takes, and it added to that of longer ones.
"""
EQUAL_POSES = 10.0  # times the noise parameter (0.3 mm), change of pose below which poses count as equal; by hand
MAX_ADJACENT_MISSING = 0.02
"""Share of its neighbours, by weight, that may be unknown in a frame from which a part is bridged.

Where more are unknown, the regression errs there by more than the process over time does. Chosen by hand.
"""
MAX_REUSED_VARIANCE = 0.25  # of the mean variance of the segment, up to which a filled sample is bridged from


Answer = tuple[Floats, Floats]
"""The positions (L, 3) of a segment and their SD (L,) per coordinate, mm."""


class Evidence(NamedTuple):
    """The results for a segment on the windows of one plan: from neighbours, and from the marker's own path."""

    plan: SamplingPlan
    following: list[KrigingResult]
    own_path: list[KrigingResult]


class GapSegment:
    """A segment of a gap of one marker: the frames ``start`` to ``stop``, predicted from the neighbours known in all.

    neighbours: (q,) columns in descending order of their weight. hinge_ends: two indices into them, or empty.
    known: (F,) the samples of the marker that are known. whole: whether the segment is a whole gap, which can be
    predicted from the marker's own path. incomplete_training: whether the segment is learnt from frames that lack
    many neighbours; set by ``plan``.
    """

    def __init__(
        self, state: TakeState, marker: int, start: int, stop: int, *, whole: bool = True, alone: bool = False
    ) -> None:
        """Take the frames of the segment; alone: whether it is predicted from the marker's own path only."""
        self.state, self.marker, self.start, self.stop, self.whole = state, marker, start, stop, whole
        # Neighbours that are known in the whole segment.
        weights = np.where(state.known[start:stop].all(axis=0), state.distances.weights(marker), 0.0)
        heaviest = np.argsort(-weights, kind="stable")[: 0 if alone else max(p.n_features for p in PREDICTORS)]
        self.neighbours = heaviest[weights[heaviest] > 0.0]
        self.known = state.known[:, marker]
        self.hinge_ends = find_ends(state.distances, marker, self.neighbours)
        self.incomplete_training = False
        # The frames of the adjacent samples, the frames that windows need beside them, and the samples.
        reach = max(1, round(ADJACENT_REACH * state.rate))
        bridgeable = (self.known | self._well_filled()) & self._follows_neighbours()
        self.before, self.after = adjacent_frames(bridgeable, start, stop, reach, state.rate)
        edge = max(1, round(WINDOW_EDGE * state.rate / REFERENCE_RATE))
        self.edges = edge * (len(self.before) > 0), edge * (len(self.after) > 0)
        self.rest = state.rest(marker)
        self.beside = state.positions[self.before, marker], state.positions[self.after, marker]

    @property
    def can_be_filled(self) -> bool:
        """Whether enough samples of the marker are known."""
        return bool(np.count_nonzero(self.known) >= MIN_TRAINING)

    def compares_alike(self, evidence: Evidence) -> bool:
        """Whether windows that resemble the gap decide between its neighbours and the marker's own path.

        The marker may stay, or move on as it did.
        """
        return bool(evidence.own_path) and (self._at_rest() or self._advantage(evidence) >= CLEARLY_BETTER)

    def answer(self, evidence: Evidence, alike: Evidence | None) -> Answer | None:
        """Return positions (L, 3) and SD (L,) per coordinate, mm; None without evidence.

        alike: the evidence on windows that resemble the gap, or None where it is not compared.
        """
        if alike:
            if self._at_rest():
                # It stays: a curve through later samples would take part in a move after the gap.
                alike = alike._replace(own_path=alike.own_path[:1])
            if self._advantage(alike) >= CLEARLY_BETTER:
                return self._moving_more(alike.plan, self._combined(alike.plan, alike.own_path))
        short = self.stop - self.start <= round(LONGEST_MIXED * self.state.rate)
        if short and evidence.own_path and self._advantage(evidence) > 1.0:
            return self._combined(evidence.plan, evidence.following + evidence.own_path)
        return self._following(evidence)

    def _at_rest(self) -> bool:
        """Whether the marker rests beside the gap, on both sides at one place."""
        return self.rest.kind(*self.beside) == AT_REST

    def _following(self, evidence: Evidence) -> Answer | None:
        """Return the stacked answer of the neighbours, less sure in poses unlike those that it was learnt from."""
        plan, answer = evidence.plan, self._combined(evidence.plan, evidence.following)
        length = int(plan.inside[-1]) + 1
        if answer is None or length >= len(plan.gap):
            return answer
        neighbours, known = self.state.positions[:, self.neighbours], np.flatnonzero(self.known)
        floor = EQUAL_POSES * self.state.params.noise
        return answer[0], answer[1] * np.sqrt(pose_growth(neighbours, known, plan.gap, length, floor))

    def _combined(self, plan: SamplingPlan, results: list[KrigingResult]) -> Answer | None:
        """Return the stacked answer of some results; None without any."""
        return combine(results, plan, self.state.params.noise, self.state.params.shrinkage) if results else None

    def _advantage(self, evidence: Evidence) -> float:
        """Return how many times larger the mean square error in windows is from neighbours than from the own path."""
        if not evidence.following:
            return np.inf
        return window_errors_ratio(evidence.following, evidence.own_path, self.state.params)

    def _moving_more(self, plan: SamplingPlan, answer: Answer | None) -> Answer | None:
        """Return an answer with an SD that grows where the marker moves more across the gap than across windows.

        It grows in proportion, up to the RMS distance of the samples on both sides from their mean. Where windows are
        shorter than the gap the SD grows with the length: what moves on moves farther.
        """
        if answer is None or not len(plan.windows):
            return answer
        length, floor = int(plan.inside[-1]) + 1, self.state.params.noise**2
        answer = answer[0], answer[1] * np.sqrt(len(plan.gap) / length)
        in_windows = median(self.rest.variances(plan.windows[:, 0], length, self.edges))
        in_gap = self.rest.variance(*self.beside)
        positions, sd = answer
        widened = sd * np.sqrt(max(1.0, (in_gap + floor) / (in_windows + floor)))
        return positions, np.minimum(widened, np.maximum(sd, np.sqrt(in_gap)))

    def plan(self, *, resembling: bool) -> SamplingPlan:
        """Return the frames to learn, test and bridge from, where possible frames in which all neighbours are known.

        resembling: whether only windows that resemble the gap are used, if there are enough.
        """
        state, n_frames = self.state, len(self.known)
        missing_share, kind = self._missing_share(), self.rest.kind(*self.beside)

        def alike(starts: Ints, length: int) -> Bools:
            """Return the windows that resemble the gap."""
            return np.asarray(self.rest.kinds(starts, length, self.edges) == kind, dtype=bool)

        # Windows are bridged from the same sides as the gap.
        length, most = self.stop - self.start, state.params.windows
        chosen = alike if resembling else None
        starts, length = window_starts(self.known, missing_share, length, most, self.edges, state.n_own, chosen)
        inside, adjacent = window_offsets(length, state.rate, self.edges[0] > 0, self.edges[1] > 0)
        # Adjacent frames beyond the take are clipped to it and counted as unknown.
        unclipped = starts[:, None] + np.append(inside, adjacent)
        windows = np.clip(unclipped, 0, n_frames - 1)
        training = self._training(missing_share)
        return SamplingPlan(
            training=training,
            windows=windows,
            inside=inside,
            adjacent=adjacent,
            adjacent_known=((windows == unclipped) & self.known[windows])[:, len(inside) :],
            gap_adjacent=np.append(self.before[::-1], self.after),
            gap=np.arange(self.start, self.stop),
        )

    def _training(self, missing_share: Floats) -> Ints:
        """Return the frames to learn from: those of the take, then those of its session that the take lacks."""
        n_own, most = self.state.n_own, self.state.params.learnt
        training, self.incomplete_training = training_frames(self.known[:n_own], missing_share[:n_own], most)
        complete = self.known[n_own:] & (missing_share[n_own:] <= 0.0)
        return np.append(training, n_own + session_frames(complete, len(training), most))

    def _missing_share(self) -> Floats:
        """Return the share (F,) of the neighbours, by weight, that is missing in each frame of the take."""
        if not len(self.neighbours):
            return np.zeros(len(self.known))
        weights = np.zeros(len(self.state.distances.mean))
        weights[self.neighbours] = self.state.distances.weights(self.marker)[self.neighbours]
        return np.asarray(self.state.missing @ (weights / weights.sum()), dtype=np.float64)

    def _well_filled(self) -> Bools:
        """Return the filled samples (F,) of the marker elsewhere whose variance is at most a quarter of that of this
        part.
        """
        well_filled: Bools = ~self.known & self._reusable(self.state.sd[:, self.marker])
        well_filled[self.start : self.stop] = False
        return well_filled

    def _follows_neighbours(self) -> Bools:
        """Return the frames (F,) in which nearly all neighbours, by weight, are known or filled well."""
        near = self.neighbours
        weights = self.state.distances.weights(self.marker)[near]
        unknown = ~self.state.known[:, near] & ~self._reusable(self.state.sd[:, near])
        return np.asarray(unknown @ weights <= MAX_ADJACENT_MISSING * weights.sum(), dtype=bool)

    def _reusable(self, sd: Floats) -> Bools:
        """Return which samples of any shape have a variance, from their SD, of at most a quarter of that of this part.

        NaN, where nothing is filled, is not.
        """
        own_variance = np.square(self.state.sd[self.start : self.stop, self.marker]).mean()
        return np.asarray(np.square(sd) <= MAX_REUSED_VARIANCE * own_variance, dtype=bool)
