"""Legs of the figure: rolling feet, and the angles of hip, knee and ankle that reach them, in closed form.

``side`` is "l" or "r"; angles are degrees and lengths millimetres, in the figure's axes (y up, z forward).
"""

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.geometry.skeleton import turn
from mocapclean.simulate.figure import BODY, STATURE, Vector, angles_of

ANKLE_HEIGHT = 0.039 * STATURE
"""Millimetres from the floor to the ankle, after Drillis and Contini."""

HEEL: Vector = (0.0, -ANKLE_HEIGHT, -45.0)
"""Millimetres from the ankle to the point where the heel meets the floor; the depth is chosen by hand."""

# Smoothness of the limit of knee extension, in units of 1 − cos(knee angle): a leg that would be straight has 1 − cos
# of 0.006, a bend of some 6 degrees. Chosen by hand.
_EXTENSION_SMOOTHNESS = 0.006
_REST = {s.bone: STATURE * np.array(s.vector) for s in BODY}
_TILT = {s.bone: s.tilt for s in BODY}


def minimum_jerk(time: Floats, start: float, stop: float) -> Floats:
    """Return the minimum-jerk transition (F,) from 0 before ``start`` to 1 after ``stop``.

    T. Flash, N. Hogan, 1985, doi:10.1523/JNEUROSCI.05-07-01688.1985.
    """
    u = np.clip((time - start) / (stop - start), 0.0, 1.0)
    return np.asarray(u**3 * (10 - 15 * u + 6 * u**2))


def rolling_foot(side: str, level_ankle: Floats, yaw: Floats, pitch: Floats) -> tuple[Floats, Floats]:
    """Return the ankle (F, 3) and the rotation (F, 3, 3) of a foot that rolls over the ball or the heel.

    level_ankle: (F, 3), the ankle of the foot if its pitch were 0. A positive pitch (F,) lifts the heel about the ball,
    a negative one the toes about the heel.
    """
    heading = turn(1, yaw)
    rotation = heading @ turn(0, pitch)
    # The pivot stays where it is with a level foot.
    pivot = np.where(pitch[:, None] > 0, _REST[f"{side}foot"], np.array(HEEL))
    ankle = level_ankle + np.einsum("fij,fj->fi", heading - rotation, pivot)
    return ankle, rotation


def leg_angles(side: str, root: Floats, pelvis: Floats, ankle: Floats, foot: Floats, yaw: Floats) -> dict[str, Floats]:
    """Return the angles (F, 3) of femur, tibia and foot for a given ankle and rotation of the foot.

    root, ankle: (F, 3). pelvis, foot: rotations (F, 3, 3). yaw: (F,), the heading of the knee. The knee does not lock:
    a leg that would be straight keeps a bend of some 6 degrees, and its ankle is a few millimetres short.
    """
    # The knee's bend from the law of cosines, with a smooth lower limit
    thigh, shank = (-_REST[side + bone][1] for bone in ("femur", "tibia"))
    hip_to_ankle = np.einsum("fji,fj->fi", pelvis, ankle - root) - _REST[f"{side}hipjoint"]
    length = np.linalg.norm(hip_to_ankle, axis=1)
    cosine = (length**2 - thigh**2 - shank**2) / (2 * thigh * shank)
    extension = 1.0 - cosine
    limited = (extension + np.sqrt(extension**2 + 4 * _EXTENSION_SMOOTHNESS**2)) / 2
    knee = np.degrees(np.arccos(np.clip(1.0 - limited, -1.0, 1.0)))
    # The hip turns the line from hip to ankle of the bent leg onto the wanted one, and the knee to its heading.
    bent = turn(0, knee)
    rest = _frames(np.array([0.0, -thigh, 0.0]) - shank * bent[:, :, 1], np.eye(3)[[0]])
    lateral = np.einsum("fji,fj->fi", pelvis, turn(1, yaw)[:, :, 0])
    femur = _frames(hip_to_ankle, lateral) @ rest.swapaxes(1, 2)
    axes = turn(2, np.array(_TILT[f"{side}femur"]))
    bend = np.zeros_like(root)
    bend[:, 0] = knee
    return {
        f"{side}femur": angles_of(axes.T @ femur @ axes),
        f"{side}tibia": bend,
        f"{side}foot": angles_of((pelvis @ femur @ bent).swapaxes(1, 2) @ foot),
    }


def _frames(first: Floats, second: Floats) -> Floats:
    """Return rotations (F, 3, 3) with the first column along ``first``, and the second nearest to ``second``."""
    x = first / np.linalg.norm(first, axis=1, keepdims=True)
    y = second - x * np.sum(x * second, axis=1, keepdims=True)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack((x, y, np.cross(x, y)), axis=2)
