"""Distrust pops: a few frames in which a joint leaves its path abruptly and comes back, in rotation or translation.

A pop belongs to the joint whose own channels jump; what hangs on it keeps its channels. It is measured against the path
through the frames on both sides, the noise of the joint, and how fast and jerkily it moves around the pop
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
    return joint_findings("pop", evidence, "look at the frame; nothing, if the fill looks right")
