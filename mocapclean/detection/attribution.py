"""Decide which apparent steps are real and which marker shifted: a shift disturbs the predictions of other markers too.

A marker that steps spoils the prediction of its partners, which then seem to step at the same time. Only the marker at
fault must be corrected; the side effects at its partners vanish with it, in the next round.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.detection.marker_paths import CLOSEST_PARTNERS, MarkerPaths
from mocapclean.detection.steps import ENOUGH_PAIRS, LEAST_SCORE, LEAST_STEP, Step, is_certain, least_score

_LEAST_SHARE = 0.6  # share of the least score below which no evidence makes a step credible
_LEAST_AGREEMENT = 0.2  # agreement with the distances to partners that corroborates a slide
_LEAST_RIVAL = 0.5  # share of a step's score from which on a partner's step may be its cause
_EVEN = 0.7  # share of a step's score from which on a partner's step is about as large
_RIVAL_AGREEMENT = 0.3  # agreement with the distances that a rival about as large must exceed


def credible_steps(steps: tuple[Step, ...], paths: MarkerPaths) -> list[Step]:
    """Return the steps, with their evidence, that are large enough and have the score that this evidence requires.

    The step with the highest score comes first.
    """
    large = (step for step in steps if np.linalg.norm(step.offset) >= LEAST_STEP)
    refined = (paths.refined(step) for step in large if step.score >= _LEAST_SHARE * LEAST_SCORE)
    credible = (step for step in refined if step.score >= least_score(step))
    return sorted(credible, key=lambda step: -step.score)


def attributed_steps(
    candidates: list[Step], credible: list[Step], known: tuple[Step, ...], suspect: Bools, paths: MarkerPaths
) -> list[Step]:
    """Return the candidates caused by a shift of their own marker, not of a partner, highest score first.

    Of partners that step at the same time only one is returned, unless the step is a side effect of another. credible:
    all credible steps, candidates or not. known: the steps of earlier rounds. suspect: the markers (M,) with samples
    that turned out to be off their path in this round.
    """
    chosen: list[Step] = []
    for step in candidates:
        if _may_be_outliers(step, suspect, paths) or not _is_corroborated(step, paths):
            continue
        if not _pairs_allow(step, credible, known, paths):
            continue
        rivals = [
            other
            for other in credible
            if _are_rivals(step, other, paths) and _pairs_allow(other, credible, known, paths)
        ]
        if any(rival.marker == earlier.marker for rival in rivals for earlier in chosen):
            continue
        if not any(_is_side_effect(step, rival, paths) for rival in rivals):
            chosen.append(step)
    return chosen


def _may_be_outliers(step: Step, suspect: Bools, paths: MarkerPaths) -> bool:
    """Whether outliers of suspect markers (M,), the step's own or a close partner, may look like the step.

    They cannot where two rigid pairs with markers that are not suspect change. The step is judged in a later round.
    """
    reliable = ~suspect[paths.body.pairs.changed(step.marker, step.start)]
    involved = [step.marker, *paths.body.rigid.partners(step.marker)[0][:CLOSEST_PARTNERS]]
    return bool(reliable.sum() < ENOUGH_PAIRS and suspect[involved].any())


def _is_corroborated(step: Step, paths: MarkerPaths) -> bool:
    """Whether a step is certain, sudden, or shown by two rigid pairs or by the distances to partners."""
    if step.sudden or is_certain(step) or step.changed_pairs >= ENOUGH_PAIRS:
        return True
    return paths.agreement(step) >= _LEAST_AGREEMENT


def _pairs_allow(step: Step, credible: list[Step], known: tuple[Step, ...], paths: MarkerPaths) -> bool:
    """Whether the rigid pairs of a step's marker allow it, given the other steps at the same time."""
    stepped, stepping = (
        [other.marker for other in others if paths.same_time(other, step)] for others in (known, credible)
    )
    return paths.body.pairs.allow(step, stepped, stepping)


def _are_rivals(one: Step, other: Step, paths: MarkerPaths) -> bool:
    """Whether two steps are of partners, at about the same time."""
    partners = one.marker != other.marker and paths.are_partners(one.marker, other.marker)
    return partners and paths.same_time(one, other)


def _is_side_effect(step: Step, rival: Step, paths: MarkerPaths) -> bool:
    """Whether a step appears only because a partner that steps at the same time spoils the prediction of its marker.

    It is if it vanishes when the rival is removed, and the rival stays when the step is removed. If each vanishes with
    the other and the rival is about as large, the rival must explain the changed distances to its partners better.
    """
    if rival.score < _LEAST_RIVAL * step.score:
        return False
    vanishes = paths.score_without(step, rival) < least_score(step)
    rival_stays = paths.score_without(rival, step) >= least_score(rival)
    even = vanishes and not rival_stays and rival.score >= _EVEN * step.score
    agreement, rival_agreement = paths.agreement(step, rival.marker), paths.agreement(rival, step.marker)
    return (vanishes and rival_stays) or (even and rival_agreement > max(agreement, _RIVAL_AGREEMENT))
