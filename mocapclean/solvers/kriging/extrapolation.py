"""How far the poses of a gap are from those that it is learnt from, where these are few.

A pose is the set of distances between the neighbours. Windows that are shorter than the gap hold less change of pose
than the gap does, so that the errors in them are too small.
"""

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.frame_selection import spread_out

# Chosen by hand, for speed.
N_NEIGHBOURS = 12  # heaviest neighbours that make the pose
N_POSES = 40  # poses of the marker's known frames with which those of the gap are compared


def pose_growth(positions: Floats, known: Ints, gap: Ints, window_length: int, floor: float) -> Floats:
    """Return the factors (L,), at least 1, by which the variance of a prediction grows over a gap.

        factor_t = min over known frames s of |pose_t - pose_s| / mean of |pose_{s + window / 2} - pose_s|

    positions: (F, q, 3) of the neighbours in descending order of their weight, mm. known, gap: the frames in which the
    marker is known, and those of the gap. floor: mm, change of pose below which poses count as equal.

    Markers of ten captures were hidden but for 0.2 to 0.5 s. Without these factors the RMS error of one gap in five was
    more than twice the expected one, and with them of one in eleven. The square of the ratio was too large for most.
    """
    pairs = np.triu_indices(min(positions.shape[1], N_NEIGHBOURS), 1)
    lag = max(1, window_length // 2)
    later = known[np.isin(known + lag, known)]
    if not len(pairs[0]) or not len(later):
        return np.ones(len(gap))

    def poses(frames: Ints) -> Floats:
        """Return the distances (n, pairs) between the neighbours."""
        return np.asarray(np.linalg.norm(positions[frames][:, pairs[0]] - positions[frames][:, pairs[1]], axis=2))

    learnt = poses(spread_out(known, N_POSES, 1))
    in_gap = poses(gap)
    nearest = np.min([np.square(in_gap - pose).mean(axis=1) for pose in learnt], axis=0)
    later = spread_out(later, N_POSES, 1)
    usual = np.sqrt(np.square(poses(later + lag) - poses(later)).mean(axis=1)).mean()
    return np.asarray(np.maximum(np.maximum(np.sqrt(nearest), floor) / max(usual, floor), 1.0), dtype=np.float64)
