"""Shadow boxing: jabs, crosses, hooks, ducks and steps at random from an orthodox guard.

Angles, distances and times are chosen by hand, so that speeds of markers are in the ranges of real boxing;
tests/simulate has these.
"""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.numerics.gaussian import smoothed
from mocapclean.simulate.figure import ROOT_HEIGHT, Vector, rotation
from mocapclean.simulate.legs import ANKLE_HEIGHT, leg_angles, minimum_jerk, rolling_foot
from mocapclean.simulate.markers import smooth_noise


class Move(NamedTuple):
    """A move from the guard and back.

    angles: degrees, of the bones at full reach; "trunk" is the sum over the three bones of the spine, "gaze" that over
    neck and head. shift: mm, of the root at full reach. rise, fall: s, to full reach and back. pause: s, from this move
    to the next one of a combination, of which about half is used.
    """

    angles: dict[str, Vector]
    shift: Vector
    rise: float
    fall: float
    pause: float


# Degrees, of the bones in the guard; bones of the legs follow from the feet.
_GUARD: dict[str, Vector] = {
    "root": (6.0, -34.0, 0.0),
    "trunk": (12.0, -4.0, 0.0),
    "gaze": (-6.0, 32.0, 0.0),
    "lclavicle": (0.0, -8.0, 2.0),
    "rclavicle": (0.0, 8.0, -2.0),
    "lhumerus": (-62.0, 30.0, 8.0),
    "rhumerus": (-52.0, 30.0, -12.0),
    "lradius": (-116.0, 0.0, 0.0),
    "rradius": (-128.0, 0.0, 0.0),
    "lhand": (0.0, -25.0, 0.0),
    "rhand": (0.0, 25.0, 0.0),
}
_MOVES: dict[str, Move] = {
    "jab": Move(
        angles={
            "root": (7.0, -38.0, 0.0),
            "trunk": (12.0, -10.0, -2.0),
            "gaze": (-6.0, 42.0, 0.0),
            "lclavicle": (0.0, -18.0, 5.0),
            "lhumerus": (-104.0, 62.0, 4.0),
            "lradius": (-10.0, 0.0, 0.0),
            "lhand": (0.0, -70.0, 0.0),
        },
        shift=(0.0, -10.0, 45.0),
        rise=0.19,
        fall=0.27,
        pause=0.55,
    ),
    "cross": Move(
        angles={
            "root": (9.0, 4.0, 0.0),
            "trunk": (15.0, 24.0, 3.0),
            "gaze": (-9.0, -18.0, 0.0),
            "rclavicle": (0.0, 22.0, -5.0),
            "rhumerus": (-108.0, -46.0, -4.0),
            "rradius": (-8.0, 0.0, 0.0),
            "rhand": (0.0, 70.0, 0.0),
        },
        shift=(15.0, -25.0, 70.0),
        rise=0.21,
        fall=0.30,
        pause=0.65,
    ),
    "hook": Move(
        angles={
            "root": (6.0, -62.0, 0.0),
            "trunk": (10.0, -26.0, -4.0),
            "gaze": (-5.0, 70.0, 0.0),
            "lclavicle": (0.0, -18.0, 8.0),
            "lhumerus": (-64.0, 2.0, 56.0),
            "lradius": (-84.0, 0.0, 0.0),
            "lhand": (0.0, -10.0, 0.0),
        },
        shift=(-25.0, -15.0, 20.0),
        rise=0.22,
        fall=0.32,
        pause=0.7,
    ),
    "duck": Move(
        angles={"root": (18.0, -30.0, 6.0), "trunk": (34.0, -2.0, 8.0), "gaze": (-32.0, 28.0, -8.0)},
        shift=(-70.0, -150.0, 20.0),
        rise=0.30,
        fall=0.42,
        pause=0.85,
    ),
}
# Moves in sequence; each combination is as likely as the others.
_COMBINATIONS: tuple[tuple[str, ...], ...] = (
    ("jab",),
    ("jab",),
    ("cross",),
    ("hook",),
    ("duck",),
    ("jab", "cross"),
    ("jab", "cross", "hook"),
    ("duck", "hook"),
)
# Place of the ankle in mm, heading and pitch of the foot in degrees, in the stance.
_FEET: dict[str, tuple[Vector, float, float]] = {
    "l": ((105.0, ANKLE_HEIGHT, 215.0), -22.0, 3.0),
    "r": ((-125.0, ANKLE_HEIGHT, -215.0), -52.0, 16.0),
}
# The foot that pivots in a move, with the change of its heading and pitch in degrees at full reach.
_PIVOTS = {"cross": ("r", 30.0, 22.0), "hook": ("l", -28.0, 14.0)}


_SWAY_CUTOFF = 0.5  # Hz, of the slow random motion of root and bones
_SWAY_ANGLE = 2.0  # degrees, SD of the slow random angles
_SWAY = 14.0  # mm, SD of the root's slow random motion to the side and forward, and 0.4 of it up
_STANCE_DEPTH = 105  # mm, of the root below its height at rest, in the bent knees of the stance
_BOUNCE = 7  # mm, amplitude of the bounce
_BOUNCE_RATE = 1.9  # Hz, mean
_BOUNCE_RATE_SD = 0.15  # Hz, slow variation
_BOUNCE_RATE_CUTOFF = 0.3  # Hz, of that variation
_ARM_DELAY = 0.05  # s, of the arm behind the trunk
_ARM_HASTE = 0.9  # time of the arm's rise, relative to the trunk's
_SIZE_SD = 0.05  # relative, variation of the reach from move to move
_HASTE_SD = 0.06  # relative, variation of the rise from move to move
_STEP_LIMITS = (150.0, 200.0)  # mm, farthest place of the stance to the side and forward
_STEP_SECONDS = 0.28  # of one foot
_STEP_DELAY = 0.14  # s, of the second foot
_STEP_HEIGHT = 35  # mm
_BONE_SMOOTHING = 0.012  # s, SD of the Gaussian filter over bone angles and steps
_ROOT_SMOOTHING = 0.02  # s, SD of the Gaussian filter over the root and pivots
# Ranges of random times, s
_FIRST_MOVE = (0.3, 0.8)  # start of the first move
_PAUSE_SHARE = (0.5, 0.6)  # of the move's pause, to the next move of a combination
_REST = (0.35, 1.1)  # between combinations
_FIRST_STEP = (0.5, 2.0)  # start of the first step
_BETWEEN_STEPS = (1.2, 3.0)  # from step to step


def box(n_frames: int, rate: float, rng: np.random.Generator) -> tuple[Floats, dict[str, Floats]]:
    """Return root positions (F, 3) in millimetres and bone angles (F, 3) in degrees of shadow boxing towards z.

    Every move rises and returns with minimum jerk, the trunk before the arm. Sizes and speeds vary by some percent from
    move to move. The feet move in steps, and in the pivots of cross and hook.
    """
    time = np.arange(n_frames) / rate
    # Guard, with slow random motion of all joints but the elbows
    values = {
        bone: np.array(guard)
        + _SWAY_ANGLE * smooth_noise(rng, n_frames, rate, _SWAY_CUTOFF, 3) * (bone not in ("lradius", "rradius"))
        for bone, guard in _GUARD.items()
    }
    bounce_rate = _BOUNCE_RATE + _BOUNCE_RATE_SD * smooth_noise(rng, n_frames, rate, _BOUNCE_RATE_CUTOFF)[:, 0]
    bounce = _BOUNCE * np.sin(2 * np.pi * np.cumsum(bounce_rate) / rate)
    sway = _SWAY * smooth_noise(rng, n_frames, rate, _SWAY_CUTOFF, 3) * (1, 0.4, 1)
    root = np.array([0.0, ROOT_HEIGHT - _STANCE_DEPTH, 0.0]) + sway
    root[:, 1] += bounce
    # Moves: each adds its difference from the guard, times a pulse
    pivots = {side: np.zeros((n_frames, 2)) for side in "lr"}
    for name, start in _schedule(time[-1], rng):
        move = _MOVES[name]
        size, haste = rng.normal(1.0, _SIZE_SD), rng.normal(1.0, _HASTE_SD)
        body = size * _pulse(time, start, move.rise * haste, move.fall)
        arm = size * _pulse(time, start + _ARM_DELAY, move.rise * haste * _ARM_HASTE, move.fall)
        for bone, target in move.angles.items():
            pulse = body if bone in ("root", "trunk", "gaze") else arm
            values[bone] += np.outer(pulse, np.subtract(target, _GUARD[bone]))
        root += np.outer(body, move.shift)
        if name in _PIVOTS:
            side, *turned = _PIVOTS[name]
            pivots[side] += np.outer(body, turned)
    # The trunk in equal parts of three bones, the gaze in parts of two; then legs that reach the feet
    trunk, gaze = values.pop("trunk") / 3, values.pop("gaze") / 2
    spine = {"lowerback": trunk, "upperback": trunk, "thorax": trunk, "neck": gaze, "head": gaze}
    angles = {bone: smoothed(v, _BONE_SMOOTHING * rate) for bone, v in (values | spine).items()}
    steps = _steps(time, rng)
    # The root follows half of each foot's step, and none of its lift.
    root = smoothed(root + (steps["l"] + steps["r"]) * (0.5, 0.0, 0.5), _ROOT_SMOOTHING * rate)
    for side in "lr":
        angles |= _leg(side, root, angles["root"], steps[side], pivots[side], rate)
    return root, angles


def _pulse(time: Floats, start: float, rise: float, fall: float) -> Floats:
    """Return a pulse (F,) from 0 to 1 and back, with minimum jerk."""
    top = start + rise
    return minimum_jerk(time, start, top) - minimum_jerk(time, top, top + fall)


def _schedule(end: float, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Return moves and their starts in seconds, before ``end``; those of a combination follow one another closely."""
    schedule, now = [], rng.uniform(*_FIRST_MOVE)
    while now < end:
        for name in _COMBINATIONS[rng.integers(len(_COMBINATIONS))]:
            schedule.append((name, now))
            now += _MOVES[name].pause * rng.uniform(*_PAUSE_SHARE)
        now += rng.uniform(*_REST)
    return schedule


def _steps(time: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """Return the displacement (F, 3) of each foot from the stance by random steps, lifts included, in mm."""
    displacement = {side: np.zeros((len(time), 3)) for side in "lr"}
    place, now = np.zeros(2), rng.uniform(*_FIRST_STEP)
    while now < time[-1]:
        target = rng.uniform(-1.0, 1.0, 2) * _STEP_LIMITS
        # The foot in the direction of the step moves first.
        order = "lr" if target[1] > place[1] else "rl"
        for late, side in zip((0.0, _STEP_DELAY), order, strict=True):
            part = minimum_jerk(time, now + late, now + late + _STEP_SECONDS)
            displacement[side][:, [0, 2]] += np.outer(part, target - place)
            displacement[side][:, 1] += _STEP_HEIGHT * np.sin(np.pi * part) ** 2
        place, now = target, now + rng.uniform(*_BETWEEN_STEPS)
    return displacement


def _leg(side: str, root: Floats, pelvis: Floats, step: Floats, pivot: Floats, rate: float) -> dict[str, Floats]:
    """Return the angles of a leg from the root (F, 3), the pelvis (F, 3), the step (F, 3) and the pivot (F, 2)."""
    place, yaw, pitch = _FEET[side]
    turned = smoothed(pivot, _ROOT_SMOOTHING * rate) + np.array([yaw, pitch])
    level_ankle = smoothed(step, _BONE_SMOOTHING * rate) + place
    ankle, foot = rolling_foot(side, level_ankle, turned[:, 0], turned[:, 1])
    toes = np.zeros_like(root)
    toes[:, 0] = -turned[:, 1]
    return leg_angles(side, root, rotation(pelvis), ankle, foot, turned[:, 0]) | {f"{side}toes": toes}
