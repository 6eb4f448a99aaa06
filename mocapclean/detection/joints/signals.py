"""The channels of joints as paths in four dimensions: unit quaternions of rotations, millimetres of translations.

Unit quaternions are points on the sphere of radius 1, and turning the world or a joint's own axes turns that sphere. A
distance of d between two of them is a rotation by 4 asin(d / 2) radians. Straight lines and parabolas through a few
frames leave the sphere by less than a fault that matters. All results are therefore the same for every order of Euler
angles.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.joint_motion import JointMotion
from mocapclean.geometry.skeleton import Skeleton

Part = Literal["rotation", "translation"]

DEGREES = float(np.degrees(2.0))
"""Degrees of rotation per unit of a small distance between unit quaternions, which is half the angle in radians."""
_LEAST_SHARE = 0.001
"""Millimetres of translation that count as one degree, as a share of the skeleton's reach: a tenth of what a turn by
one degree moves at the end of a limb as long as half of the body. Chosen by hand."""
_STEPS_OF_SPELLING = 3.0
"""Least steps of a signal that count as one degree: a coarsely spelled file steps by one or two. Chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class Signals:
    """The paths of S signals in F frames.

    paths: (F, S, 4), in units that each count as one degree. known: (F, S). joints: (S,) joint of each signal. part:
    what they are. unit: (S,) millimetres per unit for translations, 1 for rotations.
    """

    paths: Floats
    known: Bools
    joints: Ints
    part: Part
    unit: Floats

    def measure(self, signal: int, distance: float) -> str:
        """Return a distance of a signal in words: degrees or mm."""
        if self.part == "translation":
            return f"{distance * float(self.unit[signal]):.0f} mm"
        # The chord of the sphere of quaternions as an angle.
        angle = 2.0 * DEGREES * np.arcsin(min(distance / (2.0 * DEGREES), 1.0))
        return f"{angle:.1f} degrees"


def rotation_signals(motion: JointMotion) -> Signals:
    """Return the rotations of all joints that turn at any time."""
    joints = np.flatnonzero(motion.turns & (motion.rotations != motion.rotations[:1]).any(axis=(0, 2)))
    return Signals(
        paths=motion.rotations[:, joints] * DEGREES,
        known=motion.rotation_known[:, joints],
        joints=joints,
        part="rotation",
        unit=np.ones(len(joints)),
    )


def translation_signals(skeleton: Skeleton, motion: JointMotion) -> Signals:
    """Return the translations of all joints that shift at any time."""
    joints = np.flatnonzero(motion.shifts & (motion.translations != motion.translations[:1]).any(axis=(0, 2)))
    paths = np.zeros((len(motion.translations), len(joints), 4))
    paths[..., :3] = motion.translations[:, joints]
    unit = np.maximum(_LEAST_SHARE * _reach(skeleton, motion), _STEPS_OF_SPELLING * _least_steps(paths))
    unit = np.where(unit > 0, unit, 1.0)
    return Signals(
        paths=paths / unit[:, None],
        known=motion.translation_known[:, joints],
        joints=joints,
        part="translation",
        unit=unit,
    )


def _reach(skeleton: Skeleton, motion: JointMotion) -> float:
    """Return the length (mm) of the longest chain of bones from a root, or the extent of the motion without bones."""
    reach = np.zeros(len(skeleton.names))
    middle = motion.translations[len(motion.translations) // 2]
    for joint, parent in enumerate(skeleton.parents):
        after = float(np.linalg.norm(skeleton.after[joint]))
        if parent >= 0:
            before = float(np.linalg.norm(skeleton.before[joint] + middle[joint]))
            reach[joint] = reach[parent] + before
        reach[joint] += after
    longest = float(reach.max(initial=0.0))
    return longest if longest > 0 else float(np.ptp(motion.translations, axis=0).max(initial=0.0))


def _least_steps(paths: Floats) -> Floats:
    """Return the least change (S,) of any coordinate of paths (F, S, 4) from one frame to the next, 0 without any."""
    change = np.abs(np.diff(paths, axis=0))
    least = np.where(change > 0, change, np.inf).min(axis=(0, 2), initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)
