"""Report splices: a jump of a joint that does not come back, as where two pieces were joined.

Nothing shows which side is right, so that no trust is lowered (``mocapclean.detection.joints``).
"""

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, joint_findings
from mocapclean.parameters import parameters

COLUMNS = ("joints",)


@parameters
class Params(Switch):
    """The parameters of the rule."""


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the joints (F, J) of the faults, and their findings."""
    return joint_findings("splice", evidence, "look at the parts that were joined here")
