"""Frozen markers: a marker holds exactly still while the markers around it say that it moves.

Exactly: no coordinate changes by more than 0.005 mm a frame. When it is let go it must leap by 5 mm and twice as far as
in the next frame, or go missing, and it must be on the move for most of the take: feet on the ground do neither.
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch
from mocapclean.parameters import STRICT
from mocapclean.take import Finding


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    shortest: Annotated[int, Field(ge=5, description="frames")] = 5
    least: Annotated[float, Field(ge=5, description="mm that it should have moved meanwhile")] = 5.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) that repeat the one before them."""
    take = evidence.take
    frozen, told = np.zeros_like(take.trusted), []
    for hold in evidence.study.holds:
        length = hold.stop - hold.start
        if length >= params.shortest and hold.moved >= params.least:
            frozen[hold.start : hold.stop, hold.marker] = True
            told.append(
                Finding(
                    rule="frozen",
                    level="warning",
                    marker=take.markers[hold.marker],
                    frames=(hold.start, hold.stop),
                    message=f"holds still for {length} frames while the markers around it move it {hold.moved:.0f} mm",
                    advice="look for a gap that was filled with the last value",
                )
            )
    return frozen, tuple(told)
