"""Calm a filled path: no step from frame to frame that the joint makes nowhere near, as far as the error bars allow.

The other joints predict each frame by itself, so that a step of the answer may be larger than any of the motion. Let d
be the rotation vectors from the plain path to the answer, 0 beside the gap. They are graduated, with the least strength
at which every step is small enough (``numerics.graduation``). The larger it is, the nearer the plain path.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.joint_motion import angles_between, conjugate, from_vectors, rotation_vectors, times
from mocapclean.numerics.graduation import graduated

_BESIDE = 8
"""Frames on each side of a gap whose steps show how fast the joint turns. Chosen by hand."""
_FIXED = 1e9  # weight of the frames beside the gap, which do not move; those of the gap weigh 1
_STRENGTHS = 10.0 ** np.arange(-1.0, 6.0, 0.5)
"""The strengths that are tried.

They go from 0.1, which moves no frame by much, to what leaves little but the plain path of 60 frames. Chosen by hand.
"""


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
    # The path and the answer meet beside the gap.
    around, weights = np.pad(away, ((1, 1), (0, 0))), np.pad(np.ones(len(away)), 1, constant_values=_FIXED)
    for strength in _STRENGTHS:
        smooth = graduated(around, weights, float(strength))[1:-1]
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
