"""The axis of a take that is vertical; no file format states it of its samples."""

import numpy as np

from mocapclean.arrays import Bools, Floats, evenly_spaced

_FRAMES = 100  # most frames from which the vertical axis is found; chosen by hand
_FLOOR = 0.1  # how far the lowest marker is from the floor at most, as a part of the lesser spread; chosen by hand


def up_axis(positions: Floats, trusted: Bools, y_weight: float = 1.0) -> int:
    """Return the axis of positions (F, M, 3) that is most likely vertical, 1 or 2.

    The lowest trusted marker (F, M) stands near the origin of the vertical, which is the floor. Where both axes or none
    are so, it is the one along which the markers spread farther: a body is taller than wide in most frames. y_weight:
    multiplies the spread along y.
    """
    frames = evenly_spaced(len(trusted), _FRAMES)
    known = trusted[frames, :, None]
    low = np.where(known, positions[frames], np.inf).min(axis=1)
    spread = np.where(known, positions[frames], -np.inf).max(axis=1) - low
    seen = np.isfinite(spread).all(axis=1)
    if not seen.any():
        return 2
    floor, size = np.median(low[seen], axis=0), np.median(spread[seen], axis=0)
    size[1] *= y_weight
    on_floor = np.abs(floor) <= _FLOOR * size[1:].min()
    if on_floor[1] != on_floor[2]:
        size *= on_floor
    return 1 if size[1] > size[2] else 2
