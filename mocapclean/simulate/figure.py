"""The skeleton of an adult figure, as a BVH hierarchy and as an ASF skeleton of the same bones.

Axes: x to the figure's left, y up, z forward; millimetres. The rest pose is upright with hanging arms.

Lengths are the fractions of stature of R. Drillis and R. Contini, "Body segment parameters", New York University
Report 1166-03 (1966), as drawn in D. A. Winter, "Biomechanics and Motor Control of Human Movement", 4th ed. (2009),
fig. 4.1, doi:10.1002/9780470549148: thigh 0.245, shank 0.246, ankle height 0.039, foot 0.152, upper arm 0.186,
forearm 0.146, hand 0.108, hip height 0.530, shoulder height 0.818, chin 0.870, half the shoulder breadth 0.129. The
parts of the spine, the clavicle, the division of the foot, and the distance between the hip joints (0.100) are chosen
by hand.

An ASF skeleton has the position of each bone's far end, a BVH hierarchy that of the joint about which the bone turns.
So the joint of a bone is at the end of its parent: ``LeftLeg``, the knee, is the joint of ``ltibia`` and the end of
``lfemur``. ``BODY`` has both names of every bone.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.geometry.skeleton import Channel, Skeleton, turn

STATURE = 1750.0  # mm, chosen by hand
ROOT_HEIGHT = 0.550 * STATURE  # mm, of the root above the floor at rest: hip height 0.530, and 0.020 to the root

Vector = tuple[float, float, float]


class Segment(NamedTuple):
    """A bone of the figure.

    bone: its ASF name. joint: its BVH joint; None for a bone that does not turn. parent: the ASF name of its parent.
    vector: from its joint to its end at rest, in statures. freedoms: the axes about which it turns, "xyz" or fewer.
    tilt: degrees, the rotation of these axes about z. end: the BVH end site of a bone without children.
    """

    bone: str
    joint: str | None
    parent: str
    vector: Vector
    freedoms: str = "xyz"
    tilt: float = 0.0
    end: str | None = None


def _leg(side: str, prefix: str, left: float) -> tuple[Segment, ...]:
    """Return the bones of a leg; ``left`` is 1 for the left side and -1 for the right."""
    return (
        Segment(f"{side}hipjoint", None, "root", (0.050 * left, -0.020, 0.0), ""),
        Segment(f"{side}femur", f"{prefix}UpLeg", f"{side}hipjoint", (0.0, -0.245, 0.0), tilt=5 * left),
        Segment(f"{side}tibia", f"{prefix}Leg", f"{side}femur", (0.0, -0.246, 0.0), "x"),
        Segment(f"{side}foot", f"{prefix}Foot", f"{side}tibia", (0.003 * left, -0.028, 0.073)),
        Segment(f"{side}toes", f"{prefix}ToeBase", f"{side}foot", (0.0, -0.004, 0.041), "x", end=f"{prefix}ToeEnd"),
    )


def _arm(side: str, prefix: str, left: float) -> tuple[Segment, ...]:
    """Return the bones of an arm; ``left`` is 1 for the left side and -1 for the right."""
    tilt = 10 * left
    return (
        Segment(f"{side}clavicle", f"{prefix}Shoulder", "thorax", (0.129 * left, -0.004, -0.004), "yz"),
        Segment(f"{side}humerus", f"{prefix}Arm", f"{side}clavicle", (0.0, -0.186, 0.0), tilt=tilt),
        Segment(f"{side}radius", f"{prefix}ForeArm", f"{side}humerus", (0.0, -0.146, 0.0), "x", tilt),
        Segment(f"{side}hand", f"{prefix}Hand", f"{side}radius", (0.0, -0.108, 0.0), tilt=tilt, end=f"{prefix}HandEnd"),
    )


BODY: tuple[Segment, ...] = (
    *_leg("l", "Left", 1.0),
    *_leg("r", "Right", -1.0),
    Segment("sacrum", None, "root", (0.0, 0.030, -0.022), ""),
    Segment("lowerback", "Spine", "sacrum", (0.0, 0.060, 0.004)),
    Segment("upperback", "Spine1", "lowerback", (0.0, 0.080, -0.004)),
    Segment("thorax", "Spine2", "upperback", (0.0, 0.102, 0.004)),
    Segment("neck", "Neck", "thorax", (0.0, 0.048, 0.010)),
    Segment("head", "Head", "neck", (0.0, 0.130, 0.008), end="HeadEnd"),
    *_arm("l", "Left", 1.0),
    *_arm("r", "Right", -1.0),
)
"""All bones but the root, parents first."""


def asf_skeleton() -> Skeleton:
    """Return the figure as an ASF skeleton: 25 bones, ``after`` vectors, tilted axes, R = Rz Ry Rx."""
    names = ("root", *(s.bone for s in BODY))
    channels = [Channel(joint=0, axis=axis, is_rotation=moves) for moves in (False, True) for axis in range(3)]
    product = [5, 4, 3]
    for joint, segment in enumerate(BODY, start=1):
        first = len(channels)
        channels += [Channel(joint=joint, axis="xyz".index(a), is_rotation=True) for a in segment.freedoms]
        product += range(len(channels) - 1, first - 1, -1)
    return Skeleton(
        names=names,
        parents=(-1, *(names.index(s.parent) for s in BODY)),
        before=np.zeros((len(names), 3)),
        after=np.array([(0.0, 0.0, 0.0), *(s.vector for s in BODY)]) * STATURE,
        frames=turn(2, np.array([0.0, *(s.tilt for s in BODY)])),
        channels=tuple(channels),
        product=tuple(product),
    )


def bvh_skeleton() -> Skeleton:
    """Return the figure as a BVH hierarchy: 22 joints with R = Rz Ry Rx, and 5 end sites without channels."""
    # For each bone the BVH joint that carries its end, and the offset of the end from that joint at rest
    place = {"root": ("Hips", np.zeros(3))}
    names, parents, before = ["Hips"], [-1], [np.zeros(3)]
    for segment in BODY:
        joint, offset = place[segment.parent]
        if segment.joint is not None:
            parents.append(names.index(joint))
            names.append(segment.joint)
            before.append(offset)
            joint, offset = segment.joint, np.zeros(3)
        place[segment.bone] = (joint, offset + STATURE * np.array(segment.vector))
        if segment.end is not None:
            parents.append(names.index(joint))
            names.append(segment.end)
            before.append(place[segment.bone][1])
    ends = {s.end for s in BODY}
    channels = [Channel(joint=0, axis=axis, is_rotation=False) for axis in range(3)]
    channels += [
        Channel(joint=joint, axis=axis, is_rotation=True)
        for joint, name in enumerate(names)
        if name not in ends
        for axis in (2, 1, 0)
    ]
    return Skeleton(
        names=tuple(names),
        parents=tuple(parents),
        before=np.array(before),
        after=np.zeros((len(names), 3)),
        frames=np.tile(np.eye(3), (len(names), 1, 1)),
        channels=tuple(channels),
        product=tuple(range(3, len(channels))),
    )


def rotation(angles: Floats) -> Floats:
    """Return Rz Ry Rx (F, 3, 3) of angles (F, 3) about x, y and z in degrees."""
    return turn(2, angles[:, 2]) @ turn(1, angles[:, 1]) @ turn(0, angles[:, 0])


def angles_of(rotations: Floats) -> Floats:
    """Return the angles (F, 3) in degrees of rotations Rz Ry Rx (F, 3, 3) about x, y and z, unwrapped over time."""
    x = np.arctan2(rotations[:, 2, 1], rotations[:, 2, 2])
    y = -np.arcsin(np.clip(rotations[:, 2, 0], -1.0, 1.0))
    z = np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0])
    return np.degrees(np.unwrap(np.stack((x, y, z), axis=1), axis=0))


def asf_poses(root: Floats, angles: Mapping[str, Floats]) -> Floats:
    """Return poses (F, C) of ``asf_skeleton`` from the root's position (F, 3) and the angles (F, 3) by bone.

    The angles of the root are those of "root". Angles are degrees about the bone's own axes; bones without angles stay
    at rest.
    """
    columns = [root, angles["root"]]
    rest = np.zeros_like(root)
    columns += [angles.get(s.bone, rest)[:, ["xyz".index(a) for a in s.freedoms]] for s in BODY if s.freedoms]
    return np.concatenate(columns, axis=1)


def bvh_poses(root: Floats, angles: Mapping[str, Floats]) -> Floats:
    """Return poses (F, C) of ``bvh_skeleton`` with the joint positions of ``asf_poses`` of the same arguments."""
    columns = [root, angles["root"][:, ::-1]]
    rest = np.zeros_like(root)
    for segment in BODY:
        if segment.joint is None:
            continue
        # The rotation about tilted axes, in the axes of the world
        free = [axis in segment.freedoms for axis in "xyz"]
        axes = turn(2, np.array(segment.tilt))
        local = axes @ rotation(angles.get(segment.bone, rest) * free) @ axes.T
        columns.append(angles_of(local)[:, ::-1])
    return np.concatenate(columns, axis=1)
