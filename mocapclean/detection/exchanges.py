"""Find two markers that carry each other's label for some frames, and undo the exchange.

Where the labels change, the path of each marker continues in the other; the distances to rigid partners confirm it.
Across a gap of both no path shows it, and the distances before and after the gap are compared.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.geometry.distances import Rigidity
from mocapclean.numerics.robust import MAD_TO_SD, nan_median

_LEAST_BREAK = 25.0  # mm, second difference of a path beyond which its label may have changed
_MOST_ERROR = 0.35  # share of the prediction error that may be left when two paths are exchanged
_CLOSEST_PARTNERS = 5  # partners whose distances confirm an exchange
_DISTANCE_SLACK = 3.0  # mm, added to the robust SD of a distance
_GAP_WINDOW_SECONDS = 1.0  # s, time on each side of a gap of both markers that distances are taken over
_FEWEST_SEEN = 5  # frames of such a window in which two markers must be seen
_LEAST_CHANGE = 15.0  # mm, mean change of the distances over a gap from which on an exchange is considered
_LEAST_ERROR = 1e-9  # mm, keeps paths without any error from a division by 0
_SCREEN_FRAMES = 30  # frames of such a window that show which pairs may fit; chosen for speed
_SCREEN_SLACK = 3.0  # factor of the limits for these few frames; with 2, one of 551 exchanges over gaps was missed
_AT_ONCE = 2**18  # numbers of distances that are compared at once; bounds the memory


@dataclass(frozen=True)
class Exchange:
    """Two markers that carry each other's label in some frames (F,).

    before, after: the mean error of their distances to rigid partners, in robust SDs, as labelled and exchanged.
    """

    first: int
    second: int
    frames: Bools
    before: float
    after: float


def exchanges(positions: Floats, rigid: Rigidity, rate: float) -> tuple[Exchange, ...]:
    """Return all exchanges in positions (F, M, 3), NaN where not trusted, taken at ``rate`` Hz.

    The labels are exchanged from every odd change to the next; with an odd number of changes, on the shorter side of
    the last. An exchange must lower the error of the distances to rigid partners.
    """
    confirmed, all_changes = [], _label_changes(positions)
    for pair, frame in _changes_over_gaps(positions, round(_GAP_WINDOW_SECONDS * rate)):
        all_changes.setdefault(pair, []).append(frame)
    for (first, second), changes in sorted(all_changes.items()):
        changes.sort()
        both = np.isfinite(positions[:, [first, second], 0]).all(axis=1)
        frames = (np.searchsorted(changes, np.arange(len(positions)), side="right") % 2 == 1) & both
        if len(changes) % 2 and 2 * frames.sum() > both.sum():
            frames = both & ~frames
        if not frames.any() or frames.sum() == both.sum():
            continue
        before, after = _distance_errors(positions, rigid, first, second, frames)
        if after < before:
            confirmed.append(Exchange(first, second, frames, before, after))
    return tuple(confirmed)


def exchange(positions: Floats, pairs: tuple[Exchange, ...]) -> Floats:
    """Return positions (F, M, 3) with exchanged labels put back: both columns are exchanged in those frames."""
    undone = positions.copy()
    for pair in pairs:
        first, second = undone[pair.frames, pair.first], undone[pair.frames, pair.second]
        undone[pair.frames, pair.first], undone[pair.frames, pair.second] = second, first
    return undone


def _label_changes(positions: Floats) -> dict[tuple[int, int], list[int]]:
    """Return, for each pair of markers, the frames from which on each continues the path of the other."""
    # A label may change at t where the path has a break both forwards and backwards in time.
    shape = positions.shape[:2]
    second_difference = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=2)
    forward, backward = np.full(shape, np.nan), np.full(shape, np.nan)
    forward[2:], backward[1:-1] = second_difference, second_difference
    breaks = np.fmin(forward, backward) > _LEAST_BREAK
    changes: dict[tuple[int, int], list[int]] = {}
    for frame in np.flatnonzero(breaks.sum(axis=1) > 1):
        columns = np.flatnonzero(breaks[frame])
        # Error of the paths exchanged over their error as labelled, for every pair that breaks in this frame.
        errors = _prediction_errors(positions[:, columns], int(frame))
        own = errors.diagonal()
        ratio = (errors + errors.T) / np.maximum(own[:, None] + own, _LEAST_ERROR)
        ratio = np.where(np.isfinite(ratio), ratio, np.inf)
        np.fill_diagonal(ratio, np.inf)
        # The best pair first; a marker is exchanged with one other at most.
        while ratio.size and ratio.min() < _MOST_ERROR:
            a, b = np.unravel_index(int(np.argmin(ratio)), ratio.shape)
            pair = sorted((int(columns[a]), int(columns[b])))
            changes.setdefault((pair[0], pair[1]), []).append(int(frame))
            ratio[[a, b]] = ratio[:, [a, b]] = np.inf
    return changes


def _changes_over_gaps(positions: Floats, window: int) -> list[tuple[tuple[int, int], int]]:
    """Return pairs of markers that change labels over a gap of both, and the first frame after it.

    The distances to the five most rigid others must agree three times better with those before the gap if the labels
    are exchanged. They are medians over ``window`` frames on each side.
    """
    pairs = _common_gaps(np.isfinite(positions[..., 0]))
    start, stop = pairs[:, 2], pairs[:, 3]
    windows = np.stack([np.maximum(start - window, 0), start, stop, np.minimum(stop + window, len(positions))], axis=1)
    every = window // _SCREEN_FRAMES
    if every > 1:
        # Most pairs do not fit by far: a few frames show that, unless a window is short.
        short = (2 * (windows[:, 1::2] - windows[:, ::2]) < window).any(axis=1)
        rough = _exchange_fits(positions[::every], pairs[:, :2], -(-windows // every), slack=_SCREEN_SLACK)
        pairs, windows = pairs[short | rough], windows[short | rough]
    fits = _exchange_fits(positions, pairs[:, :2], windows)
    return [((int(a), int(b)), int(frame)) for a, b, _, frame in pairs[fits]]


def _common_gaps(seen: Bools) -> Ints:
    """Return the gaps of two markers that overlap, as rows: both markers, and the span (start, stop) of both gaps.

    seen: (F, M). Gaps at the start or end of the take do not count.
    """
    gaps = np.array([gap for gap in column_runs(~seen) if gap[1] > 0 and gap[2] < len(seen)], dtype=np.intp)
    if not len(gaps):
        return np.empty((0, 4), dtype=np.intp)
    gaps = gaps[np.argsort(gaps[:, 1], kind="stable")]
    # In the order of their starts, a gap overlaps those after it that start before it stops.
    number = np.searchsorted(gaps[:, 1], gaps[:, 2]) - np.arange(len(gaps)) - 1
    one = np.repeat(np.arange(len(gaps)), number)
    other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(number) - number, number)
    markers = np.sort(np.stack([gaps[one, 0], gaps[other, 0]], axis=1), axis=1)
    span = np.stack([gaps[one, 1], np.maximum(gaps[one, 2], gaps[other, 2])], axis=1)
    return np.unique(np.concatenate([markers, span], axis=1), axis=0)


def _exchange_fits(positions: Floats, pairs: Ints, windows: Ints, slack: float = 1.0) -> Bools:
    """Whether (n,) the distances of two markers after a gap fit those before only if they carry each other's label.

    pairs: (n, 2), the markers. windows: (n, 4), start and stop of the frames before and after the gap. slack: by which
    the limits are widened; if it is not 1, a distance counts that is seen in any frame.
    """
    if not len(pairs):
        return np.zeros(0, dtype=bool)
    # The windows of both markers, before and after the gap. Many are those of several pairs.
    of_pairs = [np.stack([marker, *end], axis=1) for end in (windows.T[:2], windows.T[2:]) for marker in pairs.T]
    unique, place = np.unique(np.concatenate(of_pairs), axis=0, return_inverse=True)
    medians, spreads = _usual_distances(positions, unique, _FEWEST_SEEN if slack == 1.0 else 1)
    place, size = place.reshape(2, 2, -1), max(1, _AT_ONCE // len(medians[0]))
    chunks = (slice(low, low + size) for low in range(0, len(pairs), size))
    errors = [_errors_of_labels(medians, spreads, place[..., chunk], pairs[chunk]) for chunk in chunks]
    as_labelled, exchanged = np.concatenate(errors, axis=1)
    return np.asarray((slack * as_labelled >= _LEAST_CHANGE) & (exchanged < slack * _MOST_ERROR * as_labelled))


def _usual_distances(positions: Floats, windows: Ints, fewest: int) -> tuple[Floats, Floats]:
    """Return the medians and robust SDs (w, M), mm, of the distances of a marker to all others in windows (w, 3).

    windows: the marker, and the frames (start, stop). The median is NaN where both are seen in too few frames.
    """
    paths = np.ascontiguousarray(positions.transpose(2, 1, 0))
    medians, spreads = np.full((2, len(windows), paths.shape[1]), np.nan)
    length = windows[:, 2] - windows[:, 1]
    for size in np.unique(length[length > 0]).tolist():
        equal = np.flatnonzero(length == size)
        n_at_once = max(1, _AT_ONCE // (size * paths.shape[1]))
        for few in (equal[low : low + n_at_once] for low in range(0, len(equal), n_at_once)):
            frames = windows[few, 1][:, None] + np.arange(size)
            offsets = paths[:, :, frames] - paths[:, windows[few, 0, None], frames][:, None]
            distances = np.sqrt(np.einsum("cmwf,cmwf->wmf", offsets, offsets))
            often = np.isfinite(distances).sum(axis=2) >= fewest
            medians[few] = np.where(often, nan_median(distances, axis=2), np.nan)
            spreads[few] = MAD_TO_SD * nan_median(np.abs(distances - medians[few][..., None]), axis=2)
    return medians, spreads


def _errors_of_labels(medians: Floats, spreads: Floats, place: Ints, pairs: Ints) -> Floats:
    """Return the mean changes (2, n), mm, of the distances of pairs (n, 2) over a gap: as labelled, and exchanged.

    They are over the five most rigid others, and 0 where there are none. medians, spreads: (w, M) mm, of distances.
    place: (2, 2, n), their rows before and after the gap, for the first marker and the second.
    """
    # The spread of a distance, over both markers and both sides of the gap; NaN where one of them is unknown.
    spread = spreads[place].sum(axis=(0, 1))
    np.put_along_axis(spread, pairs, np.nan, axis=1)
    closest = np.argsort(spread, axis=1)[:, :_CLOSEST_PARTNERS]
    spread = np.take_along_axis(spread, closest, axis=1)
    known = np.isfinite(spread)
    old, new = np.where(known, medians[place[..., None], closest], 0.0)
    weight = np.where(known, 1.0 / (spread + _DISTANCE_SLACK), 0.0)
    total = np.maximum(weight.sum(axis=1), np.finfo(float).tiny)
    return np.stack(
        [(np.abs(order - old).mean(axis=0) * weight).sum(axis=1) / total for order in (new, new[::-1])],
    )


def _prediction_errors(paths: Floats, frame: int) -> Floats:
    """Return the errors (n, n), mm, by which each path (row) misses each position (column) in a frame.

    paths: (F, n, 3). The path is extrapolated at constant velocity into the frame, or that position's path backwards
    out of it, whichever fits better.
    """
    errors = []
    if frame >= 2:
        predicted = 2 * paths[frame - 1] - paths[frame - 2]
        errors.append(np.linalg.norm(predicted[:, None] - paths[frame], axis=2))
    if frame + 1 < len(paths):
        predicted = 2 * paths[frame] - paths[frame + 1]
        errors.append(np.linalg.norm(paths[frame - 1][:, None] - predicted, axis=2))
    return np.asarray(np.fmin.reduce(errors))


def _distance_errors(positions: Floats, rigid: Rigidity, first: int, second: int, frames: Bools) -> tuple[float, float]:
    """Return the mean error, in robust SDs, of the distances to rigid partners in some frames (F,).

    Of two markers together, as labelled and exchanged. Medians and SDs are those of the other frames.
    """
    as_labelled, exchanged = 0.0, 0.0
    for own, other in ((first, second), (second, first)):
        partners = [p for p in rigid.partners(own)[0] if p not in (first, second)][:_CLOSEST_PARTNERS]
        if not partners:
            continue
        distances = np.linalg.norm(positions[:, partners] - positions[:, [own]], axis=2)
        middle = nan_median(distances[~frames])
        spread = MAD_TO_SD * nan_median(np.abs(distances[~frames] - middle)) + _DISTANCE_SLACK
        swapped = np.linalg.norm(positions[frames][:, partners] - positions[frames][:, [other]], axis=2)
        as_labelled += _mean(np.abs(distances[frames] - middle) / spread)
        exchanged += _mean(np.abs(swapped - middle) / spread)
    return as_labelled, exchanged


def _mean(values: Floats) -> float:
    """Return the mean of the finite values, 0 if there are none."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else 0.0
