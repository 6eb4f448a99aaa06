"""Choose the frames of a session that a gap is learnt from and tried on, where the take's own do not suffice.

A session is other takes of the same subject (``take.session``). Its frames follow those of the take, behind a pause.
"""

import os
import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.solvers.kriging.frame_selection import MIN_WINDOWS, spread_out, starts_of_length

FEWEST = float(os.environ.get("LF_FEWEST", "0"))
WMODE = os.environ.get("LF_W", "fill")
NEAR = os.environ.get("LF_NEAR", "1") == "1"
STEP = float(os.environ.get("LF_STEP", "40"))

POSE_NEIGHBOURS = 8  # heaviest neighbours whose distances make up a pose
GAP_POSES = 6  # poses of the gap, evenly spaced, that the session's poses are compared with


def training_of_session(positions: Floats, usable: Bools, gap: Ints, n_own: int, most: int, rate: float) -> Ints:
    """Return up to ``most`` frames of the session, those whose poses are nearest to poses of the gap.

    positions: (F, q, 3) of the neighbours in descending order of their weight. usable: (F,) frames to choose from.
    """
    frames = np.flatnonzero(usable[n_own:]) + n_own
    step = max(1, round(rate / STEP))
    frames = frames[frames % step == 0] if len(frames) > most * 1 else frames
    pairs = np.triu_indices(min(positions.shape[1], POSE_NEIGHBOURS), 1)
    if most <= 0 or len(frames) <= most:
        return frames[: max(most, 0)]
    if not NEAR or not len(pairs[0]):
        return spread_out(frames, most, 1)

    def poses(at: Ints) -> Floats:
        return np.linalg.norm(positions[at][:, pairs[0]] - positions[at][:, pairs[1]], axis=2)

    in_gap, learnt = poses(spread_out(gap, GAP_POSES, 1)), poses(frames)
    nearest = np.min([np.square(learnt - pose).sum(axis=1) for pose in in_gap], axis=0)
    return np.sort(frames[np.argsort(nearest, kind="stable")[:most]])


def windows_with_session(
    known: Bools,
    missing_share: Floats,
    length: int,
    n_windows: int,
    edges: tuple[int, int],
    n_own: int,
    alike=None,
) -> tuple[Ints, int]:
    """Return windows as ``window_starts`` does: the take's own, and as many of the session as they lack."""
    of_session = slice(n_own, None)

    def alike_there(starts: Ints, length: int) -> Bools:
        return alike(starts + n_own, length)

    shortest = max(1, length // 4) if alike else 1
    wanted = length
    starts = np.zeros(0, dtype=np.intp)
    while n_windows and length >= shortest:
        own = starts_of_length(known[:n_own], missing_share[:n_own], length, n_windows, edges, alike)
        if WMODE == "half":
            own = spread_out(own, n_windows // 2, 1)
        if WMODE == "session":
            own = own[:0]
        others = starts_of_length(
            known[of_session], missing_share[of_session], length, n_windows - len(own), edges, alike and alike_there
        )
        starts = np.append(own, others + n_own)
        if len(starts) >= MIN_WINDOWS:
            break
        length //= 2
    if alike and len(starts) < MIN_WINDOWS:
        return windows_with_session(known, missing_share, wanted, n_windows, edges, n_own)
    return starts, max(length, 1)
