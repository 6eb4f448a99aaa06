"""Distrust runs of four or more frames in which a marker lies off its path, as when a reflection carries its label.

As ``spike``, for longer excursions. An excursion is distrusted even if it lasts up to a second longer than the rest of
the path. If a marker leaves its path for good, the shorter side is distrusted if it lasts less than 1.25 seconds; a
longer one belongs to ``drift``.
"""

from typing import Annotated

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.excursions import LEAST_EXCURSION, SHORTEST_JUMP, examine_excursions
from mocapclean.detection.rule import LONGEST_REPLACED, Level, Ruling, Switch, leap
from mocapclean.parameters import Field, parameters
from mocapclean.take import Finding


@parameters
class Params(Switch):
    """The parameters of the rule."""

    replace: Annotated[Level, Field(description="whose findings distrust samples")] = "enclosed"
    longest_replaced: Annotated[
        float, Field(ge=0, description="seconds; a longer one is a suspicion even where the path encloses it")
    ] = LONGEST_REPLACED
    shortest: Annotated[int, Field(ge=1, description="frames; a shorter excursion is a spike")] = SHORTEST_JUMP
    least: Annotated[float, Field(ge=LEAST_EXCURSION, description="mm off the path")] = LEAST_EXCURSION


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) of long excursions, and their findings."""
    advice = "look at the label and at reflections"
    doubted, findings = examine_excursions("jump", evidence, params.least, advice, shortest=params.shortest)
    return doubted, (*findings, *_leaps(evidence))


def _leaps(evidence: Evidence) -> list[Finding]:
    """Return a suspicion for each leap of a path from one place to another, at the frames before and after it."""
    take = evidence.take
    return [
        leap(
            "jump",
            take,
            marker,
            (before, after),
            "leaves its path for good: nothing shows which side is right",
            "look at the label and at the parts that were joined here",
        )
        for marker, before, after in evidence.analysis.leaps
    ]
