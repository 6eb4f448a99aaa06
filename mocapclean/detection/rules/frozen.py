"""Distrust markers that hold their place exactly while their partners move on, as in a gap filled by the last value.

No coordinate changes by more than 0.005 mm per frame for at least five frames, while the predicted position moves 5 mm.
Then the marker goes missing, or leaps by 5 mm and twice its next step: feet on the ground do neither. A hold of half of
the marker's frames or more is left alone, because props rest for most of a take.
"""

from typing import Annotated

import numpy as np

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.holds import LEAST_MOTION, SHORTEST_HOLD
from mocapclean.detection.rule import Ruling, Switch, duration
from mocapclean.parameters import Field, parameters
from mocapclean.take import Finding


@parameters
class Params(Switch):
    """The parameters of the rule."""

    shortest: Annotated[int, Field(ge=SHORTEST_HOLD, description="frames")] = SHORTEST_HOLD
    least: Annotated[float, Field(ge=LEAST_MOTION, description="mm that the predicted position moves meanwhile")] = (
        LEAST_MOTION
    )


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) of holds that are long enough, and their findings."""
    take = evidence.take
    frozen, findings = np.zeros_like(take.trusted), []
    for hold in evidence.analysis.holds:
        if hold.stop - hold.start < params.shortest or hold.moved < params.least:
            continue
        frozen[hold.start : hold.stop, hold.marker] = True
        lasting = duration(hold.start, hold.stop)
        findings.append(
            Finding(
                rule="frozen",
                level="warning",
                marker=take.markers[hold.marker],
                frames=(hold.start, hold.stop),
                message=f"holds still {lasting} while its predicted position moves {hold.moved:.0f} mm",
                advice="look for a gap that was filled with the last value",
            )
        )
    return frozen, tuple(findings)
