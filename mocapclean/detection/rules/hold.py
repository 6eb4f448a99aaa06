"""Distrust holds: frames in which the channels of a moving joint keep exactly one value, until a jump releases them.

A solver that loses a limb repeats its last pose. Joints that rest, poses that stand, and planted feet are no faults
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
    return joint_findings("hold", evidence, "look for a gap that was filled with the last pose")
