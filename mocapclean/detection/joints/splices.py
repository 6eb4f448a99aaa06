"""Find splices: jumps from one frame to the next that do not come back, where two pieces were joined."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.detection.joints.signals import Signals

_LEAST = 10.0
"""Degrees, or their equal in mm, of a splice. Chosen on the takes at even places, at 24 to 120 Hz."""
_ROUGHNESS = 4.0
"""Times the largest acceleration beside a splice that the jump is long. Chosen likewise."""
_BESIDE = 4
"""Frames on each side of the jump that show how the path moves. Chosen by hand."""


@dataclass(frozen=True)
class Splice:
    """A signal that jumps by ``size`` from the frame before ``at`` to the frame ``at``."""

    signal: int
    at: int
    size: float


def find_splices(signals: Signals, excused: Bools) -> list[Splice]:
    """Return the jumps of signals, without steps (F - 1, S) that are excused: those of pops and holds."""
    if len(signals.paths) < 2 * _BESIDE or not len(signals.joints):
        return []
    steps = np.diff(signals.paths, axis=0)
    length = np.linalg.norm(steps, axis=2)
    known = signals.known[1:] & signals.known[:-1]
    found = []
    for at, signal in np.argwhere((length >= _LEAST) & known & ~excused):
        before, behind = steps[max(at - _BESIDE, 0) : at, signal], steps[at + 1 : at + 1 + _BESIDE, signal]
        if len(before) < 2 or len(behind) < 2:
            continue
        size = min(float(np.linalg.norm(steps[at, signal] - side).item()) for side in (before[-1], behind[0]))
        rough = max(_largest(np.diff(before, axis=0)), _largest(np.diff(behind, axis=0)))
        if size >= _LEAST + _ROUGHNESS * rough:
            found.append(Splice(int(signal), int(at) + 1, float(length[at, signal])))
    return found


def _largest(vectors: Floats) -> float:
    """Return the length of the longest of vectors (n, 4)."""
    return float(np.linalg.norm(vectors, axis=1).max())
