"""Distrust spikes: up to three frames in which a marker leaves its path and returns.

A sample is off the path when it lies farther from it than the threshold of its marker, which is at least 8 mm. The
threshold follows from the marker's noise and the acceleration of its predicted positions
(``mocapclean.detection.breaks``). A marker leaves its path by a break both in the world and relative to its partners.
Longer excursions belong to ``jump``.
"""

from typing import Annotated

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.excursions import LEAST_EXCURSION, LONGEST_SPIKE, examine_excursions
from mocapclean.detection.rule import Level, Ruling, Switch
from mocapclean.parameters import Field, parameters


@parameters
class Params(Switch):
    """The parameters of the rule."""

    replace: Annotated[Level, Field(description="whose findings distrust samples")] = "enclosed"
    longest: Annotated[int, Field(ge=1, description="frames; a longer excursion is a jump")] = LONGEST_SPIKE
    least: Annotated[float, Field(ge=LEAST_EXCURSION, description="mm off the path")] = LEAST_EXCURSION


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) of short excursions, and their findings."""
    advice = "nothing, if the fill looks right"
    return examine_excursions("spike", evidence, params.least, advice, longest=params.longest)
