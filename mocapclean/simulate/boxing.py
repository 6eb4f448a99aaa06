"""Boxing: an orthodox guard, from which jabs, crosses, hooks, ducks and steps come at random."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from mocapclean.arrays import Floats
from mocapclean.simulate.figure import ROOT_HEIGHT, Vector, rotation
from mocapclean.simulate.legs import ANKLE_HEIGHT, ease, reach, roll
from mocapclean.simulate.markers import wander


class Move(NamedTuple):
    """What a move changes: bones' angles and the root's place, its rise and return in seconds, the least pause after.

    ``angles`` are those at full reach, in degrees; "trunk" is shared by the three bones of the spine. ``shift`` is
    in millimetres. The trunk leads the arm.
    """

    angles: dict[str, Vector]
    shift: Vector
    rise: float
    fall: float
    pause: float


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
        {
            "root": (7.0, -38.0, 0.0),
            "trunk": (12.0, -10.0, -2.0),
            "gaze": (-6.0, 42.0, 0.0),
            "lclavicle": (0.0, -18.0, 5.0),
            "lhumerus": (-104.0, 62.0, 4.0),
            "lradius": (-10.0, 0.0, 0.0),
            "lhand": (0.0, -70.0, 0.0),
        },
        (0.0, -10.0, 45.0),
        0.19,
        0.27,
        0.55,
    ),
    "cross": Move(
        {
            "root": (9.0, 4.0, 0.0),
            "trunk": (15.0, 24.0, 3.0),
            "gaze": (-9.0, -18.0, 0.0),
            "rclavicle": (0.0, 22.0, -5.0),
            "rhumerus": (-108.0, -46.0, -4.0),
            "rradius": (-8.0, 0.0, 0.0),
            "rhand": (0.0, 70.0, 0.0),
        },
        (15.0, -25.0, 70.0),
        0.21,
        0.30,
        0.65,
    ),
    "hook": Move(
        {
            "root": (6.0, -62.0, 0.0),
            "trunk": (10.0, -26.0, -4.0),
            "gaze": (-5.0, 70.0, 0.0),
            "lclavicle": (0.0, -18.0, 8.0),
            "lhumerus": (-64.0, 2.0, 56.0),
            "lradius": (-84.0, 0.0, 0.0),
            "lhand": (0.0, -10.0, 0.0),
        },
        (-25.0, -15.0, 20.0),
        0.22,
        0.32,
        0.7,
    ),
    "duck": Move(
        {"root": (18.0, -30.0, 6.0), "trunk": (34.0, -2.0, 8.0), "gaze": (-32.0, 28.0, -8.0)},
        (-70.0, -150.0, 20.0),
        0.30,
        0.42,
        0.85,
    ),
}
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
_FEET: dict[str, tuple[Vector, float, float]] = {
    "l": ((105.0, ANKLE_HEIGHT, 215.0), -22.0, 3.0),
    "r": ((-125.0, ANKLE_HEIGHT, -215.0), -52.0, 16.0),
}
_PIVOT = {"cross": ("r", 30.0, 22.0), "hook": ("l", -28.0, 14.0)}


def box(n_frames: int, rate: float, rng: np.random.Generator) -> tuple[Floats, dict[str, Floats]]:
    """Root places (F, 3) in millimetres and bone angles (F, 3) in degrees of shadow boxing towards z.

    Every move rises and returns with least jerk, the trunk ahead of the arm; sizes and speeds vary by some percent
    from move to move. The feet stay where they are but for steps and for the pivots of cross and hook.
    """
    time = np.arange(n_frames) / rate
    values = {
        bone: np.array(guard) + 2.0 * wander(rng, n_frames, rate, 0.5, 3) * (bone not in ("lradius", "rradius"))
        for bone, guard in _GUARD.items()
    }
    bounce = 7 * np.sin(2 * np.pi * np.cumsum(1.9 + 0.15 * wander(rng, n_frames, rate, 0.3)[:, 0]) / rate)
    root = np.array([0.0, ROOT_HEIGHT - 105, 0.0]) + 14 * wander(rng, n_frames, rate, 0.5, 3) * (1, 0.4, 1)
    root[:, 1] += bounce
    pivots = {side: np.zeros((n_frames, 2)) for side in "lr"}
    for name, start in _schedule(time[-1], rng):
        move = _MOVES[name]
        size, haste = rng.normal(1.0, 0.05), rng.normal(1.0, 0.06)
        body = size * _pulse(time, start, move.rise * haste, move.fall)
        arm = size * _pulse(time, start + 0.05, move.rise * haste * 0.9, move.fall)
        for bone, target in move.angles.items():
            pulse = body if bone in ("root", "trunk", "gaze") else arm
            values[bone] += np.outer(pulse, np.subtract(target, _GUARD[bone]))
        root += np.outer(body, move.shift)
        if name in _PIVOT:
            side, *turned = _PIVOT[name]
            pivots[side] += np.outer(body, turned)
    trunk, gaze = values.pop("trunk") / 3, values.pop("gaze") / 2
    spine = {"lowerback": trunk, "upperback": trunk, "thorax": trunk, "neck": gaze, "head": gaze}
    angles = {bone: gaussian_filter1d(v, 0.012 * rate, axis=0) for bone, v in (values | spine).items()}
    steps = _steps(time, rng)
    root = gaussian_filter1d(root + (steps["l"] + steps["r"]) * (0.5, 0.0, 0.5), 0.02 * rate, axis=0)
    for side in "lr":
        angles |= _leg(side, root, angles["root"], steps[side], pivots[side], rate)
    return root, angles


def _pulse(time: Floats, start: float, rise: float, fall: float) -> Floats:
    top = start + rise
    return ease(time, start, top) - ease(time, top, top + fall)


def _schedule(end: float, rng: np.random.Generator) -> list[tuple[str, float]]:
    """Moves and when they start; within a combination the next one starts as soon as its arm is free."""
    found, now = [], rng.uniform(0.3, 0.8)
    while now < end:
        for name in _COMBINATIONS[rng.integers(len(_COMBINATIONS))]:
            found.append((name, now))
            now += _MOVES[name].pause * rng.uniform(0.5, 0.6)
        now += rng.uniform(0.35, 1.1)
    return found


def _steps(time: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """How far each foot (F, 3) has been moved from its place in the stance, and lifted, by steps to and fro."""
    found = {side: np.zeros((len(time), 3)) for side in "lr"}
    place, now = np.zeros(2), rng.uniform(0.5, 2.0)
    while now < time[-1]:
        target = rng.uniform(-1.0, 1.0, 2) * (150.0, 200.0)
        order = "lr" if target[1] > place[1] else "rl"
        for late, side in zip((0.0, 0.14), order, strict=True):
            part = ease(time, now + late, now + late + 0.28)
            found[side][:, [0, 2]] += np.outer(part, target - place)
            found[side][:, 1] += 35 * np.sin(np.pi * part) ** 2
        place, now = target, now + rng.uniform(1.2, 3.0)
    return found


def _leg(side: str, root: Floats, pelvis: Floats, step: Floats, pivot: Floats, rate: float) -> dict[str, Floats]:
    place, yaw, pitch = _FEET[side]
    turned = gaussian_filter1d(pivot, 0.02 * rate, axis=0) + np.array([yaw, pitch])
    flat = gaussian_filter1d(step, 0.012 * rate, axis=0) + place
    ankle, foot = roll(side, flat, turned[:, 0], turned[:, 1])
    toes = np.zeros_like(root)
    toes[:, 0] = -turned[:, 1]
    return reach(side, root, rotation(pelvis), ankle, foot, turned[:, 0]) | {f"{side}toes": toes}
