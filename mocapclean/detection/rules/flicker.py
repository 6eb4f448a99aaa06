"""Flicker: a burst of noise, as near an occlusion when few cameras see a marker.

The median change of five frames is beyond what the marker's own noise and the acceleration around it explain, both in
the world and as seen by the markers around it, for at least four frames.
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

    shortest: Annotated[int, Field(ge=3, description="frames")] = 3


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) of bursts."""
    bursts = np.zeros_like(evidence.study.bursts)
    for marker, start, stop in column_runs(evidence.study.bursts):
        bursts[start:stop, marker] = stop - start >= params.shortest

    def message(marker: int, start: int, stop: int) -> str:
        return f"flickers {lasting(start, stop)}"

    return bursts, tuple(findings("flicker", evidence.take, bursts, message, "look at what hides it from cameras"))
