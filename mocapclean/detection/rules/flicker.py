"""Distrust bursts of noise, as near an occlusion, when few cameras see a marker.

The median innovation of five frames exceeds its threshold for at least four frames. The innovation must be large both
in the world and relative to the partners; the threshold follows from noise and acceleration, as for ``spike``.
"""

from typing import Annotated

import numpy as np

from mocapclean.arrays import column_runs
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import LONGEST_REPLACED, Level, Ruling, Switch, duration, findings
from mocapclean.parameters import Field, parameters


@parameters
class Params(Switch):
    """The parameters of the rule."""

    replace: Annotated[Level, Field(description="whose findings distrust samples")] = "enclosed"
    longest_replaced: Annotated[
        float, Field(ge=0, description="seconds; a longer one is a suspicion even where the path encloses it")
    ] = LONGEST_REPLACED
    shortest: Annotated[int, Field(ge=3, description="frames")] = 3


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) of bursts, and their findings."""
    bursts = np.zeros_like(evidence.analysis.bursts)
    for marker, start, stop in column_runs(evidence.analysis.bursts):
        bursts[start:stop, marker] = stop - start >= params.shortest

    def message(marker: int, start: int, stop: int) -> str:
        return f"flickers {duration(start, stop)}"

    advice = "look for an occlusion near these frames"
    return bursts, tuple(findings("flicker", evidence.take, bursts, message, advice))
