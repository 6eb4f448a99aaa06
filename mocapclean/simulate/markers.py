"""The marker set of the figure: 41 markers on the skin, with soft tissue between them and the bones.

Names and places follow the full-body set of the CMU Graphics Lab (the Vicon 512 set). As in that set, the markers of
thighs, shanks and upper arms have different heights on the right and on the left, which distinguishes the sides.
"""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.geometry.skeleton import Skeleton, forward
from mocapclean.numerics.gaussian import smoothed
from mocapclean.simulate.figure import Vector

NOISE = 0.15
"""Standard deviation in millimetres of the measurement noise of each coordinate."""

_PERSON_SEED = 1966  # of the figure's soft tissue, the same in all motions


class Tissue(NamedTuple):
    """The soft tissue between a marker and its bone.

    stretch: mm, skin displacement per radian of the joints at both ends of the segment. wobble: Hz, natural frequency
    of the mass on a spring that lags behind accelerations. creep: mm, SD of a slow random displacement.
    """

    stretch: float
    wobble: float
    creep: float


# Chosen by hand, so that distances of markers on one segment vary as in real takes (tests/simulate has the ranges).
HEAD = Tissue(6.0, 25.0, 0.7)
TRUNK = Tissue(26.0, 14.0, 1.4)
WAIST = Tissue(14.0, 13.0, 1.4)
SHOULDER = Tissue(16.0, 14.0, 1.2)
UPPER_ARM = Tissue(6.0, 16.0, 1.0)
FOREARM = Tissue(4.0, 22.0, 0.7)
HAND = Tissue(3.0, 30.0, 0.8)
THIGH = Tissue(12.0, 10.0, 1.5)
KNEE = Tissue(7.0, 14.0, 0.8)
SHANK = Tissue(5.0, 16.0, 0.8)
FOOT = Tissue(7.0, 25.0, 0.9)


# Hz, cutoff of the creep's spectrum; chosen by hand.
_CREEP_CUTOFF = 0.4


class Attachment(NamedTuple):
    """The place of a marker: its BVH joint, its offset in millimetres from that joint at rest, and its tissue."""

    joint: str
    offset: Vector
    tissue: Tissue


# Markers of the trunk without a counterpart on the other side; all offsets are chosen by hand.
_UNPAIRED = {
    "C7": Attachment("Spine2", (0.0, 190.0, -70.0), TRUNK),
    "T10": Attachment("Spine2", (0.0, -10.0, -110.0), TRUNK),
    "CLAV": Attachment("Spine2", (0.0, 140.0, 75.0), TRUNK),
    "STRN": Attachment("Spine2", (0.0, 10.0, 100.0), TRUNK),
    "RBAC": Attachment("Spine2", (-85.0, 85.0, -115.0), TRUNK),
}
# Markers of both sides, with the offset on the left.
_PAIRED = {
    "FHD": Attachment("Head", (76.0, 130.0, 90.0), HEAD),
    "BHD": Attachment("Head", (52.0, 118.0, -80.0), HEAD),
    "SHO": Attachment("Shoulder", (200.0, 45.0, -5.0), SHOULDER),
    "UPA": Attachment("Arm", (62.0, -150.0, 10.0), UPPER_ARM),
    "ELB": Attachment("Arm", (48.0, -320.0, -12.0), UPPER_ARM),
    "FRM": Attachment("ForeArm", (42.0, -120.0, 18.0), FOREARM),
    "WRA": Attachment("ForeArm", (12.0, -250.0, 62.0), FOREARM),
    "WRB": Attachment("ForeArm", (12.0, -250.0, -58.0), FOREARM),
    "FIN": Attachment("Hand", (20.0, -82.0, 14.0), HAND),
    "FWT": Attachment("Hips", (125.0, 20.0, 95.0), WAIST),
    "BWT": Attachment("Hips", (50.0, 40.0, -100.0), WAIST),
    "THI": Attachment("UpLeg", (86.0, -230.0, 20.0), THIGH),
    "KNE": Attachment("UpLeg", (60.0, -425.0, 0.0), KNEE),
    "SHN": Attachment("Leg", (58.0, -210.0, 12.0), SHANK),
    "ANK": Attachment("Leg", (48.0, -424.0, -6.0), FOOT),
    "HEE": Attachment("Foot", (0.0, -22.0, -68.0), FOOT),
    "TOE": Attachment("Foot", (2.0, -30.0, 134.0), FOOT),
    "MT5": Attachment("Foot", (46.0, -38.0, 100.0), FOOT),
}
# Millimetres by which the marker of the right side is higher; chosen by hand.
_RAISED_RIGHT = {"THI": 60.0, "SHN": 55.0, "UPA": -45.0}
# Joints in the middle of the body, whose names have no side.
_CENTRAL_JOINTS = ("Head", "Hips")


def _sided(name: str, attachment: Attachment, left: bool) -> tuple[str, Attachment]:
    """Return the name and the attachment of a paired marker on one side."""
    x, y, z = attachment.offset
    prefix = "" if attachment.joint in _CENTRAL_JOINTS else "Left" if left else "Right"
    offset = (x, y, z) if left else (-x, y + _RAISED_RIGHT.get(name, 0.0), z)
    return f"{'L' if left else 'R'}{name}", Attachment(prefix + attachment.joint, offset, attachment.tissue)


MARKERS: dict[str, Attachment] = dict(
    [_sided(name, attachment, left) for name, attachment in _PAIRED.items() for left in (True, False)], **_UNPAIRED
)
"""The 41 markers by name."""


def smooth_noise(rng: np.random.Generator, n_frames: int, rate: float, cutoff: float, n_columns: int = 1) -> Floats:
    """Return random columns (F, n_columns) of unit variance whose spectrum falls as a Gaussian past ``cutoff`` Hz."""
    # White noise under a Gaussian filter of SD rate / (2π cutoff), scaled by the filter's loss of variance
    sigma = rate / (2 * np.pi * cutoff)
    margin = int(4 * sigma) + 1
    white = rng.standard_normal((n_frames + 2 * margin, n_columns))
    smooth = smoothed(white, sigma)[margin:-margin]
    return np.asarray(smooth * np.sqrt(2 * np.sqrt(np.pi) * sigma))


def marker_positions(skeleton: Skeleton, poses: Floats, rate: float, rng: np.random.Generator) -> Floats:
    """Return marker positions (F, 41, 3) on the BVH figure in millimetres, in the figure's axes (y up).

    Skin moves over bone by three effects. The joints at both ends of the segment stretch it, as a fixed function of
    their angles that is the same in all motions: after T. Bonci, V. Camomilla, R. Dumas, L. Chèze, A. Cappozzo, 2014,
    doi:10.1016/j.jbiomech.2014.04.029. It lags behind accelerations as a mass on a stiff spring. It creeps at random.
    Finally the noise of the cameras is added, ``NOISE`` millimetres SD in each coordinate.
    """
    joints, rotations = forward(skeleton, poses)
    person = np.random.default_rng(_PERSON_SEED)
    columns = []
    for attachment in MARKERS.values():
        joint = skeleton.names.index(attachment.joint)
        skin = attachment.offset + _stretch(skeleton, poses, joint, attachment.tissue, person)
        skin += attachment.tissue.creep * smooth_noise(rng, len(poses), rate, _CREEP_CUTOFF, 3)
        point = joints[:, joint] + np.einsum("fij,fj->fi", rotations[:, joint], skin)
        columns.append(point - _lag(point, rate, attachment.tissue.wobble))
    markers = np.stack(columns, axis=1)
    return np.asarray(markers + NOISE * rng.standard_normal(markers.shape))


def _stretch(skeleton: Skeleton, poses: Floats, joint: int, tissue: Tissue, person: np.random.Generator) -> Floats:
    """Return the skin's displacement (F, 3), mm, by the joint and its children, as a random linear function.

    Its arguments are the sines and 1 − cosines of their angles.
    """
    adjacent = [
        index
        for index, channel in enumerate(skeleton.channels)
        if channel.is_rotation
        and joint in (channel.joint, skeleton.parents[channel.joint])
        and skeleton.parents[channel.joint] >= 0
    ]
    angles = np.radians(poses[:, adjacent])
    features = np.concatenate((np.sin(angles), 1.0 - np.cos(angles)), axis=1)
    # √6 for the six angles of two joints with three freedoms each
    coefficients = person.standard_normal((features.shape[1], 3)) * tissue.stretch / np.sqrt(6)
    return np.asarray(features @ coefficients)


def _lag(point: Floats, rate: float, wobble: float) -> Floats:
    """Return the lag (F, 3), mm, of a point behind its acceleration a: a / ω², smoothed over 1 / ω."""
    omega = 2 * np.pi * wobble
    acceleration = np.gradient(np.gradient(point, axis=0), axis=0) * rate**2
    return np.asarray(smoothed(acceleration, rate / omega) / omega**2)
