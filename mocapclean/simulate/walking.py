"""Level walking: rolling feet under a swaying pelvis, with arms and trunk swinging against them.

The timing of heel strike, foot flat, heel rise and toe off, and the sway of the pelvis, are those of normal gait:
D. A. Winter, The Biomechanics and Motor Control of Human Gait, 2nd ed., 1991. Amplitudes and phases without a source
are chosen by hand, so that speeds and excursions of markers are in the ranges of real walking; tests/simulate has
these. Phases of sines and cosines are in radians of the stride, angles in degrees and lengths in millimetres.
"""

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.numerics.gaussian import smoothed
from mocapclean.simulate.figure import ROOT_HEIGHT, rotation
from mocapclean.simulate.legs import ANKLE_HEIGHT, leg_angles, minimum_jerk, rolling_foot
from mocapclean.simulate.markers import smooth_noise

SPEED = 1280.0
"""Mean speed in millimetres per second."""

CADENCE = 1.84
"""Mean steps per second."""

# Events of one foot, as shares of its stride from heel strike to heel strike.
_FOOT_FLAT = 0.09
_MIDSTANCE = 0.20  # the hip is above the ankle, where each step is placed
_HEEL_RISE = 0.33  # the heel leaves the ground
_TOE_OFF = 0.61  # the toes leave the ground
_LEVEL_IN_SWING = 0.88  # the foot is level again after toe off
_TOES_UP = 0.80  # the toes begin to rise for heel strike
_HIGHEST_TOES = 0.98  # the toes are highest above the heel

_PUSH_OFF_PITCH = 56.0  # degrees, of the foot at toe off
_HEEL_STRIKE_PITCH = 19.0  # degrees, of the raised toes at heel strike
_CLEARANCE = 30.0  # mm, of the ankle in mid-swing, beyond the pitch's own
_HALF_STEP_WIDTH = 60.0  # mm, of an ankle from the line of progression
_STEP_SD = 6.0  # mm, of each step's place
_TOE_OUT = 6.0  # degrees, outward heading of the feet
_SMOOTHING_SECONDS = 0.016  # SD of the Gaussian filter over feet and pitch

_STRIDE_CUTOFF = 0.25  # Hz, of the slow variation of tempo and amplitudes
_SLOW_POSTURE_CUTOFF = 0.3  # Hz, of the slow variation of posture
_FAST_POSTURE_CUTOFF = 2.0  # Hz, of its fast variation
_TEMPO_SD = 0.02  # relative
_AMPLITUDE_SD = 0.05  # relative
_FAST_POSTURE = 0.2  # SD of the fast variation of posture, relative to the slow one
_MARGIN_STEPS = 3  # steps before and after the take that are computed and cut off


def walk(n_frames: int, rate: float, rng: np.random.Generator) -> tuple[Floats, dict[str, Floats]]:
    """Return root positions (F, 3) in millimetres and bone angles (F, 3) in degrees of level walking along z.

    Hips, knees and ankles follow from the feet and the pelvis. Cadence, stride, amplitudes and posture vary slowly
    about their means, so that no two strides are equal.
    """
    margin = int(_MARGIN_STEPS * rate / CADENCE) + 1
    n = n_frames + 2 * margin
    # Phase in strides of the left foot, and the slow variations
    tempo = 1.0 + _TEMPO_SD * smooth_noise(rng, n, rate, _STRIDE_CUTOFF)[:, 0]
    phase = rng.random() + np.cumsum(tempo) * CADENCE / 2 / rate
    turn = 2 * np.pi * phase
    scale = 1.0 + _AMPLITUDE_SD * smooth_noise(rng, n, rate, _STRIDE_CUTOFF, 3)
    posture = smooth_noise(rng, n, rate, _SLOW_POSTURE_CUTOFF, 12)
    posture = posture + _FAST_POSTURE * smooth_noise(rng, n, rate, _FAST_POSTURE_CUTOFF, 12)
    # Root: sways sideways once a stride, bobs and surges once a step
    speed = SPEED * tempo * (1 + 0.02 * posture[:, 0] + 0.08 * np.cos(2 * turn - 0.3))
    root = _columns(
        18 * np.sin(turn - 0.3) + 6 * posture[:, 1],
        ROOT_HEIGHT - 40 - 20 * np.cos(2 * turn - 0.1) + posture[:, 2],
        np.cumsum(speed) / rate,
    )
    # Pelvis: tilts forward, turns with the leg in front, drops on the side of the swinging leg
    pelvis = _columns(4 + np.cos(2 * turn), -5 * np.cos(turn), 4 * np.sin(turn + 0.5)) + 0.5 * posture[:, 3:6]
    pelvis *= scale[:, :1]
    # Trunk: turns against the pelvis, in equal parts of three bones; the head faces forward, by two bones
    back = (_columns(-2 - 1.5 * np.cos(2 * turn - 0.8), 6 * np.cos(turn - 0.1), 0) - pelvis + posture[:, 6:9]) / 3
    gaze = (1.5 * posture[:, 9:] - pelvis - 3 * back) / 2
    angles = {"root": pelvis, "lowerback": back, "upperback": back, "thorax": back, "neck": gaze, "head": gaze}
    for side, ahead, swing in (("l", 0.0, scale[:, 1]), ("r", 0.5, scale[:, 2])):
        angles |= _leg(side, phase + ahead, root, pelvis, rate, rng) | _arm(side, phase + ahead, swing)
    kept = slice(margin, margin + n_frames)
    start = [0.0, 0.0, root[margin, 2]]
    return root[kept] - start, {bone: column[kept] for bone, column in angles.items()}


def _columns(*parts: Floats | float) -> Floats:
    """Return the parts, arrays (F,) or numbers, as columns (F, n)."""
    return np.stack(np.broadcast_arrays(*parts), axis=-1).astype(float)


def _leg(
    side: str, phase: Floats, root: Floats, pelvis: Floats, rate: float, rng: np.random.Generator
) -> dict[str, Floats]:
    """Return the angles of a leg whose heel strikes at each whole number of ``phase`` (F,), in strides."""
    left = 1.0 if side == "l" else -1.0
    stride = np.floor(phase).astype(int)
    part = phase - stride
    # The place of each step: under the hip at midstance
    counts = np.arange(stride[0], stride[-1] + 2)
    steps = _columns(
        _HALF_STEP_WIDTH * left + rng.normal(0.0, _STEP_SD, len(counts)),
        ANKLE_HEIGHT,
        np.interp(counts + _MIDSTANCE, phase, root[:, 2]) + rng.normal(0.0, _STEP_SD, len(counts)),
    )
    here, ahead = steps[stride - counts[0]], steps[stride - counts[0] + 1]
    # Pitch: the heel rises until toe off and sinks in swing; the toes are up around heel strike
    pitch = _PUSH_OFF_PITCH * (
        minimum_jerk(part, _HEEL_RISE, _TOE_OFF + 0.02) - minimum_jerk(part, _TOE_OFF, _LEVEL_IN_SWING)
    )
    pitch -= _HEEL_STRIKE_PITCH * (
        1 - minimum_jerk(part, 0.0, _FOOT_FLAT) + minimum_jerk(part, _TOES_UP, _HIGHEST_TOES)
    )
    # Swing: from one step to the next around toe off, by a smooth step 3u² − 2u³
    swung = np.clip((part - _TOE_OFF + 0.05) / (1.0 - _TOE_OFF + 0.04), 0.0, 1.0)
    swung = swung**2 * (3 - 2 * swung)
    level_ankle = here + swung[:, None] * (ahead - here)
    level_ankle[:, 1] += _CLEARANCE * np.sin(np.pi * swung) ** 2
    smoothing = _SMOOTHING_SECONDS * rate
    yaw = np.full(len(phase), _TOE_OUT * left)
    pitch = smoothed(pitch, smoothing)
    ankle, foot = rolling_foot(side, level_ankle, yaw, pitch)
    ankle = smoothed(ankle, smoothing)
    # Toes: flat on the floor while the heel is up, then bent up a little for clearance
    toes = -np.maximum(pitch, 0.0) * (1 - minimum_jerk(part, _TOE_OFF, _LEVEL_IN_SWING))
    toes = toes - 5 * minimum_jerk(part, 0.6, 0.8)
    bend = _columns(smoothed(toes, smoothing), 0, 0)
    return leg_angles(side, root, rotation(pelvis), ankle, foot, yaw) | {f"{side}toes": bend}


def _arm(side: str, phase: Floats, scale: Floats) -> dict[str, Floats]:
    """Return the angles of an arm that swings against its leg; forearm and hand are 0.05 strides later."""
    left = 1.0 if side == "l" else -1.0
    swing, late = (scale * _swing(phase - delay) for delay in (0.02, 0.07))
    return {
        f"{side}clavicle": _columns(0, 2 * swing * left, (1.5 + 0.8 * swing) * left),
        f"{side}humerus": _columns(-3 - 18 * swing, -8 * left, (6 - 1.5 * swing) * left),
        f"{side}radius": _columns(-26 - 11 * late, 0, 0),
        f"{side}hand": _columns(-6 - 3 * late, -12 * left, 0),
    }


def _swing(phase: Floats) -> Floats:
    """Return the swing of an arm, about 1 in front to −1 behind, a little faster forwards than backwards."""
    turn = 2 * np.pi * phase
    return np.asarray(-np.cos(turn) - 0.08 * np.sin(2 * turn + 0.4) - 0.03 * np.cos(3 * turn))
