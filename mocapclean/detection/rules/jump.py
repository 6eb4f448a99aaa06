"""Jumps: a marker is elsewhere for a while and comes back, as when a reflection is taken for it.

As ``spike``, for longer spans. What goes and comes back is the jump, even if it lasts up to a second longer than the
rest of the path. Where a marker steps away and does not come back, the shorter side is distrusted if it
is shorter than 1.25 seconds; what lasts longer is ``drift``.
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

    shortest: Annotated[int, Field(ge=1, description="frames; what is shorter is a spike")] = 4
    least: Annotated[float, Field(ge=8, description="mm off the path")] = 8.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) of long excursions."""
    study = evidence.study
    jumps = np.zeros_like(study.bursts)
    for marker, start, stop in column_runs((study.deviation > 0) & ~study.bursts):
        if stop - start >= params.shortest and study.deviation[start:stop, marker].max() >= params.least:
            jumps[start:stop, marker] = True

    def message(marker: int, start: int, stop: int) -> str:
        return f"{study.excursion(marker, start, stop)} off its path {lasting(start, stop)}"

    return jumps, tuple(findings("jump", evidence.take, jumps, message, "look at the label and at reflections"))
