"""One round of the analysis: residuals, breaks and deviations of all paths, and how they change when a step is removed.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mocapclean.arrays import Bools, Floats
from mocapclean.detection.breaks import break_thresholds, bursts, innovations
from mocapclean.detection.paths import Deviations, PathCosts, deviations
from mocapclean.detection.prediction import Prediction, steps_of
from mocapclean.detection.rigid_pairs import RigidPairs
from mocapclean.detection.steps import SLIDE_SECONDS, SNAP, Step, is_certain, same_time
from mocapclean.geometry.distances import Rigidity
from mocapclean.numerics.robust import median, nan_median

CLOSEST_PARTNERS = 5  # partners whose distances and faults count for a step
_LINK_SECONDS = 1.25  # s, cost of a link of a path that nothing explains
_END_SECONDS = 0.5  # s, cost of an end of a path that is left out
_RISE_SHARE = 0.5  # share of a step that its largest rise must exceed for the step to be moved there
_SUDDEN_REACH = 1  # frames on each side of a sudden step that may not be breaks
_DISTANCE_SLACK = 3.0  # mm, robust SD of a distance below which partners count as equally rigid
_RIGID_SD = 10.0  # mm, median robust SD of the distances to the closest partners up to which these can show a step
_LEAST_AGREEMENT = 0.5  # share of their changes that a step must explain to agree with them
_SMOOTHED = (
    11  # frames of the running median that is the guide of a marker without a prediction; 5 faulty do not move it
)
_LEAST_CHANGE = 1e-9  # mm, keeps distances that do not change from a division by 0


@dataclass(frozen=True)
class Body:
    """The markers' relations, the same in all rounds: rigidity, rigid pairs, the rate in Hz.

    attached: (M,), the markers that move with others.
    """

    rigid: Rigidity
    pairs: RigidPairs
    rate: float
    attached: Bools


@dataclass(frozen=True)
class Round:
    """The input of a round of the analysis.

    positions: (F, M, 3) mm, less the known steps. usable: (F, M), the samples to learn from. steps: the known steps.
    """

    positions: Floats
    usable: Bools
    steps: tuple[Step, ...]


class MarkerPaths:
    """The paths of all markers in one round.

    measured: (F, M), the trusted samples outside of holds. positions, residual: (F, M, 3), NaN where not measured.
    threshold: (F, M) mm. breaks, bursts: (F, M). deviation: (F, M) mm, the distance from the path. off_path: (F, M),
    the samples off the path between its first and last frame; samples before and after it may belong to a step. costs:
    (M,), of the paths, in frames. leaps: marker, last frame before and first frame after each link of a path that
    nothing explains. found: the deviations of the markers with breaks. last: the paths of the round before, whose
    deviations markers keep if nothing about them has changed.
    """

    def __init__(
        self,
        given: Round,
        filled: Floats,
        prediction: Prediction,
        measured: Bools,
        body: Body,
        last: "MarkerPaths | None" = None,
    ) -> None:
        self.body, self.filled, self.rotation = body, filled, prediction.rotation
        self.measured, self.usable = measured, given.usable
        self.path_costs = PathCosts(link=_LINK_SECONDS * body.rate, end=_END_SECONDS * body.rate)
        self.half_slide = round(SLIDE_SECONDS * body.rate / 2)
        self.positions = np.where(measured[..., None], given.positions, np.nan)
        # Residual in the axes of the segment: r = (x - x̂) R, for row vectors.
        self.residual = np.einsum("fmi,fmij->fmj", self.positions - prediction.positions, prediction.rotation)
        innovation = innovations(self.positions, self.residual)
        guide = _guide(filled, prediction)
        self.threshold = break_thresholds(innovation, given.usable, guide)
        self.breaks = innovation > self.threshold
        for step in given.steps:
            self._clear_breaks(self.breaks[:, step.marker], step)
        self.deviation, self.costs = np.zeros(measured.shape), np.zeros(measured.shape[1])
        self.off_path, self.leaps = np.zeros_like(measured), list[tuple[int, int, int]]()
        self.found = dict[int, Deviations]()
        for marker in np.flatnonzero(self.breaks.any(axis=0)).tolist():
            if last is not None and marker in last.found and self._is_as_in(last, marker):
                path = last.found[marker]
            else:
                path = self._deviations(marker, self.residual[:, marker], self.breaks[:, marker])
            self.found[marker] = path
            self.leaps += [(marker, *leap) for leap in path.leaps]
            self.deviation[:, marker], self.costs[marker] = path.distance, path.cost
            self.off_path[path.span, marker] = path.distance[path.span] > 0
        self.bursts = bursts(innovation, given.usable, guide) & measured

    def refined(self, step: Step) -> Step:
        """Return a step moved to the frame of its largest rise, with the changed rigid pairs and the agreement of
        distances.

        It is moved by up to 10 frames, to a rise of more than half of it, and is sudden if it breaks there. Distances
        can agree with it where the closest partners are rigid: a median robust SD of up to 10 mm.
        """
        size, low = float(np.linalg.norm(step.offset)), max(1, step.start - SNAP)
        residual = self.residual[low - 1 : step.start + SNAP + 1, step.marker]
        rises = np.nan_to_num(np.diff(residual, axis=0) @ step.offset / size)
        if rises.max(initial=0.0) > _RISE_SHARE * size:
            start = low + int(np.argmax(rises))
            step = replace(step, start=start, sudden=bool(self.breaks[start, step.marker]))
        closest = self.body.rigid.partners(step.marker)[0][:CLOSEST_PARTNERS]
        are_rigid = median(self.body.rigid.spread[step.marker, closest]) <= _RIGID_SD
        return replace(
            step,
            changed_pairs=len(self.body.pairs.changed(step.marker, step.start)),
            distances_agree=bool(are_rigid) and self.agreement(step) >= _LEAST_AGREEMENT,
        )

    def is_no_worse_without(self, step: Step) -> bool:
        """Whether the path of a marker costs no more after its step is removed."""
        return self._without(step).cost <= float(self.costs[step.marker])

    def readmit(self, step: Step) -> None:
        """Keep as off the path only the samples that remain off it without a certain step, if its removal lowers the
        cost.

        Only where the step is certain, the path then costs less, and no sample of the path is lost at its ends.
        """
        path = self._without(step)
        lost = (path.distance > 0) & (self.deviation[:, step.marker] == 0)
        lost[path.span] = False
        if is_certain(step) and path.cost < self.costs[step.marker] and not lost.any():
            self.off_path[:, step.marker] = False
            self.off_path[path.span, step.marker] = path.distance[path.span] > 0

    def score_without(self, step: Step, removed: Step) -> float:
        """Return the score of a marker's step at about the same time after another marker's step is removed."""
        filled = self.filled.copy()
        filled[removed.start :, removed.marker] -= self.rotation[removed.start :, removed.marker] @ removed.offset
        only = np.arange(filled.shape[1]) == step.marker
        left = steps_of(filled, self.usable, self.body.rigid, 2 * self.half_slide, only)
        return max((other.score for other in left if self.same_time(other, step)), default=0.0)

    def agreement(self, step: Step, excluded: int | None = None) -> float:
        """Return the share, at most 1, of the changes in the distances to the closest partners that a step explains.

        1 - Σ w |d(undone) - d(before)| / Σ w |d(after) - d(undone)| over the partners. d are median distances
        before and after the step, and after it with the offset undone; w = 1 / (SD + 3 mm). One partner can be
        excluded.
        """
        partners = self.body.rigid.partners(step.marker)[0]
        partners = partners[partners != excluded][:CLOSEST_PARTNERS]
        weights = 1.0 / (self.body.rigid.spread[step.marker, partners] + _DISTANCE_SLACK)
        offsets = self.positions[:, partners] - self.positions[:, [step.marker]]
        undone = offsets[step.start :] + (self.rotation[step.start :, step.marker] @ step.offset)[:, None]
        d_before, d_after, d_undone = (
            nan_median(np.linalg.norm(part, axis=2)) for part in (offsets[: step.start], offsets[step.start :], undone)
        )
        unexplained, change = weights @ np.abs(d_undone - d_before), weights @ np.abs(d_after - d_undone)
        return float(1.0 - unexplained / max(change, _LEAST_CHANGE))

    def same_time(self, one: Step, other: Step) -> bool:
        """Whether two steps happen at about the same time."""
        return same_time(one, other, len(self.measured))

    def are_partners(self, one: int, other: int) -> bool:
        """Whether one of two markers is a partner of the other."""
        partners = self.body.rigid.partners
        return other in partners(one)[0] or one in partners(other)[0]

    def _without(self, step: Step) -> Deviations:
        """Return the deviations of a step's marker with the step removed."""
        residual, breaks = self.residual[:, step.marker].copy(), self.breaks[:, step.marker].copy()
        residual[step.start :] -= step.offset
        self._clear_breaks(breaks, step)
        return self._deviations(step.marker, residual, breaks)

    def _deviations(self, marker: int, residual: Floats, breaks: Bools) -> Deviations:
        """Return the deviations of a marker with these residuals (F, 3) and breaks (F,)."""
        threshold, usable = self.threshold[:, marker], self.usable[:, marker]
        return deviations(self.positions[:, marker], residual, breaks, threshold, usable, self.path_costs)

    def _is_as_in(self, last: "MarkerPaths", marker: int) -> bool:
        """Whether a marker's deviations follow from the same values as in the round before."""
        return all(
            np.array_equal(now[:, marker], then[:, marker], equal_nan=now.dtype == float)
            for now, then in (
                (self.residual, last.residual),
                (self.positions, last.positions),
                (self.breaks, last.breaks),
                (self.threshold, last.threshold),
                (self.usable, last.usable),
            )
        )

    def _clear_breaks(self, breaks: Bools, step: Step) -> None:
        """Clear, in place, the breaks (F,) caused by a step: within a frame of a sudden one, or throughout a slide."""
        reach = _SUDDEN_REACH if step.sudden else self.half_slide
        breaks[max(0, step.start - reach) : step.start + reach + 1] = False


def _guide(filled: Floats, prediction: Prediction) -> Floats:
    """Return positions (F, M, 3) that accelerate as the markers do: the predicted ones, or else smoothed paths."""
    guide = prediction.positions.copy()
    for marker in np.flatnonzero(~prediction.predicted):
        guide[:, marker] = _running_median(filled[:, marker])
    return guide


def _running_median(path: Floats) -> Floats:
    """Return the median over time of each coordinate of a path (F, 3); the ends are repeated."""
    half = _SMOOTHED // 2
    windows = sliding_window_view(np.pad(path, ((half, half), (0, 0)), mode="edge"), _SMOOTHED, axis=0)
    return np.partition(windows, half, axis=2)[..., half]
