"""Takes with known truth: a figure that walks and boxes, its markers and skeletons, lost samples, and faults."""

from mocapclean.simulate.cameras import N_CAMERAS, occlude_by_cameras
from mocapclean.simulate.faults import FAULTS, Event, Injected, inject
from mocapclean.simulate.figure import asf_skeleton, bvh_skeleton
from mocapclean.simulate.markers import MARKERS
from mocapclean.simulate.occlusion import block_loss, hide, lose_channels, occlude, random_loss, single_gaps
from mocapclean.simulate.performance import MOTIONS, Performance, perform
from mocapclean.simulate.props import prop
from mocapclean.simulate.variations import VARIATIONS, Variation, vary

__all__ = [
    "FAULTS",
    "MARKERS",
    "MOTIONS",
    "N_CAMERAS",
    "VARIATIONS",
    "Event",
    "Injected",
    "Performance",
    "Variation",
    "asf_skeleton",
    "block_loss",
    "bvh_skeleton",
    "hide",
    "inject",
    "lose_channels",
    "occlude",
    "occlude_by_cameras",
    "perform",
    "prop",
    "random_loss",
    "single_gaps",
    "vary",
]
