"""Steps (change points, not gait steps): lasting shifts of a marker within its body segment from one frame on.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

from dataclasses import dataclass

from mocapclean.arrays import Floats

LEAST_STEP = 15.0  # mm, least size of a step
LEAST_SCORE = 10.0  # standard errors, least score of a step that nothing but the regression shows
_CERTAIN = 2.0  # times the least score from which on a step needs no other evidence
SLIDE_SECONDS = 0.5  # longest slide that leads to a step, s
SNAP = 10  # frames on each side of a step among which its largest rise is looked for
_SHARE_WITH_DISTANCES = 0.8  # share of the least score that is enough where the distances to partners agree
_SHARE_WITH_BREAK = 0.6  # the same where a rigid pair changes its distance, or the step is a break
ENOUGH_PAIRS = 2  # rigid pairs that must change to show a step by themselves: one may be its partner's fault
_SAME_TIME = 0.01  # share of the frames of the take that steps at the same time may lie apart, besides SNAP


@dataclass(frozen=True)
class Step:
    """A change point: from frame ``start`` on, a marker sits ``offset`` (3,) mm from its place in its segment's frame.

    score: the size of the offset over its standard error, with the noise of its direction. sudden: whether it happens
    within one frame. changed_pairs: how many partners change their distance to the marker that was constant before.
    distances_agree: whether the distances to the closest partners change as the offset predicts.
    """

    marker: int
    start: int
    offset: Floats
    score: float
    sudden: bool = False
    changed_pairs: int = 0
    distances_agree: bool = False


def least_score(step: Step, least: float = LEAST_SCORE) -> float:
    """Return the least score of a credible step: ``least``, or a share of it where other evidence shows the step."""
    if step.changed_pairs >= ENOUGH_PAIRS or step.sudden:
        return least * _SHARE_WITH_BREAK
    return least * (_SHARE_WITH_DISTANCES if step.distances_agree else 1.0)


def is_certain(step: Step) -> bool:
    """Whether the score alone is enough to believe a step."""
    return step.score >= _CERTAIN * LEAST_SCORE


def same_time(one: Step, other: Step, n_frames: int) -> bool:
    """Whether two steps of a take of ``n_frames`` happen at about the same time."""
    return abs(one.start - other.start) <= SNAP + _SAME_TIME * n_frames
