"""Legs that reach for feet: a foot rolls over heel or ball, and hip, knee and ankle follow in closed form.

``side`` is "l" or "r"; angles are degrees and lengths millimetres, in the figure's axes (y up, z forward).
"""

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.geometry.skeleton import turn
from mocapclean.simulate.figure import BODY, STATURE, Vector, angles_of

ANKLE_HEIGHT = 0.039 * STATURE
HEEL: Vector = (0.0, -ANKLE_HEIGHT, -45.0)
"""Where the heel meets the floor, from the ankle."""

_SOFT = 0.006
_REST = {s.bone: STATURE * np.array(s.vector) for s in BODY}
_TILT = {s.bone: s.tilt for s in BODY}


def ease(time: Floats, start: float, stop: float) -> Floats:
    """From 0 before ``start`` to 1 after ``stop`` with least jerk.

    T. Flash and N. Hogan, J. Neurosci. 5 (1985) 1688, doi:10.1523/JNEUROSCI.05-07-01688.1985.
    """
    u = np.clip((time - start) / (stop - start), 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def roll(side: str, flat: Floats, yaw: Floats, pitch: Floats) -> tuple[Floats, Floats]:
    """The ankle (F, 3) and rotation (F, 3, 3) of a foot that would have its ankle at ``flat`` (F, 3) if level.

    A positive pitch lifts the heel about the ball, a negative one lifts the toes about the heel.
    """
    heading = turn(1, yaw)
    rotation = heading @ turn(0, pitch)
    pivot = np.where(pitch[:, None] > 0, _REST[f"{side}foot"], np.array(HEEL))
    ankle = flat + np.einsum("fij,fj->fi", heading - rotation, pivot)
    return ankle, rotation


def reach(side: str, root: Floats, pelvis: Floats, ankle: Floats, foot: Floats, yaw: Floats) -> dict[str, Floats]:
    """Angles (F, 3) of femur, tibia and foot that put the ankle and the foot's rotation where they shall be.

    root and ankle: (F, 3); pelvis and foot: rotations (F, 3, 3); yaw: (F,), where the knee points. No knee
    locks: a leg that would be straight keeps some 6 degrees of bend and stays a few millimetres short of the ankle.
    """
    thigh, shank = (-_REST[side + bone][1] for bone in ("femur", "tibia"))
    way = np.einsum("fji,fj->fi", pelvis, ankle - root) - _REST[f"{side}hipjoint"]
    length = np.linalg.norm(way, axis=1)
    cosine = (length**2 - thigh**2 - shank**2) / (2 * thigh * shank)
    straight = 1.0 - cosine
    soft = (straight + np.sqrt(straight**2 + 4 * _SOFT**2)) / 2
    knee = np.degrees(np.arccos(np.clip(1.0 - soft, -1.0, 1.0)))
    bent = turn(0, knee)
    rest = _frame(np.array([0.0, -thigh, 0.0]) - shank * bent[:, :, 1], np.eye(3)[[0]])
    lateral = np.einsum("fji,fj->fi", pelvis, turn(1, yaw)[:, :, 0])
    femur = _frame(way, lateral) @ rest.swapaxes(1, 2)
    axes = turn(2, np.array(_TILT[f"{side}femur"]))
    bend = np.zeros_like(root)
    bend[:, 0] = knee
    return {
        f"{side}femur": angles_of(axes.T @ femur @ axes),
        f"{side}tibia": bend,
        f"{side}foot": angles_of((pelvis @ femur @ bent).swapaxes(1, 2) @ foot),
    }


def _frame(along: Floats, aside: Floats) -> Floats:
    """Rotations (F, 3, 3) with the first column along, the second as near to aside as can be."""
    first = along / np.linalg.norm(along, axis=1, keepdims=True)
    second = aside - first * np.sum(first * aside, axis=1, keepdims=True)
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack((first, second, np.cross(first, second)), axis=2)
