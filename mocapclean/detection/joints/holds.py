"""Find holds: frames in which the channels of a moving joint keep one value until a jump releases them."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs

from mocapclean.detection.joints.signals import Signals

SHORTEST = 5
"""Frames that a hold lasts at least: fewer are a repeated frame. Chosen by hand."""
_BESIDE = 3
"""Frames on each side of a hold whose motion is looked at. Chosen by hand."""
_LEAST_JUMP = 2.0
"""Degrees, or their equal in mm, of the jump that releases a hold. Chosen on the takes at even places."""
_JUMP_RATIO = 3.0
"""Times the steps behind the release that the jump is long, for a suspicion; likewise."""
_STOP_RATIO = 3.0
"""Times the acceleration beside a clear hold that the velocity is which ends at once in it; likewise."""
_LEAST_SPEED = 0.05
"""Degrees, or their equal in mm, per frame: a joint slower than this right before a hold may come to rest; likewise."""


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
    rough = np.zeros(signals.known.shape)
    rough[1:-1] = np.linalg.norm(np.diff(signals.paths, n=2, axis=0), axis=2)
    holds = []
    for signal, start, stop in column_runs(still):
        if stop - start >= SHORTEST and _is_within(signals.known[:, signal], start, stop):
            hold = _judged(signal, start, stop, step[:, signal], rough[:, signal])
            holds += [hold] if hold else []
    return holds


def _is_within(known: Bools, start: int, stop: int) -> bool:
    """Whether the frames beside a hold are there and known."""
    first, last = start - _BESIDE - 1, stop + _BESIDE
    return first >= 0 and last <= len(known) and bool(known[first:last].all())


def _judged(signal: int, start: int, stop: int, step: Floats, rough: Floats) -> Hold | None:
    """Return the hold of a signal with steps (F - 1,) and accelerations (F,) in some frames; None if released gently."""
    jump = float(step[stop - 1])  # into the frame ``stop``
    behind = step[stop : stop + _BESIDE - 1]
    before = step[start - 1 - _BESIDE : start - 1]
    # The jump is no step of the motion that follows, and the joint moves on both sides.
    if jump < max(_LEAST_JUMP, _JUMP_RATIO * float(behind.max())) or not before.all() or not behind.any():
        return None
    # The acceleration at the frames before the last one that moved does not use the hold.
    own = float(max(rough[start - 1 - _BESIDE : start - 1].max(), rough[stop + 1 : stop + _BESIDE].max(initial=0.0)))
    is_clear = float(before[-1]) >= max(_LEAST_SPEED, _STOP_RATIO * own)
    return Hold(signal, start, stop, jump, is_clear)
