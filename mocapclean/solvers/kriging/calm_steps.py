"""Smooth filled paths that step from frame to frame by more than their marker or its neighbours do.

Every frame is predicted by itself, so that a step of the answer may be larger than any of the motion. The path d is
graduated with weights of 1 / sd² and the least strength at which no step is too large (``numerics.graduation``).
Samples that are least sure move most, and measured ones beside the path do not.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.numerics import interpolation
from mocapclean.numerics.graduation import graduated

LARGEST_STEP = 1.5
"""The largest step of a filled path, times that of the measured motion.

The measured motion is that of the marker in the take, of its neighbours in the gap, and of the straight line over the
gap; the largest counts. Chosen by hand: the motion in a gap may be somewhat faster than elsewhere.
"""
BESIDE = 2  # measured samples on each side that the path joins: their velocity counts in second differences
LEAST_SHARE = 1e-4  # of the largest SD, that of samples which do not move; keeps the system well conditioned
STRENGTHS = 10.0 ** np.arange(0.0, 8.5, 0.5)
"""The strengths that are tried, in units of 1 / (largest SD of the path)².

The last leaves only the straight path in a second at 120 Hz. Chosen by hand.
"""


def calm(track: Floats, sd: Floats, known: Bools, others: Floats, others_known: Bools) -> None:
    """Smooth the filled stretches of a trajectory (F, 3), mm, in place, where they step too far.

    sd: (F,) per coordinate, mm, NaN where nothing is filled; the variance of a sample grows, in place, by the mean
    square of its move. known: (F,) samples that do not move. others, others_known: (F, q, 3), (F, q), the neighbours. A
    stretch that cannot be smoothed enough stays as it is.
    """
    both, others_both = known[1:] & known[:-1], others_known[1:] & others_known[:-1]
    if not both.any():
        return
    own = _steps(track)[both].max()
    filled = np.isfinite(sd) & ~known
    for start, stop in runs(filled):
        around = slice(start - _count(known[:start][::-1]), stop + _count(known[stop:]))
        path, fixed, steps = track[around], known[around], slice(around.start, around.stop - 1)
        if _steps(path).max(initial=0.0) <= LARGEST_STEP * own:
            continue
        beside = np.where(others_both[steps], _steps(others[around]), 0.0).max(initial=0.0)
        straight = _steps(interpolation.linear(path[:, None], fixed[:, None]))[:, 0].max() if fixed.any() else 0.0
        smooth = _smoothed(path, np.where(fixed, 0.0, sd[around]), LARGEST_STEP * max(own, beside, straight))
        squares = np.square(smooth - path).mean(axis=1)
        sd[around] = np.where(fixed, sd[around], np.sqrt(np.square(sd[around]) + squares))
        track[around] = np.where(fixed[:, None], path, smooth)


def _count(known: Bools) -> int:
    """Return how many samples from the first on are known, up to ``BESIDE``."""
    return int(np.cumprod(known[:BESIDE]).sum())


def _steps(path: Floats) -> Floats:
    """Return the lengths (n - 1, ...) of the steps of paths (n, ..., 3), mm."""
    return np.asarray(np.linalg.norm(np.diff(path, axis=0), axis=-1))


def _smoothed(path: Floats, sd: Floats, limit: float) -> Floats:
    """Return the graduated path (n, 3), or the path as it is where that does not make its steps small enough.

    sd: (n,) mm, 0 for samples that do not move. limit: mm, of a step.
    """
    if _steps(path).max() <= limit:
        return path
    largest = sd.max()
    weights = np.square(largest / np.maximum(sd, LEAST_SHARE * largest))
    for strength in STRENGTHS:
        smooth = graduated(path, weights, float(strength))
        if _steps(smooth).max() <= limit:
            return smooth
    return path
