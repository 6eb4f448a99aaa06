"""Spikes: up to three frames that lie off the path of their marker, there and back.

Off the path means beyond what the marker's own noise and the acceleration around it explain, both in the world and as
seen by the markers around it (``mocapclean.detection.paths``).
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import column_runs
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, findings, lasting
from mocapclean.parameters import STRICT


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    longest: Annotated[int, Field(ge=1, description="frames; what is longer is a jump")] = 3
    least: Annotated[float, Field(ge=8, description="mm off the path")] = 8.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) of short excursions."""
    study = evidence.study
    spikes = np.zeros_like(study.bursts)
    for marker, start, stop in column_runs((study.deviation > 0) & ~study.bursts):
        if stop - start <= params.longest and study.deviation[start:stop, marker].max() >= params.least:
            spikes[start:stop, marker] = True

    def message(marker: int, start: int, stop: int) -> str:
        return f"{study.excursion(marker, start, stop)} off its path {lasting(start, stop)}"

    return spikes, tuple(findings("spike", evidence.take, spikes, message, "nothing, if the fill looks right"))
