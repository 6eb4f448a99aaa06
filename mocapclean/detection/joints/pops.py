"""Find pops: frames in which a path leaves abruptly and comes back, while it is smooth when they are left out.

A path is judged by what it would be without the frames in question, not by how fast it is: a somersault at 30 Hz turns
far in each frame and has small fourth differences, a pop has large ones until it is left out.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.joints.others import fitted_pop, unexplained
from mocapclean.detection.joints.others import usual as usually_unexplained
from mocapclean.detection.joints.signals import Signals

LEAST = 5.0
"""Degrees, or their equal in mm, that a path must leave by. This and the three factors below were chosen together on
the takes at even places of BVH and AMC, at 24, 30, 60 and 120 Hz: most pops of 20 degrees, few false ones."""
_LARGEST = 1.0
"""Times the largest fourth difference about the excursion that a path must leave by. Chosen with ``LEAST``."""
_MEDIAN = 3.0
"""Times the median fourth difference about the excursion that a path must leave by. Chosen with ``LEAST``."""
_USUAL = 2.0
"""Times the departure that the joint exceeds in ``_USUAL_SHARE`` of the frames. Chosen with ``LEAST``."""
_USUAL_SHARE = 0.1
"""Share of frames; heels and toes leave their path at each strike of the foot. Chosen with ``LEAST``."""
_LEAST_USUAL = 3
"""Frames whose departures count as faults, not as usual, in takes too short for the share. Chosen by hand."""
_SLOWING = 1.5
"""Times what a velocity that changes within a longer excursion moves its middle. By hand, with the same takes."""
_ROUGH_INSIDE = 1.5
"""Times the mean distance from the path that the mean second difference within a burst of noise is. Between an arc or a
plateau (at most 1) and independent noise (2.4). Chosen by hand."""
_LEAST_ALONE = 10.0
"""Degrees that a path must leave by in one frame to be judged by what the other joints do not explain. Chosen on the
takes at even places: smaller ones are noise that a few joints share."""
_SHARE_ALONE = 0.5
"""Share of what the other joints do not explain that the path leaves by at least: it must come back. Likewise."""
_EXPLAINED = 0.6
"""Score, of what the other joints do not explain, below which an excursion of one frame is a suspicion. Likewise."""
_CERTAIN = 2.0
"""Score from which on an excursion needs no second opinion: other joints may have the same fault. Likewise."""
SUSPECTED = 0.7
"""Share of the threshold from which on an excursion is a suspicion. By hand, with the same takes."""
LONGEST_SECONDS = 0.25
"""Seconds that a pop lasts at most. Chosen by hand."""
LONGEST_FRAMES = 12
"""Frames that a pop may last at low rates, where ``LONGEST_SECONDS`` has fewer. Chosen by hand."""
REACH = 6
"""Frames on each side of an excursion that show the path without it. Chosen with ``LEAST``."""
_FEWEST = 2
"""Frames of the take that there must be on each side of an excursion."""
_SCALE = 1.0 / 6.0
"""The fourth difference times this is how far a frame lies from the cubic through its four neighbours."""


@dataclass(frozen=True)
class Excursion:
    """A signal off its path in frames start to stop, by ``size``; ``score``: times its threshold."""

    signal: int
    start: int
    stop: int
    size: float
    score: float


def longest_frames(rate: float) -> int:
    """Return the frames that a pop lasts at most; ``rate`` in Hz."""
    return max(LONGEST_FRAMES, round(LONGEST_SECONDS * rate))


def find_excursions(signals: Signals, rate: float) -> list[Excursion]:
    """Return the excursions that score at least ``SUSPECTED``; those of one signal do not touch."""
    n_frames, n_signals = signals.known.shape
    if n_frames <= 2 * _FEWEST or not n_signals:
        return []
    paths = _padded(signals.paths)
    forwards, backwards = _departures(paths), _departures(paths[::-1])[::-1]
    usual = _usual(np.minimum(forwards, backwards)[REACH:-REACH])
    rough = np.zeros_like(forwards)
    rough[2:-2] = _SCALE * np.sqrt(_squares(np.diff(paths, n=4, axis=0)))
    longest = longest_frames(rate)
    starts, ends = _abrupt(forwards, rough, usual), _abrupt(backwards[::-1], rough[::-1], usual)[::-1]
    rows = [np.empty((0, 3), dtype=np.intp)]
    for signal in np.flatnonzero(starts.any(axis=0) & ends.any(axis=0)):
        pairs = _pairs(np.flatnonzero(starts[:, signal]), np.flatnonzero(ends[:, signal]) + 1, longest)
        rows.append(np.column_stack([np.full(len(pairs), signal), pairs]))
    spans = np.concatenate(rows)
    outside = (spans[:, 1] < REACH + _FEWEST) | (spans[:, 2] > len(paths) - REACH - _FEWEST)
    spans = spans[~outside]
    size, score = np.zeros(len(spans)), np.zeros(len(spans))
    length = spans[:, 2] - spans[:, 1]
    for n in np.unique(length):
        same = length == n
        size[same], score[same] = scored(paths, spans[same], int(n), usual, signals.part == "rotation")
    if signals.part == "rotation":
        return _chosen(*_with_others(signals, paths, np.minimum(forwards, backwards), usual, (spans, size, score)))
    return _chosen(spans, size, score, np.zeros_like(length))


def _with_others(
    signals: Signals, paths: Floats, departed: Floats, usual: Floats, scored: tuple[Ints, Floats, Floats]
) -> tuple[Ints, Floats, Floats, Ints]:
    """Return spans (P, 3), sizes, scores and turns (P,) for ``_chosen``, with excursions of one frame judged by others.

    scored: spans, sizes and scores of excursions. departed: (F + 2 ``REACH``, S), as ``_departures`` returns it, the
    lesser of both directions.
    """
    spans, size, score = scored
    alone, alone_size = _alone(paths, departed, usual)
    is_single = (spans[:, 2] - spans[:, 1] == 1) & _is_inside(spans, len(paths))
    doubtful = np.flatnonzero(is_single & (score >= 1.0) & (score < _CERTAIN))
    pop, among = _among_others(signals, np.concatenate([spans[doubtful], alone]))
    explained = doubtful[among[: len(doubtful)] < _EXPLAINED]
    pop, among = pop[len(doubtful) :], among[len(doubtful) :]
    found = (among >= 1.0) & (alone_size >= _SHARE_ALONE * pop)
    turn = np.zeros(len(spans), dtype=np.intp)
    score[explained], turn[explained] = SUSPECTED, -1
    return (
        np.concatenate([spans, alone[found]]),
        np.concatenate([size, alone_size[found]]),
        np.concatenate([score, among[found]]),
        np.concatenate([turn, np.ones(np.count_nonzero(found), dtype=np.intp)]),
    )


def _is_inside(spans: Ints, n_frames: int) -> Bools:
    """Return which spans (P, 3) of one frame have four frames of the take on each side; n_frames: with the padding."""
    return np.asarray((spans[:, 1] >= REACH + 2 * _FEWEST) & (spans[:, 2] <= n_frames - REACH - 2 * _FEWEST))


def _alone(paths: Floats, departed: Floats, usual: Floats) -> tuple[Ints, Floats]:
    """Return excursions of one frame that motion may explain, spans (P, 3) and sizes (P,), for ``_among_others``."""
    frames, columns = np.nonzero(departed >= _LEAST_ALONE)
    spans = np.column_stack([columns, frames, frames + 1])
    spans = spans[_is_inside(spans, len(paths))]
    size, score = scored(paths, spans, 1, usual, True)
    kept = (size >= _LEAST_ALONE) & (score < 1.0)
    return spans[kept], size[kept]


def _among_others(signals: Signals, spans: Ints) -> tuple[Floats, Floats]:
    """Return the sizes and scores (P,) of excursions of one frame, of what the other joints do not explain.

    The threshold is that of all excursions.
    """
    if not len(spans):
        return np.empty(0), np.empty(0)
    rest = unexplained(signals.paths)
    pop, largest, median = np.array([fitted_pop(rest, signal, start - REACH) for signal, start, _ in spans]).T
    usual = usually_unexplained(rest, spans[:, 0])
    return pop, pop / (LEAST + _USUAL * usual + _LARGEST * largest + _MEDIAN * median)


def _padded(paths: Floats) -> Floats:
    """Return paths (F + 2 ``REACH``, S, 4) that go on at constant velocity at both ends."""
    count = np.arange(1, REACH + 1)[:, None, None]
    first, last = paths[1] - paths[0], paths[-1] - paths[-2]
    return np.concatenate([paths[0] - count[::-1] * first, paths, paths[-1] + count * last])


def _squares(vectors: Floats) -> Floats:
    """Return the squared lengths of vectors (..., 4)."""
    return np.asarray(np.einsum("...k,...k->...", vectors, vectors))


def _departures(paths: Floats) -> Floats:
    """Return the distance (F, S) of each frame from what the three frames before it foretell; 0 in the first three.

    The least of three: the path is constant, at constant velocity, or at constant acceleration.
    """
    result = np.zeros(paths.shape[:2])
    steps = np.diff(paths, axis=0)
    second = np.diff(steps, axis=0)
    squares = np.minimum(_squares(steps[2:]), _squares(second[1:]))
    result[3:] = np.sqrt(np.minimum(squares, _squares(np.diff(second, axis=0))))
    return result


def usual_departures(paths: Floats) -> Floats:
    """Return the departure (S,) of paths (F, S, 4) that each signal exceeds in a tenth of its frames, at least in 3."""
    padded = _padded(paths)
    return _usual(np.minimum(_departures(padded), _departures(padded[::-1])[::-1])[REACH:-REACH])


def _usual(departure: Floats) -> Floats:
    """Return the departure (S,) that each signal exceeds in a tenth of its frames (F, S), at least in 3."""
    rank = min(max(_LEAST_USUAL, int(_USUAL_SHARE * len(departure))), len(departure) - 1)
    place = len(departure) - 1 - rank
    return np.asarray(np.partition(departure, place, axis=0)[place])


def _abrupt(departure: Floats, rough: Floats, usual: Floats) -> Bools:
    """Return the frames (F, S) that depart from those before as far as the first frame of an excursion must."""
    # The fourth difference about the frame t - 3 is the last one without the frame t.
    before = np.zeros_like(rough)
    before[3:] = rough[:-3]
    return np.asarray(departure >= SUSPECTED * (LEAST + _USUAL * usual + _LARGEST * before))


def _pairs(starts: Ints, stops: Ints, longest: int) -> Ints:
    """Return all pairs (P, 2) of a start and a later stop that are at most ``longest`` frames apart."""
    first = np.searchsorted(stops, starts, side="right")
    number = np.searchsorted(stops, starts + longest, side="right") - first
    rows = np.repeat(np.arange(len(starts)), number)
    offsets = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    return np.stack([starts[rows], stops[first[rows] + offsets]], axis=1)


def scored(paths: Floats, spans: Ints, n: int, usual: Floats, is_rotation: bool) -> tuple[Floats, Floats]:
    """Return the sizes and scores (P,) of excursions of n frames, rows (signal, start, stop) of spans (P, 3)."""
    signal, start = spans[:, 0], spans[:, 1]
    window = paths[start[:, None] + np.arange(-REACH, n + REACH), signal[:, None]]
    inside = np.arange(REACH, REACH + n)
    if is_rotation:
        # Q and -Q are the same rotation, and half turns into and out of an excursion may change the sign behind it. The
        # frames behind it get the sign nearest to those before it; inside it the path is continuous already.
        changed = np.einsum("pk,pk->p", window[:, REACH + n], window[:, REACH - 1]) < 0
        window[changed, REACH + n :] *= -1.0
    # 1. The path without the excursion: a cubic through two frames on each side, or a line through one.
    cubic, line = _bridges(window, n)
    off = np.sqrt(np.minimum(_squares(window[:, inside] - cubic), _squares(window[:, inside] - line)))
    # 2. Both ends leave the path, and are not foretold by the side they adjoin.
    ends = np.minimum(off[:, 0], off[:, -1])
    departed = np.minimum(_foretold(window[:, : REACH + 1]), _foretold(window[:, : REACH + n - 2 : -1]))
    size = np.minimum(ends, departed)
    # 3. The threshold grows with the fourth differences of the path without the excursion, frames t - 5 to t + 5.
    without = window[:, 1:-1].copy()
    without[:, inside - 1] = cubic
    fourth = _SCALE * np.sqrt(_squares(np.diff(without, n=4, axis=1)))
    threshold = LEAST + _USUAL * usual[signal] + _LARGEST * fourth.max(axis=1) + _MEDIAN * _medians(fourth)
    if n > 1:
        threshold += _longer(window, n, off)
    return size, size / threshold


def _bridges(window: Floats, n: int) -> tuple[Floats, Floats]:
    """Return a cubic and a line (P, n, 4) across the n frames in the middle of a window (P, n + 2 ``REACH``, 4)."""
    at = np.arange(n, dtype=np.float64)
    knots = np.array([-2.0, -1.0, n, n + 1.0])
    frames = window[:, [REACH - 2, REACH - 1, REACH + n, REACH + n + 1]]
    # Lagrange's polynomials: the weight of a knot is the product of (t - k) / (knot - k) over the other knots k.
    weights = np.ones((n, 4))
    for column, knot in enumerate(knots):
        for other in np.delete(knots, column):
            weights[:, column] *= (at - other) / (knot - other)
    share = ((at + 1.0) / (n + 1.0))[:, None]
    line = frames[:, None, 1] + share * (frames[:, 2] - frames[:, 1])[:, None]
    return np.einsum("nk,pkc->pnc", weights, frames), line


def _foretold(frames: Floats) -> Floats:
    """Return the distances (P,) of the last of frames (P, f, 4) from what those before foretell, as ``_departures``."""
    last = frames[:, -4:]
    orders = [_squares(np.diff(last, n=order, axis=1)[:, -1]) for order in (1, 2, 3)]
    return np.sqrt(np.minimum(orders[0], np.minimum(orders[1], orders[2])))


def _medians(values: Floats) -> Floats:
    """Return the median (P,) of each row of values (P, n)."""
    ordered = np.sort(values, axis=1)
    return np.asarray((ordered[:, (values.shape[1] - 1) // 2] + ordered[:, values.shape[1] // 2]) / 2.0)


def _longer(window: Floats, n: int, off: Floats) -> Floats:
    """Return what the threshold (P,) of an excursion of n > 1 frames is higher by.

    off: (P, n) distances from the path. The velocity may change meanwhile, and the excursion must be smooth inside,
    like a part of another path, or rough like noise.
    """
    before = window[:, REACH - 1] - window[:, REACH - 2]
    behind = window[:, REACH + n + 1] - window[:, REACH + n]
    across = (window[:, REACH + n] - window[:, REACH - 1]) / (n + 1.0)
    turn = np.sqrt(np.maximum(_squares(across - before), _squares(across - behind)))
    steps = np.diff(window[:, REACH : REACH + n], axis=1) - across[:, None]
    inside = np.sqrt(np.maximum(_squares(steps[:, 0]), _squares(steps[:, -1])))
    if n > 2:
        inside = np.maximum(inside, np.sqrt(_squares(np.diff(steps, axis=1))).max(axis=1))
    second = np.sqrt(_squares(np.diff(window[:, REACH - 1 : REACH + n + 1], n=2, axis=1)))
    is_noise = (n > 2) & (second.mean(axis=1) >= _ROUGH_INSIDE * off.mean(axis=1))
    return np.asarray(_SLOWING * (turn * (n + 1.0) / 2.0 + np.where(is_noise, 0.0, inside)))


def _chosen(spans: Ints, size: Floats, score: Floats, turn: Ints) -> list[Excursion]:
    """Return the excursions among spans (P, 3) that score enough and do not touch: sure, short and clear ones first.

    turn: (P,), 0 for most. Those that the other joints explain come before all others (-1), so that no longer span
    repairs their frames. Those that only the other joints show come after all others that are sure (1).
    """
    found: dict[int, list[Excursion]] = {}
    order = np.lexsort((spans[:, 1], -score, spans[:, 2] - spans[:, 1], turn, score < 1.0, turn >= 0))
    for row in order[score[order] >= SUSPECTED]:
        signal, start, stop = int(spans[row, 0]), int(spans[row, 1]) - REACH, int(spans[row, 2]) - REACH
        others = found.setdefault(signal, [])
        # Frames right beside an excursion are measured from it, and are none themselves.
        if all(stop < other.start or start > other.stop for other in others):
            others.append(Excursion(signal, start, stop, float(size[row]), float(score[row])))
    return [excursion for others in found.values() for excursion in others]
