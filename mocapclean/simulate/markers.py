"""The marker set: 41 markers on the figure's skin, with soft tissue between them and the bones.

Names and places follow the full-body set of the CMU Graphics Lab (the Vicon 512 set). As there, the markers of the
thighs, shanks and upper arms sit at other heights on the right than on the left, so that the sides can be told apart.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mocapclean.arrays import Floats
from mocapclean.geometry.skeleton import Skeleton, forward
from mocapclean.simulate.figure import Vector

NOISE = 0.15
"""Standard deviation in millimetres of the measurement noise of each coordinate."""

_PERSON = 1966


class Tissue(NamedTuple):
    """What lies between skin and bone: millimetres per radian of the joints near by, hertz, millimetres."""

    stretch: float
    wobble: float
    creep: float


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


class Place(NamedTuple):
    """Where a marker sits: its BVH joint, its offset in millimetres at rest from that joint, its tissue."""

    joint: str
    offset: Vector
    tissue: Tissue


_MIDDLE = {
    "C7": Place("Spine2", (0.0, 190.0, -70.0), TRUNK),
    "T10": Place("Spine2", (0.0, -10.0, -110.0), TRUNK),
    "CLAV": Place("Spine2", (0.0, 140.0, 75.0), TRUNK),
    "STRN": Place("Spine2", (0.0, 10.0, 100.0), TRUNK),
    "RBAC": Place("Spine2", (-85.0, 85.0, -115.0), TRUNK),
}
_PAIRS = {
    "FHD": Place("Head", (76.0, 130.0, 90.0), HEAD),
    "BHD": Place("Head", (52.0, 118.0, -80.0), HEAD),
    "SHO": Place("Shoulder", (200.0, 45.0, -5.0), SHOULDER),
    "UPA": Place("Arm", (62.0, -150.0, 10.0), UPPER_ARM),
    "ELB": Place("Arm", (48.0, -320.0, -12.0), UPPER_ARM),
    "FRM": Place("ForeArm", (42.0, -120.0, 18.0), FOREARM),
    "WRA": Place("ForeArm", (12.0, -250.0, 62.0), FOREARM),
    "WRB": Place("ForeArm", (12.0, -250.0, -58.0), FOREARM),
    "FIN": Place("Hand", (20.0, -82.0, 14.0), HAND),
    "FWT": Place("Hips", (125.0, 20.0, 95.0), WAIST),
    "BWT": Place("Hips", (50.0, 40.0, -100.0), WAIST),
    "THI": Place("UpLeg", (86.0, -230.0, 20.0), THIGH),
    "KNE": Place("UpLeg", (60.0, -425.0, 0.0), KNEE),
    "SHN": Place("Leg", (58.0, -210.0, 12.0), SHANK),
    "ANK": Place("Leg", (48.0, -424.0, -6.0), FOOT),
    "HEE": Place("Foot", (0.0, -22.0, -68.0), FOOT),
    "TOE": Place("Foot", (2.0, -30.0, 134.0), FOOT),
    "MT5": Place("Foot", (46.0, -38.0, 100.0), FOOT),
}
_RAISED = {"THI": 60.0, "SHN": 55.0, "UPA": -45.0}
_CENTRAL = ("Head", "Hips")


def _sided(name: str, place: Place, left: bool) -> tuple[str, Place]:
    x, y, z = place.offset
    word = "" if place.joint in _CENTRAL else "Left" if left else "Right"
    offset = (x, y, z) if left else (-x, y + _RAISED.get(name, 0.0), z)
    return f"{'L' if left else 'R'}{name}", Place(word + place.joint, offset, place.tissue)


MARKERS: dict[str, Place] = dict(
    [_sided(name, place, left) for name, place in _PAIRS.items() for left in (True, False)], **_MIDDLE
)
"""The 41 markers by name."""


def wander(rng: np.random.Generator, n_frames: int, rate: float, cutoff: float, n_columns: int = 1) -> Floats:
    """Smooth noise (F, n_columns) of unit variance whose spectrum falls as a Gaussian past ``cutoff`` Hz."""
    sigma = rate / (2 * np.pi * cutoff)
    margin = int(4 * sigma) + 1
    white = rng.standard_normal((n_frames + 2 * margin, n_columns))
    smooth = gaussian_filter1d(white, sigma, axis=0)[margin:-margin]
    return np.asarray(smooth * np.sqrt(2 * np.sqrt(np.pi) * sigma))


def wear(skeleton: Skeleton, poses: Floats, rate: float, rng: np.random.Generator) -> Floats:
    """Marker positions (F, 41, 3) on the BVH figure in millimetres, in the figure's axes (y up).

    Skin moves over bone in three ways: it is stretched by the joints at both ends of the segment, as a fixed
    function of their angles, the same for every performance because the person is the same (after T. Bonci,
    V. Camomilla, R. Dumas, L. Chèze and A. Cappozzo, J. Biomech. 47 (2014) 2354, doi:10.1016/j.jbiomech.2014.04.029);
    it lags behind accelerations as a mass on a stiff spring; and it creeps at random. Then the cameras' noise is
    added, ``NOISE`` millimetres in each coordinate.
    """
    places, rotations = forward(skeleton, poses)
    person = np.random.default_rng(_PERSON)
    columns = []
    for place in MARKERS.values():
        joint = skeleton.names.index(place.joint)
        skin = place.offset + _stretch(skeleton, poses, joint, place.tissue, person)
        skin += place.tissue.creep * wander(rng, len(poses), rate, 0.4, 3)
        point = places[:, joint] + np.einsum("fij,fj->fi", rotations[:, joint], skin)
        columns.append(point - _lag(point, rate, place.tissue.wobble))
    markers = np.stack(columns, axis=1)
    return np.asarray(markers + NOISE * rng.standard_normal(markers.shape))


def _stretch(skeleton: Skeleton, poses: Floats, joint: int, tissue: Tissue, person: np.random.Generator) -> Floats:
    near = [
        index
        for index, channel in enumerate(skeleton.channels)
        if channel.is_rotation
        and joint in (channel.joint, skeleton.parents[channel.joint])
        and skeleton.parents[channel.joint] >= 0
    ]
    angles = np.radians(poses[:, near])
    features = np.concatenate((np.sin(angles), 1.0 - np.cos(angles)), axis=1)
    pull = person.standard_normal((features.shape[1], 3)) * tissue.stretch / np.sqrt(6)
    return np.asarray(features @ pull)


def _lag(point: Floats, rate: float, wobble: float) -> Floats:
    omega = 2 * np.pi * wobble
    acceleration = np.gradient(np.gradient(point, axis=0), axis=0) * rate**2
    return np.asarray(gaussian_filter1d(acceleration, rate / omega, axis=0) / omega**2)
