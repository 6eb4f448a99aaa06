"""Report splices: a jump of a joint that does not come back, as where two pieces were joined.

Nothing shows which side is right, so that no trust is lowered (``mocapclean.detection.joints``).
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
        "never"
    )


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the joints (F, J) of the faults, and their findings."""
    return joint_findings("splice", evidence, "look at the parts that were joined here")
