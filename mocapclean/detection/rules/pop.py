"""Distrust pops: a few frames in which a joint leaves its path abruptly and comes back, in rotation or translation.

A pop belongs to the joint whose own channels jump; what hangs on it keeps its channels. It is measured against the path
through the frames on both sides, the noise of the joint, and how fast and jerkily it moves around the pop
(``mocapclean.detection.joints``).
"""

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import JointSwitch, Ruling, joint_findings
from mocapclean.parameters import parameters

COLUMNS = ("joints",)


@parameters
class Params(JointSwitch):
    """The parameters of the rule."""


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the joints (F, J) of the faults, and their findings."""
    return joint_findings("pop", evidence, "look at the frame; nothing, if the fill looks right")
