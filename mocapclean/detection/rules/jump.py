"""Distrust runs of four or more frames in which a marker lies off its path, as when a reflection carries its label.

As ``spike``, for longer excursions. An excursion is distrusted even if it lasts up to a second longer than the rest of
the path. If a marker leaves its path for good, the shorter side is distrusted if it lasts less than 1.25 seconds; a
longer one belongs to ``drift``.
"""

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.excursions import LEAST_EXCURSION, SHORTEST_JUMP, examine_excursions
from mocapclean.detection.rule import Ruling, Switch
from mocapclean.parameters import STRICT


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The parameters of the rule."""

    shortest: Annotated[int, Field(ge=1, description="frames; a shorter excursion is a spike")] = SHORTEST_JUMP
    least: Annotated[float, Field(ge=LEAST_EXCURSION, description="mm off the path")] = LEAST_EXCURSION


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) of long excursions, and their findings."""
    advice = "look at the label and at reflections"
    return examine_excursions("jump", evidence, params.least, advice, shortest=params.shortest)
