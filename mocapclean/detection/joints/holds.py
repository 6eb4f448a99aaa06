"""Find holds: frames in which a moving joint keeps exactly one value until a jump releases it.

Measured motion never repeats a value for long while it moves, so that an equal value is evidence by itself. Animation
may rest exactly: it eases into the rest and out of it, or ends in it.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.detection.joints.signals import Signals

SHORTEST = 5
"""Frames that a hold lasts at least: fewer are a repeated frame. Chosen by hand."""
_BESIDE = 4
"""Frames on each side of a hold whose motion is looked at. Chosen by hand."""
_LEAST_JUMP = 2.0
"""Degrees, or their equal in mm, of the jump that releases a hold. Chosen by hand on the takes at even places."""
_JUMP_RATIO = 1.0
"""Times the largest step behind the release that the jump differs from what follows. Chosen likewise."""
_LEAST_SPEED = 0.05
"""Degrees, or their equal in mm, per frame: a joint slower than this before a hold may come to rest. Likewise."""
_EASING = 0.3
"""Share of the usual step before a clear hold that its last step has at least: no easing into a rest. Likewise."""


@dataclass(frozen=True)
class Hold:
    """A signal that repeats one value in frames start to stop and then jumps by ``jump``; is_clear: it was moving."""

    signal: int
    start: int
    stop: int
    jump: float
    is_clear: bool


def find_holds(signals: Signals) -> list[Hold]:
    """Return the holds of signals. The first frame of the constant value was measured and is not part of a hold."""
    if len(signals.paths) < SHORTEST + 2 * _BESIDE or not len(signals.joints):
        return []
    step = np.linalg.norm(np.diff(signals.paths, axis=0), axis=2)
    still = np.zeros(signals.known.shape, dtype=bool)
    still[1:] = (step == 0) & signals.known[1:] & signals.known[:-1]
    holds = []
    for signal, start, stop in column_runs(still):
        if stop - start >= SHORTEST and _is_within(signals.known[:, signal], start, stop):
            hold = _judged(signals.paths[:, signal], signal, start, stop)
            holds += [hold] if hold else []
    return holds


def _is_within(known: Bools, start: int, stop: int) -> bool:
    """Whether the frames beside a hold are there and known."""
    first, last = start - _BESIDE, stop + _BESIDE
    return first >= 0 and last <= len(known) and bool(known[first:last].all())


def _judged(path: Floats, signal: int, start: int, stop: int) -> Hold | None:
    """Return the hold of a path (F, 4) in frames start to stop; None if the joint rests before it or starts gently."""
    # The steps next to the hold come first; the one into the frame ``stop`` is the jump.
    behind = np.diff(path[stop - 1 : stop + _BESIDE], axis=0)
    before = np.linalg.norm(np.diff(path[start - _BESIDE : start], axis=0), axis=1)[::-1]
    jump, *following = np.linalg.norm(behind, axis=1)
    # The jump is no part of the motion behind it, at constant velocity or acceleration.
    departure = min(jump, *(float(np.linalg.norm(np.diff(behind, n=n, axis=0)[0])) for n in (1, 2)))
    if departure < max(_LEAST_JUMP, _JUMP_RATIO * max(following)) or not before.all() or not any(following):
        return None
    is_clear = float(before[0]) >= max(_LEAST_SPEED, _EASING * float(before.mean()))
    return Hold(signal, start, stop, float(jump), is_clear)
