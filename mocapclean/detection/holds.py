"""Find holds: frames in which a marker stays constant although the position predicted from other markers moves.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.detection.prediction import Prediction
from mocapclean.detection.stillness import resting, still_samples

SHORTEST_HOLD = 5  # frames
LEAST_MOTION = 5.0  # mm, by which the predicted position must move, and the marker leap when it is released
_LEAP_RATIO = 2.0  # times its next step that the step of a released marker must be long


@dataclass(frozen=True, kw_only=True)
class Hold:
    """A marker that keeps its place in frames start to stop while its predicted position moves by ``moved`` mm."""

    marker: int
    start: int
    stop: int
    moved: float


def find_holds(positions: Floats, trusted: Bools, prediction: Prediction) -> tuple[Hold, ...]:
    """Return the holds in positions (F, M, 3) with trust (F, M).

    A hold lasts 5 frames; then the marker leaps, or goes missing. A marker that is still in half of its trusted samples
    has no holds.
    """
    still = still_samples(positions, trusted)
    holds = []
    for marker, start, stop in column_runs(still & prediction.predicted & ~resting(still, trusted)):
        if stop - start >= SHORTEST_HOLD and _is_released(positions[:, marker], trusted[:, marker], stop):
            predicted = prediction.positions[start - 1 : stop, marker]
            moved = float(np.linalg.norm(predicted - predicted[0], axis=1).max())
            if moved >= LEAST_MOTION:
                holds.append(Hold(marker=marker, start=start, stop=stop, moved=moved))
    return tuple(holds)


def hold_mask(holds: tuple[Hold, ...], trusted: Bools) -> Bools:
    """Return the samples (F, M) of holds."""
    mask = np.zeros_like(trusted)
    for hold in holds:
        mask[hold.start : hold.stop, hold.marker] = True
    return mask


def _is_released(path: Floats, trusted: Bools, frame: int) -> bool:
    """Whether a path (F, 3) leaps at a frame, by 5 mm and twice its next step, or goes missing there for a time.

    A marker that is still at the end of the take, or at its own last sample, may rest there.
    """
    if not trusted[frame:].any():
        return False
    if not trusted[frame]:
        return True
    leap = float(np.linalg.norm(path[frame] - path[frame - 1]))
    has_next = frame + 1 < len(path) and trusted[frame + 1]
    next_step = float(np.linalg.norm(path[frame + 1] - path[frame])) if has_next else 0.0
    return leap >= max(LEAST_MOTION, _LEAP_RATIO * next_step)
