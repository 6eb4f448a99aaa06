"""Iterative search of all trajectories for holds, lasting steps, and samples that deviate from the rest of their path.

Faults hide each other, because a marker at fault spoils the prediction of its partners. The analysis therefore runs in
rounds: each round predicts all markers from the samples that the rounds before found reliable, and removes the steps
that it attributes to a marker. Nothing is distrusted here; that is for the rules.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.detection.attachment import attached
from mocapclean.detection.attribution import attributed_steps, credible_steps
from mocapclean.detection.holds import Hold, find_holds, hold_mask
from mocapclean.detection.marker_paths import Body, MarkerPaths, Round
from mocapclean.detection.prediction import Completion, Prediction, affected, complete, predict
from mocapclean.detection.rigid_pairs import RigidPairs
from mocapclean.detection.step_search import LONGEST_SLIDE
from mocapclean.detection.steps import SLIDE_SECONDS, Step
from mocapclean.geometry.distances import Rigidity

_ROUNDS = 5  # rounds at most
_SETTLED = 5e-4  # share of all samples that may still change from round to round
_LEAST_USABLE = 0.9  # share of the trusted samples that must stay usable: below it more rounds do not help


@dataclass(frozen=True, kw_only=True)
class PathAnalysis:
    """The result of the last round; arrays are (F, M), lengths mm.

    holds, steps: markers that keep their place, and that sit elsewhere in their segment. residual: (F, M, 3), the
    position less the predicted one in the axes of the segment, with the steps removed, NaN in holds. threshold: the
    innovation above which a frame is a break. deviation: the distance from the path of the marker, 0 on it. bursts: the
    samples in bursts of noise. predicted: (M,), whether a marker is predicted. leaps: marker, last frame before and
    first frame after each leap: a link of a path that nothing explains. breaks: (F, M), where a path breaks.
    """

    holds: tuple[Hold, ...]
    steps: tuple[Step, ...]
    residual: Floats
    threshold: Floats
    deviation: Floats
    bursts: Bools
    predicted: Bools
    leaps: tuple[tuple[int, int, int], ...]
    breaks: Bools


def analyse(positions: Floats, trusted: Bools, rigid: Rigidity, rate: float) -> PathAnalysis:
    """Return the analysis of positions (F, M, 3) with trust (F, M), taken at ``rate`` Hz."""
    pairs = RigidPairs(np.where(trusted[..., None], positions, np.nan), rigid, rate)
    body = Body(rigid, pairs, rate, attached(positions, trusted, rigid, rate))
    given, previous, known, last = Round(positions, trusted, ()), trusted, None, None
    sliding = np.zeros_like(trusted)
    for index in range(_ROUNDS):
        known = _predicted(given, body, known, with_steps=index < _ROUNDS - 1)
        filled, prediction = known[0].filled, known[1]
        holds = find_holds(given.positions, trusted, prediction)
        paths = MarkerPaths(given, filled, prediction, trusted & ~hold_mask(holds, trusted), body, last)
        credible = credible_steps(prediction.steps, paths)
        candidates = _candidates(credible, given.steps, paths)
        for step in candidates:
            paths.readmit(step)
        usable = paths.measured & ~paths.off_path & ~paths.bursts & ~sliding
        # Outliers found in the first round have spoilt its predictions: steps that they may look like are judged later.
        suspect = np.asarray((given.usable & ~usable).any(axis=0) & (index == 0))
        steps = attributed_steps(candidates, credible, given.steps, suspect, paths)
        # The rounds end when nothing changes any more, even if they alternate between two results.
        changes = [np.count_nonzero(usable ^ earlier) for earlier in (given.usable, previous)[: max(1, index)]]
        settled = not steps and min(changes) <= _SETTLED * usable.size
        if settled or np.count_nonzero(usable) < _LEAST_USABLE * np.count_nonzero(trusted):
            break
        sliding |= _slides(steps, trusted, rate)
        last, removed = paths, (*given.steps, *steps)
        given, previous = Round(_removed(steps, given, prediction), usable & ~sliding, removed), given.usable
    return PathAnalysis(
        holds=holds,
        steps=given.steps,
        residual=paths.residual,
        threshold=paths.threshold,
        deviation=paths.deviation,
        bursts=paths.bursts,
        predicted=prediction.predicted,
        leaps=tuple(paths.leaps),
        breaks=paths.breaks,
    )


def _predicted(
    given: Round, body: Body, known: tuple[Completion, Prediction] | None, *, with_steps: bool
) -> tuple[Completion, Prediction]:
    """Return the completed positions of all markers, and their prediction from these.

    known: those of the round before. Markers that changed neither themselves nor in a partner keep theirs.
    """
    slide = round(SLIDE_SECONDS * body.rate) if with_steps else None
    if known is None:
        completion = complete(given.positions, given.usable, body.rigid, body.attached)
        return completion, predict(completion.filled, given.usable, body.rigid, slide=slide, only=body.attached)
    last, prediction = known
    completion = complete(given.positions, given.usable, body.rigid, body.attached, last)
    kept = prediction, ~affected(last.filled, last.usable, completion.filled, given.usable, body.rigid)
    only = body.attached
    return completion, predict(completion.filled, given.usable, body.rigid, slide=slide, only=only, known=kept)


def _candidates(credible: list[Step], known: tuple[Step, ...], paths: MarkerPaths) -> list[Step]:
    """Return credible steps of markers without an accepted one whose removal leaves the cost of the path no higher."""
    stepped = {step.marker for step in known}
    return [step for step in credible if step.marker not in stepped and paths.is_no_worse_without(step)]


def _slides(steps: list[Step], trusted: Bools, rate: float) -> Bools:
    """Return the samples (F, M) that may belong to a slide before or after each step that is not sudden."""
    slides = np.zeros_like(trusted)
    reach = min(round(SLIDE_SECONDS * rate), int(LONGEST_SLIDE * len(trusted)))
    for step in steps:
        if not step.sudden:
            slides[max(0, step.start - reach) : step.start + reach, step.marker] = True
    return slides


def _removed(steps: list[Step], given: Round, prediction: Prediction) -> Floats:
    """Return the positions (F, M, 3) of a round with steps removed: x - R o from the start of each step on."""
    positions = given.positions.copy()
    for step in steps:
        rotation = prediction.rotation[step.start :, step.marker]
        positions[step.start :, step.marker] -= rotation @ step.offset
    return positions
