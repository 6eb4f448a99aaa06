"""One motion of the figure as markers, as a BVH motion and as an ASF/AMC motion."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.simulate.bounds import require_between, require_whole
from mocapclean.simulate.boxing import box
from mocapclean.simulate.figure import asf_poses, asf_skeleton, bvh_poses, bvh_skeleton
from mocapclean.simulate.markers import MARKERS, marker_positions
from mocapclean.simulate.walking import walk
from mocapclean.take import Take

MOTIONS: dict[str, Callable[[int, float, np.random.Generator], tuple[Floats, dict[str, Floats]]]] = {
    "walk": walk,
    "boxing": box,
}
"""Motions by name: functions of (n_frames, rate, rng) that return root positions (F, 3) and bone angles (F, 3)."""


@dataclass(frozen=True, kw_only=True)
class Performance:
    """A motion of the figure without gaps.

    markers: 41 markers in millimetres, x forward, y to the left, z up, as in most C3D files. bvh, bvh_poses and asf,
    asf_poses: skeletons and poses (F, C) in degrees and millimetres, x to the left, y up, z forward, as in most BVH and
    AMC files; ``mocapclean.simulate.figure.BODY`` has the corresponding joints.
    """

    name: str
    rate: float
    markers: Take
    bvh: Skeleton
    bvh_poses: Floats
    asf: Skeleton
    asf_poses: Floats


def perform(motion: str, seconds: float = 10.0, rate: float = 120.0, seed: int = 0) -> Performance:
    """Return one of ``MOTIONS`` for ``seconds`` at ``rate`` Hz; the same seed gives the same bits.

    Raises UsageError for an unknown motion, unless 1 <= seconds <= 600, 30 <= rate <= 500 and the seed is a whole
    number of at least 0.
    """
    if motion not in MOTIONS:
        raise UsageError(f"The motion must be one of {', '.join(MOTIONS)}. Got {motion}.")
    require_between("The length in seconds", seconds, 1.0, 600.0)
    require_between("The rate in Hz", rate, 30.0, 500.0)
    require_whole("The seed", seed, 0)
    rng = np.random.default_rng(seed)
    root, angles = MOTIONS[motion](round(seconds * rate), rate, rng)
    bvh, poses = bvh_skeleton(), bvh_poses(root, angles)
    # From the figure's axes (left, up, forward) to forward, left, up
    positions = marker_positions(bvh, poses, rate, rng)[..., [2, 0, 1]]
    markers = Take(
        positions=positions,
        trusted=np.ones(positions.shape[:2], dtype=bool),
        markers=tuple(MARKERS),
        rate=float(rate),
    )
    return Performance(
        name=motion,
        rate=float(rate),
        markers=markers,
        bvh=bvh,
        bvh_poses=poses,
        asf=asf_skeleton(),
        asf_poses=asf_poses(root, angles),
    )
