"""Fill gaps of up to 1/24 s by kriging over 12 samples on each side, in the world and in axes that follow neighbours.

A gap is predicted by universal kriging with several kernels, on two tracks of the marker: in the world, and in frames
of reference that follow the marker as its neighbours predict it. The predictions are averaged. Their weights follow
from their errors on windows (known samples of the marker, hidden and predicted), and on the samples adjacent to the
gap, each predicted from the others: where a track jumps or rattles, a smooth curve through it overshoots.
"""

from collections.abc import Callable
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs, runs
from mocapclean.cores import in_parts
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.numerics.robust import nan_median
from mocapclean.solvers.kriging.drift_kriging import MAX_PER_SIDE, DriftKriging

# Unless a source is given, the constants below were chosen by hand; no sweep was kept.
MIN_TRUSTED = 12  # trusted samples of a marker, at least, for its gaps to be bridged
WINDOW_MARGIN = 4  # known samples, at least, before and after a window
MAX_WINDOWS = 40  # windows, at most, on which errors are measured for each gap length
N_LEFT_OUT = 2  # samples on each side of a gap that are predicted from the others
WINDOW_COUNT = 4.0  # samples that all windows count as together; raised from 1 to steady the error bars
ERROR_POWER = 3  # weights are 1 / (mean square error)³
EQUAL_ERROR = 1e-12  # mm², added to mean square errors, so that perfect predictions weigh alike
MAX_NEIGHBOUR_SHIFT = 4.0
"""Most that neighbours shift a prediction, in SDs of the prediction from the marker's own track alone.

In CMU 10_01 a hand flips for two frames, and without a limit its fingers follow it. With 20 % of the samples lost at
random the limit lowered the RMSE of that take from 0.0099 to 0.0080, in the unit of docs/results.md.
"""
MEDIAN_TO_MEAN = 0.789  # median of the mean of three squared standard normal errors, whose mean is 1: median(χ²₃) / 3
MIN_SHIFT = 1e-12  # mm, keeps a division by the length of a shift finite
PART = 4  # markers whose gaps are bridged together on one core; chosen by hand for speed

FramesFor = Callable[[int, Ints], BodyFrames | None]
"""Returns the frames of reference that follow a marker (column) at some frames of the take, or None.

The origins are NaN where the neighbours do not predict the marker.
"""


def in_short_gaps(trusted: Bools, longest: int) -> Bools:
    """Return the samples (F, M) in gaps of up to ``longest`` frames, of markers with at least 12 trusted samples."""
    short = np.zeros_like(trusted)
    for marker, start, stop in column_runs(~trusted & (trusted.sum(axis=0) >= MIN_TRUSTED)):
        short[start:stop, marker] = stop - start <= longest
    return short


def bridge_short_gaps(
    positions: Floats,
    trusted: Bools,
    to_fill: Bools,
    rate: float,
    frames_for: FramesFor | None = None,
    step: int = 1,
) -> tuple[Floats, Floats]:
    """Return positions (F, M, 3) with the samples ``to_fill`` (F, M) of gaps filled, and their SD (F, M), mm.

    The SD is that of each coordinate, from the errors of the same prediction on known samples, spread over the gap as
    the kriging variance is. It is NaN where nothing is filled. rate: Hz. step: every how many-th sample on each side
    of a gap it is bridged from.
    """
    filled, sd = positions.copy(), np.full(trusted.shape, np.nan)
    markers = np.flatnonzero(to_fill.any(axis=0)).tolist()
    parts = [markers[first : first + PART] for first in range(0, len(markers), PART)]
    bridged = in_parts(partial(_bridged, positions, trusted, to_fill, rate, frames_for, step), parts)
    for marker, start, answer in chain.from_iterable(bridged):
        span = slice(start, start + len(answer[0]))
        filled[span, marker], sd[span, marker] = answer
    return filled, sd


def _bridged(
    positions: Floats,
    trusted: Bools,
    to_fill: Bools,
    rate: float,
    frames_for: FramesFor | None,
    step: int,
    markers: list[int],
) -> list[tuple[int, int, tuple[Floats, Floats]]]:
    """Return the marker, the first frame, the positions (L, 3) and the SD (L,) of each gap of some markers, mm."""
    kriging, bridged = DriftKriging(rate), []
    for marker in markers:
        samples = np.flatnonzero(trusted[:, marker])
        gaps = [_stretch(samples, start, stop - start, step) for start, stop in runs(to_fill[:, marker]).tolist()]
        # Windows as long as each gap, and the errors in them.
        windows = {length: _windows(samples, length, step) for length in {gap.length for gap in gaps}}
        stretches = [*gaps, *chain.from_iterable(windows.values())]
        kriging.prepare([(stretch.samples, stretch.length) for stretch in stretches])
        frames = np.unique(np.concatenate([stretch.frames for stretch in stretches]))
        tracks = _Tracks(positions[:, marker], frames, frames_for(marker, frames) if frames_for else None)
        errors = {length: _window_errors(tracks, of_length, kriging) for length, of_length in windows.items()}
        bridged += [(marker, gap.start, _fill(tracks, gap, errors[gap.length], kriging)) for gap in gaps]
    return bridged


class _Stretch(NamedTuple):
    """Frames of a marker that are predicted from the samples on both sides: a gap, or a window of known samples.

    start, length: frames. adjacent: (k,) frames of the samples on both sides, ``n_before`` of them before the stretch.
    hidden: frames of the known samples inside; none in a gap.
    """

    start: int
    length: int
    adjacent: Ints
    n_before: int
    hidden: Ints

    @property
    def samples(self) -> Ints:
        """The adjacent frames, counted from the first frame of the stretch."""
        return self.adjacent - self.start

    @property
    def inside(self) -> Ints:
        """The frames of the stretch."""
        return np.arange(self.start, self.start + self.length)

    @property
    def frames(self) -> Ints:
        """The adjacent frames, then those inside."""
        return np.append(self.adjacent, self.inside)


class _WindowErrors(NamedTuple):
    """Mean square errors (tracks, kernels) in the windows, mm², as such and relative to the kriging variance."""

    squares: Floats
    scaled: Floats


def _stretch(known: Ints, start: int, length: int, step: int) -> _Stretch:
    """Return a stretch with up to 12 of the known frames on each side, every ``step``-th from the nearest."""
    first, last = np.searchsorted(known, (start, start + length)).tolist()
    before = known[:first][::-1][: step * MAX_PER_SIDE : step][::-1]
    adjacent = np.append(before, known[last : last + step * MAX_PER_SIDE : step])
    return _Stretch(start, length, adjacent, len(before), known[first:last])


def _windows(known: Ints, length: int, step: int) -> list[_Stretch]:
    """Return up to 40 windows that begin at known frames, evenly chosen; none where too few samples are known."""
    last = len(known) - length - WINDOW_MARGIN
    if last < WINDOW_MARGIN:
        return []
    chosen = np.unique(np.linspace(WINDOW_MARGIN, last, MAX_WINDOWS).astype(int))
    return [_stretch(known, start, length, step) for start in known[chosen].tolist()]


class _Tracks:
    """The tracks of one marker: in the world, and in frames of reference that follow it, if there are any.

    track: (F, 3) in the world, mm. following: the frames of reference at ``frames`` (n,) of the take, or None.
    """

    def __init__(self, track: Floats, frames: Ints, following: BodyFrames | None) -> None:
        self.frames, self.following, self.tracks = frames, following, [track]
        if following:
            local = np.full_like(track, np.nan)
            local[frames] = following.to_local(track[frames][:, None])[:, 0]
            self.tracks.append(local)

    def at(self, frames: Ints) -> Floats:
        """Return the positions (tracks, ..., 3) at frames (...)."""
        return np.stack([track[frames] for track in self.tracks])

    def to_world(self, track: int, positions: Floats, frames: Ints) -> Floats:
        """Return positions (n, 3) of one of the tracks at frames (n,) in world coordinates."""
        if not track or not self.following:
            return positions
        at = np.searchsorted(self.frames, frames)
        frames_there = BodyFrames(self.following.axes[at], self.following.origins[at])
        return frames_there.to_world(positions[:, None])[:, 0]


def _window_errors(tracks: _Tracks, windows: list[_Stretch], kriging: DriftKriging) -> _WindowErrors | None:
    """Return the mean square errors in windows, by the median over windows; None without windows."""
    squares, scaled = [], []
    alike: dict[tuple[bytes, bytes], list[_Stretch]] = {}
    for window in windows:
        key = window.samples.tobytes(), (window.hidden - window.start).tobytes()
        alike.setdefault(key, []).append(window)
    # Windows with the same pattern of samples are predicted with the same weights.
    for group in alike.values():
        weights, variance = kriging.weights(group[0].samples, group[0].length)
        hidden = group[0].hidden - group[0].start
        samples = tracks.at(np.stack([window.adjacent for window in group]))
        predicted = np.matmul(weights[:, hidden], samples[:, :, None])
        truth = tracks.at(np.stack([window.hidden for window in group]))[:, :, None]
        errors = np.square(predicted - truth).mean(axis=4)
        squares.append(errors.mean(axis=3))
        scaled.append((errors / variance[:, hidden]).mean(axis=3))
    if not windows:
        return None
    of_all = [nan_median(np.concatenate(each, axis=1), axis=1) / MEDIAN_TO_MEAN for each in (squares, scaled)]
    return _WindowErrors(*of_all)


def _fill(tracks: _Tracks, gap: _Stretch, errors: _WindowErrors | None, kriging: DriftKriging) -> tuple[Floats, Floats]:
    """Return the positions (length, 3) of a gap and their SD (length,), mm: weighted means over tracks and kernels."""
    drift = kriging.weights(gap.samples, gap.length)
    # Tracks that are defined in the whole gap, and in some window.
    usable = np.isfinite(tracks.at(gap.frames)).all(axis=(1, 2))
    if errors:
        usable &= np.isfinite(errors.squares).all(axis=1)
        errors = _WindowErrors(errors.squares[usable], errors.scaled[usable])
    values = tracks.at(gap.adjacent)[usable]
    # Errors of each kernel on each track.
    squares, scaled = _kernel_errors(values, gap, kriging.leave_one_out(gap.samples), errors)
    # Weights of the kernels of each track, 1 / (mean square error)³, relative to the best.
    weights = ((squares.min() + EQUAL_ERROR) / (squares + EQUAL_ERROR)) ** ERROR_POWER
    # Each kernel's variance over the gap: kriging variance, scaled to its errors.
    variances = weights[..., None] * scaled[..., None] * drift.variance
    sums = weights.sum(axis=1)
    predicted = [
        tracks.to_world(track, np.tensordot(share / total, drift.weights, axes=1) @ samples, gap.inside)
        for track, (share, total, samples) in enumerate(zip(weights, sums, values, strict=True))
    ]
    # Neighbours may be at fault in the gap itself: limit the shift from the prediction in the world.
    world_variance = variances[0].sum(axis=0) / sums[0]
    shifts = np.stack(predicted) - predicted[0]
    size = np.linalg.norm(shifts, axis=2, keepdims=True)
    largest = MAX_NEIGHBOUR_SHIFT * np.sqrt(3.0 * world_variance)[:, None]
    shifts *= np.minimum(1.0, largest / np.maximum(size, MIN_SHIFT))
    positions = predicted[0] + np.tensordot(sums / sums.sum(), shifts, axes=1)
    return positions, np.sqrt(variances.sum(axis=(0, 1)) / sums.sum())


def _kernel_errors(
    values: Floats, gap: _Stretch, leave_one_out: Floats, errors: _WindowErrors | None
) -> tuple[Floats, Floats]:
    """Return the sum of square errors and the mean of scaled ones (tracks, kernels), mm², over samples and windows.

    values: (tracks, k, 3) at the adjacent samples. leave_one_out: (K, k, k), that of ``DriftKriging``. The two nearest
    samples on each side are predicted from the others, and the windows count as four more samples. Scaled errors are
    relative to the kriging variance.
    """
    nearest = slice(max(0, gap.n_before - N_LEFT_OUT), gap.n_before + N_LEFT_OUT)
    # Leave-one-out error (Q y)_i / Q_ii, and variance 1 / Q_ii.
    diagonal = np.einsum("gkk->gk", leave_one_out)[:, nearest]
    left = np.matmul(leave_one_out, (values - values.mean(axis=1, keepdims=True))[:, None])
    left_squares = np.square(left).mean(axis=3)[:, :, nearest]
    squares, scaled = (left_squares / diagonal**2).sum(axis=2), (left_squares / diagonal).sum(axis=2)
    counted = float(left_squares.shape[2])
    if errors:
        squares = squares + WINDOW_COUNT * errors.squares
        scaled = scaled + WINDOW_COUNT * errors.scaled
        counted += WINDOW_COUNT
    return squares, scaled / counted
