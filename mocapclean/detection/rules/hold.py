"""Distrust holds: frames in which the channels of a moving joint keep exactly one value, until a jump releases them.

A solver that loses a limb repeats its last pose. Joints that rest, poses that stand, and planted feet are no faults
(``mocapclean.detection.joints``).
"""

from typing import Annotated

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Level, Ruling, Switch, joint_findings
from mocapclean.parameters import Field, parameters

COLUMNS = ("joints",)


@parameters
class Params(Switch):
    """The parameters of the rule."""

    replace: Annotated[Level, Field(description="whose findings distrust samples: those that are sure, or none")] = (
        "always"
    )


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the joints (F, J) of the faults, and their findings."""
    return joint_findings("hold", evidence, "look for a gap that was filled with the last pose")
