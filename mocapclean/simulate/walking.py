"""Walking: a pelvis that sways over feet that roll, and arms and trunk that swing against them."""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mocapclean.arrays import Floats
from mocapclean.simulate.figure import ROOT_HEIGHT, rotation
from mocapclean.simulate.legs import ANKLE_HEIGHT, ease, reach, roll
from mocapclean.simulate.markers import wander

SPEED = 1280.0
"""Mean speed in millimetres per second."""

CADENCE = 1.84
"""Mean steps per second."""

_UNDER_HIP = 0.20
_TOE_OFF = 0.61


def walk(n_frames: int, rate: float, rng: np.random.Generator) -> tuple[Floats, dict[str, Floats]]:
    """Root places (F, 3) in millimetres and bone angles (F, 3) in degrees of level walking along z.

    The timing of heel strike, foot flat, heel rise and toe off and the sway of the pelvis are those of normal gait
    (D. A. Winter, "The Biomechanics and Motor Control of Human Gait", 2nd ed., 1991); hips, knees and ankles follow
    from them. Cadence, stride, amplitudes and posture wander slowly about their means: no two strides are equal.
    """
    margin = int(3 * rate / CADENCE) + 1
    n = n_frames + 2 * margin
    tempo = 1.0 + 0.02 * wander(rng, n, rate, 0.25)[:, 0]
    phase = rng.random() + np.cumsum(tempo) * CADENCE / 2 / rate
    turn = 2 * np.pi * phase
    scale = 1.0 + 0.05 * wander(rng, n, rate, 0.25, 3)
    posture = wander(rng, n, rate, 0.3, 12) + 0.2 * wander(rng, n, rate, 2.0, 12)
    speed = SPEED * tempo * (1 + 0.02 * posture[:, 0] + 0.08 * np.cos(2 * turn - 0.3))
    root = _columns(
        18 * np.sin(turn - 0.3) + 6 * posture[:, 1],
        ROOT_HEIGHT - 40 - 20 * np.cos(2 * turn - 0.1) + posture[:, 2],
        np.cumsum(speed) / rate,
    )
    pelvis = _columns(4 + np.cos(2 * turn), -5 * np.cos(turn), 4 * np.sin(turn + 0.5)) + 0.5 * posture[:, 3:6]
    pelvis *= scale[:, :1]
    back = (_columns(-2 - 1.5 * np.cos(2 * turn - 0.8), 6 * np.cos(turn - 0.1), 0) - pelvis + posture[:, 6:9]) / 3
    gaze = (1.5 * posture[:, 9:] - pelvis - 3 * back) / 2
    angles = {"root": pelvis, "lowerback": back, "upperback": back, "thorax": back, "neck": gaze, "head": gaze}
    for side, ahead, swing in (("l", 0.0, scale[:, 1]), ("r", 0.5, scale[:, 2])):
        angles |= _leg(side, phase + ahead, root, pelvis, rate, rng) | _arm(side, phase + ahead, swing)
    kept = slice(margin, margin + n_frames)
    start = [0.0, 0.0, root[margin, 2]]
    return root[kept] - start, {bone: column[kept] for bone, column in angles.items()}


def _columns(*parts: Floats | float) -> Floats:
    return np.stack(np.broadcast_arrays(*parts), axis=-1).astype(float)


def _leg(
    side: str, phase: Floats, root: Floats, pelvis: Floats, rate: float, rng: np.random.Generator
) -> dict[str, Floats]:
    """A foot that strikes at each whole number of ``phase``, stays, rolls and swings to its next place."""
    left = 1.0 if side == "l" else -1.0
    stride = np.floor(phase).astype(int)
    part = phase - stride
    counts = np.arange(stride[0], stride[-1] + 2)
    steps = _columns(
        60 * left + rng.normal(0.0, 6.0, len(counts)),
        ANKLE_HEIGHT,
        np.interp(counts + _UNDER_HIP, phase, root[:, 2]) + rng.normal(0.0, 6.0, len(counts)),
    )
    here, ahead = steps[stride - counts[0]], steps[stride - counts[0] + 1]
    pitch = 56 * (ease(part, 0.33, _TOE_OFF + 0.02) - ease(part, _TOE_OFF, 0.88))
    pitch -= 19 * (1 - ease(part, 0.0, 0.09) + ease(part, 0.80, 0.98))
    swung = np.clip((part - _TOE_OFF + 0.05) / (1.0 - _TOE_OFF + 0.04), 0.0, 1.0)
    swung = swung**2 * (3 - 2 * swung)
    flat = here + swung[:, None] * (ahead - here)
    flat[:, 1] += 30 * np.sin(np.pi * swung) ** 2
    smooth = 0.016 * rate
    yaw = np.full(len(phase), 6.0 * left)
    pitch = gaussian_filter1d(pitch, smooth)
    ankle, foot = roll(side, flat, yaw, pitch)
    ankle = gaussian_filter1d(ankle, smooth, axis=0)
    toes = -np.maximum(pitch, 0.0) * (1 - ease(part, _TOE_OFF, 0.88)) - 5 * ease(part, 0.6, 0.8)
    bend = _columns(gaussian_filter1d(toes, smooth), 0, 0)
    return reach(side, root, rotation(pelvis), ankle, foot, yaw) | {f"{side}toes": bend}


def _arm(side: str, phase: Floats, scale: Floats) -> dict[str, Floats]:
    left = 1.0 if side == "l" else -1.0
    swing, late = (scale * _swing(phase - delay) for delay in (0.02, 0.07))
    return {
        f"{side}clavicle": _columns(0, 2 * swing * left, (1.5 + 0.8 * swing) * left),
        f"{side}humerus": _columns(-3 - 18 * swing, -8 * left, (6 - 1.5 * swing) * left),
        f"{side}radius": _columns(-26 - 11 * late, 0, 0),
        f"{side}hand": _columns(-6 - 3 * late, -12 * left, 0),
    }


def _swing(phase: Floats) -> Floats:
    """From 1, ahead, to -1 and back, a little faster forwards than backwards."""
    turn = 2 * np.pi * phase
    return np.asarray(-np.cos(turn) - 0.08 * np.sin(2 * turn + 0.4) - 0.03 * np.cos(3 * turn))
