"""The departure of each sample from its neighbouring frames (innovation), and the threshold that makes it a break.

A sample has two coordinates: its position in the world, and its residual, the position less the prediction from its
partners. A fault of a partner moves the residual and not the position; a fast turn moves the position and not the
residual. A break must show in both.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.numerics.robust import nan_median, ordered_quantiles

LEAST_BREAK = 8.0  # mm, no smaller innovation is a break
_MEDIANS = 3.0  # median innovations that noise may reach while the marker accelerates
_ACCELERATION_SHARE = 0.6  # share of the predicted acceleration, mm per frame², that an innovation may reach
_ACCELERATION_REACH = 2  # frames on each side whose acceleration counts as well
_RARE = 1e-6  # probability of the innovation at which the noise of a marker ends
_TAIL_SHARES = (0.75, 0.95, 0.95)  # quantiles that set the exponential tail, pass by pass
_BURST_WINDOW = 5  # frames of the running median that shows a burst
_SHORTEST_BURST = 4  # frames of this median above its threshold


def innovations(positions: Floats, residual: Floats) -> Floats:
    """Return the innovations (F, M), mm: the least of four prediction errors, by position or residual, forwards or
    backwards.

    The least of four prediction errors: of the residual kept constant, and of the residual or the position
    extrapolated at constant velocity, forwards or backwards in time. NaN where no error can be taken.
    """
    shape = residual.shape[:2]
    constant, forward, backward = (np.full(shape, np.nan) for _ in range(3))
    # ‖r[t] - r[t-1]‖: the residual keeps its value.
    constant[1:] = np.linalg.norm(np.diff(residual, axis=0), axis=2)
    # ‖x[t] - 2 x[t-1] + x[t-2]‖: the same second difference is the error forwards at t and backwards at t-2.
    second = np.fmin(*(np.linalg.norm(np.diff(path, n=2, axis=0), axis=2) for path in (residual, positions)))
    forward[2:], backward[1:-1] = second, second
    return np.asarray(np.fmin(constant, np.fmin(forward, backward)))


def break_thresholds(innovation: Floats, usable: Bools, predicted: Floats) -> Floats:
    """Return the innovation (F, M), mm, above which a frame is a break.

    The largest of three: 8 mm; the innovation that the marker's noise exceeds once in a million; 3 median innovations
    plus 0.6 times the acceleration of the predicted positions (F, M, 3). usable: (F, M), the samples whose noise
    counts.
    """
    median, rare = noise_tail(np.where(usable, innovation, np.nan))
    moving = _MEDIANS * median + _ACCELERATION_SHARE * _acceleration(predicted)
    return np.asarray(np.maximum(np.maximum(rare, LEAST_BREAK), moving))


def _acceleration(predicted: Floats) -> Floats:
    """Return the acceleration (F, M) of positions (F, M, 3), mm per frame², the largest within 2 frames."""
    acceleration = np.zeros(predicted.shape[:2])
    acceleration[1:-1] = np.linalg.norm(np.diff(predicted, n=2, axis=0), axis=2)
    largest = acceleration.copy()
    for shift in range(1, _ACCELERATION_REACH + 1):
        largest[shift:] = np.maximum(largest[shift:], acceleration[:-shift])
        largest[:-shift] = np.maximum(largest[:-shift], acceleration[shift:])
    return largest


def bursts(innovation: Floats, usable: Bools, predicted: Floats) -> Bools:
    """Return the samples (F, M) in bursts of noise.

    In a burst, the median innovation of 5 frames exceeds its threshold for 4 frames or more. The threshold is that of
    ``break_thresholds``, for the medians. The last of these frames leads back to the path and is left out.
    """
    burst = np.zeros_like(usable)
    if len(innovation) < _BURST_WINDOW:
        return burst
    half = _BURST_WINDOW // 2
    # No other markers have a median above the least threshold.
    markers = np.flatnonzero((innovation > LEAST_BREAK).any(axis=0))
    median = np.full((len(innovation), len(markers)), np.nan)
    windows = sliding_window_view(innovation[:, markers], _BURST_WINDOW, axis=0)
    median[half : len(median) - half] = nan_median(windows, axis=2)
    above = median > break_thresholds(median, usable[:, markers], predicted[:, markers])
    for column, start, stop in column_runs(above):
        if stop - start >= _SHORTEST_BURST:
            burst[start : stop - 1, markers[column]] = True
    return burst


def noise_tail(noise: Floats) -> tuple[Floats, Floats]:
    """Return the median of noise (F, M), and the value (M,) that a fitted exponential tail exceeds once in a million.

    An exponential tail through the median m and the quantile q: P(noise > m + d) = ½ exp(-d / s), where s follows from
    q. The first pass uses the 75th percentile, the others the 95th without the values beyond the tail so far: faults in
    a twentieth of the frames do not hide themselves.
    """
    ordered = np.sort(noise, axis=0)
    count = np.sum(~np.isnan(noise), axis=0)
    for share in _TAIL_SHARES:
        median, high = np.nan_to_num(ordered_quantiles(ordered, count, (0.5, share)))
        # d = (q - m) ln(½ / p) / ln(½ / (1 - share)) for a tail probability p.
        rare = median + (high - median) * np.log(0.5 / _RARE) / np.log(0.5 / (1 - share))
        # The values beyond are the last ones in order.
        count = np.minimum(count, np.sum(ordered <= np.maximum(rare, LEAST_BREAK), axis=0))
    return median, rare
