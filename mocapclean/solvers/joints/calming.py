"""Calm a filled path: no step from frame to frame that the joint makes nowhere near, as far as the error bars allow.

The other joints predict each frame by itself, so that a step of the answer may be larger than any of the motion. Let d
be the rotation vectors from the plain path to the answer, 0 beside the gap. They are replaced by the x that minimises

    |x - d|² + λ |D² x|²

with second differences D² and the least λ at which every step is small enough (E. T. Whittaker, 1923, On a new method
of graduation, doi:10.1017/S0013091500077853). The larger λ, the nearer is the path to the plain one.
"""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.joint_motion import angles_between, conjugate, from_vectors, rotation_vectors, times

_BESIDE = 8
"""Frames on each side of a gap whose steps show how fast the joint turns. Chosen by hand."""
_STRENGTHS = 10.0 ** np.arange(-1.0, 6.0, 0.5)
"""The λ that are tried. From 0.1, which moves no frame by much, to what leaves little but the plain path of a gap of 60
frames. Chosen by hand."""


def calmed(rotations: Floats, known: Bools, start: int, path: Floats, sd: Floats, plain: Floats) -> Floats:
    """Return the path (n, 4) over a gap from ``start`` with steps that are no larger than those near it.

    rotations, known: (F, 4), (F,), those of the joint. sd: (n,) degrees, error bars; no frame turns by more than one of
    them. plain: (n, 4). A step may be as large as the largest one beside the gap, and of the plain path.
    """
    stop = start + len(path)
    if start == 0 or stop == len(known) or not (known[start - 1] and known[stop]):
        return path
    ends = rotations[[start - 1]], rotations[[stop]]
    limit = max(_largest_beside(rotations, known, start, stop), _largest_step(plain, ends))
    calm = path
    if _largest_step(path, ends) <= limit:
        return calm
    away = rotation_vectors(times(conjugate(plain), path))
    reach = np.sqrt(3.0) * sd
    for strength in _STRENGTHS:
        smooth = _smoothed(away, float(strength))
        if (np.linalg.norm(smooth - away, axis=1) > reach).any():
            break
        calm = times(plain, from_vectors(smooth))
        if _largest_step(calm, ends) <= limit:
            break
    return calm


def _largest_beside(rotations: Floats, known: Bools, start: int, stop: int) -> float:
    """Return the largest step, degrees, between known frames beside a gap."""
    around = slice(max(start - 1 - _BESIDE, 0), stop + 1 + _BESIDE)
    both = known[around][1:] & known[around][:-1]
    steps = angles_between(rotations[around][:-1], rotations[around][1:])
    return float(steps[both].max(initial=0.0))


def _largest_step(path: Floats, ends: tuple[Floats, Floats]) -> float:
    """Return the largest step, degrees, of a path (n, 4) and into and out of it from the frames (1, 4) beside it."""
    whole = np.concatenate([ends[0], path, ends[1]])
    return float(angles_between(whole[:-1], whole[1:]).max())


def _smoothed(away: Floats, strength: float) -> Floats:
    """Return what minimises the sum in the module's text for d = ``away`` (n, 3)."""
    n = len(away)
    bands = np.zeros((3, n))
    bands[2] = 6.0
    bands[2, 0] -= 1.0
    bands[2, -1] -= 1.0
    bands[1, 1:], bands[0, 2:] = -4.0, 1.0
    bands *= strength
    bands[2] += 1.0
    return np.asarray(scipy.linalg.solveh_banded(bands[-n:] if n < 3 else bands, away))
