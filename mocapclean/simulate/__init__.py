"""Takes with known truth: a figure that walks and boxes, its markers and skeletons, and ways to lose samples."""

from mocapclean.simulate.figure import asf_skeleton, bvh_skeleton
from mocapclean.simulate.markers import MARKERS
from mocapclean.simulate.occlusion import block_loss, hide, lose_channels, occlude, random_loss, single_gaps
from mocapclean.simulate.performance import MOTIONS, Performance, perform

__all__ = [
    "MARKERS",
    "MOTIONS",
    "Performance",
    "asf_skeleton",
    "block_loss",
    "bvh_skeleton",
    "hide",
    "lose_channels",
    "occlude",
    "perform",
    "random_loss",
    "single_gaps",
]
