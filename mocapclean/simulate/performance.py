"""A performance: one motion of the figure as markers, and as poses of its BVH and of its ASF skeleton."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.simulate.bounds import whole, within
from mocapclean.simulate.boxing import box
from mocapclean.simulate.figure import asf_poses, asf_skeleton, bvh_poses, bvh_skeleton
from mocapclean.simulate.markers import MARKERS, wear
from mocapclean.simulate.walking import walk
from mocapclean.take import Take

MOTIONS: dict[str, Callable[[int, float, np.random.Generator], tuple[Floats, dict[str, Floats]]]] = {
    "walk": walk,
    "boxing": box,
}
"""Motions by name: (n_frames, rate, rng) to root places (F, 3) and bone angles (F, 3)."""


@dataclass(frozen=True, kw_only=True)
class Performance:
    """A motion of the figure, without a gap.

    markers: 41 markers in millimetres, z up, x where the figure faces at rest, y to its left (as C3D files usually
    are). bvh, bvh_poses and asf, asf_poses: the same bones (F, C), degrees and millimetres, y up, z forward, x to
    the left (as BVH and AMC files usually are); their joints agree as ``mocapclean.simulate.figure.BODY`` pairs them.
    """

    name: str
    rate: float
    markers: Take
    bvh: Skeleton
    bvh_poses: Floats
    asf: Skeleton
    asf_poses: Floats


def perform(motion: str, seconds: float = 10.0, rate: float = 120.0, seed: int = 0) -> Performance:
    """Perform one of ``MOTIONS`` for ``seconds`` at ``rate`` Hz; the same seed gives the same bits.

    Raises UsageError for an unknown motion, unless 1 <= seconds <= 600, 30 <= rate <= 500 and the seed is a whole
    number of at least 0.
    """
    if motion not in MOTIONS:
        raise UsageError(f"The motion must be one of {', '.join(MOTIONS)}. Got {motion}.")
    within("The length in seconds", seconds, 1.0, 600.0)
    within("The rate in Hz", rate, 30.0, 500.0)
    whole("The seed", seed, 0)
    rng = np.random.default_rng(seed)
    root, angles = MOTIONS[motion](round(seconds * rate), rate, rng)
    bvh, poses = bvh_skeleton(), bvh_poses(root, angles)
    positions = wear(bvh, poses, rate, rng)[..., [2, 0, 1]]
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
