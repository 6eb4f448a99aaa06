"""Choose the frames for one gap: training frames, test windows, and the samples beside it that its residual is carried
from.

A limited number of frames is chosen evenly over the take, so that the cost of a regression does not grow with the take.
Where the frames or the windows of the take are too few, others come from its session: other takes of the same subject.
"""

from collections.abc import Callable

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints

REFERENCE_RATE = 120.0  # Hz, the frame rate at which the constants that count frames are given

# The constants below were chosen by hand on the captures of `mocapclean bench markers`; no sweep was kept.
ADJACENT_STEPS = (1, 2, 3, 5, 8, 13)
"""Samples on each side of a gap that it is bridged from, counted from its edge at 120 Hz.

Eight, up to the 34th, were 0.7 % less accurate on the first half of the takes of ``mocapclean bench markers``.
"""
MIN_TRAINING = 10  # frames; with fewer known samples of the marker, a gap is not filled
MAX_TRAINING_SHARE = 0.7  # of the known frames, used for training where too few frames are complete
INCOMPLETE_TRAINING = 0.05  # mean share of missing neighbours above which training frames call for further passes
MAX_WINDOW_MISSING = 0.1  # share of missing neighbours up to which any window is used
MIN_CANDIDATES = 2  # times the window length, candidate windows that are kept at least, those that lack least
MIN_WINDOWS = 3  # windows; where fewer fit, their length is halved
SHORTEST_ALIKE = 4  # part of a gap's length, the shortest windows that are sought to resemble it; chosen by hand
WINDOW_SPACING = 0.3  # of the window length, the least distance between the first frames of two windows
MIN_WINDOW_SPACING = 5  # frames, the same where windows are short
SESSION_SHARE = 2
"""Frames of the session that are learnt from for each frame that the take lacks, up to the limit of the take's own.

Chosen on half of the takes of ``benchmarks/session.py``: 1 and 4 had errors larger by up to 2 %. A fixed number made
takes of 1,500 frames worse.
"""
MAX_INSIDE = 6  # frames of a window in which the error is measured; reduced from ten to save time


def spread_out(candidates: Ints, most: int, min_distance: int) -> Ints:
    """Return up to ``most`` of the sorted candidates, evenly chosen, each at least ``min_distance`` after the last."""
    if not len(candidates) or most < 1:
        return candidates[:0]
    picked = candidates[np.unique(np.round(np.linspace(0, len(candidates) - 1, most)).astype(np.intp))]
    if min_distance <= 1:
        return np.asarray(picked)
    kept = [picked[0]]
    for candidate in picked[1:]:
        if candidate >= kept[-1] + min_distance:
            kept.append(candidate)
    return np.array(kept, dtype=np.intp)


def adjacent_steps(rate: float) -> Ints:
    """Return the ranks, counted from the edge of a gap, of the samples beside it that are used: dense near it, sparse
    far away.
    """
    frames = np.round(np.array(ADJACENT_STEPS) * rate / REFERENCE_RATE)
    return np.unique(np.maximum(frames, 1.0).astype(np.intp))


def adjacent_frames(usable: Bools, start: int, stop: int, reach: int, rate: float) -> tuple[Ints, Ints]:
    """Return the frames before and after a gap, nearest first, whose samples the gap is bridged from.

    usable: (F,) samples of the marker that may serve. reach: frames searched on each side. Only usable samples are
    counted by ``adjacent_steps``.
    """
    before = np.flatnonzero(usable[max(0, start - reach) : start][::-1])
    after = np.flatnonzero(usable[stop : stop + reach])
    picked = adjacent_steps(rate) - 1
    return start - 1 - before[picked[picked < len(before)]], stop + after[picked[picked < len(after)]]


def window_offsets(length: int, rate: float, before: bool, after: bool) -> tuple[Ints, Ints]:
    """Return up to 6 evenly spaced test frames inside a window and the adjacent samples, counted from its first frame.

    before, after: whether adjacent frames are used on that side.
    """
    inside = np.unique(np.round(np.linspace(0, length - 1, min(length, MAX_INSIDE))).astype(np.intp))
    adjacent = [-adjacent_steps(rate)[::-1]] * before + [length - 1 + adjacent_steps(rate)] * after
    return inside, np.concatenate([*adjacent, np.zeros(0, dtype=np.intp)]).astype(np.intp)


def training_frames(known: Bools, missing_share: Floats, most: int) -> tuple[Ints, bool]:
    """Return up to ``most`` frames to learn from, and whether these lack so many neighbours that later passes may help.

    known: (F,) whether the marker is known. missing_share: (F,) the share of its neighbours that is missing, by weight.
    """
    frames = np.flatnonzero(known)
    training = frames[missing_share[frames] <= 0.0]
    incomplete = False
    if len(training) < min(most, len(frames) / 2):
        # Too few complete frames: take those that lack least.
        by_missing = frames[np.argsort(missing_share[frames], kind="stable")]
        training = np.sort(by_missing[: max(int(MAX_TRAINING_SHARE * len(frames)), MIN_TRAINING)])
        incomplete = bool(missing_share[training].mean() > INCOMPLETE_TRAINING)
    return spread_out(training, most, 1), incomplete


def session_frames(usable: Bools, n_own: int, most: int) -> Ints:
    """Return the frames of the session, evenly chosen, to learn from beside ``n_own`` frames of the take.

    usable: (S,) in which the marker and all its neighbours are known. most: the limit of the take's own frames.
    """
    return spread_out(np.flatnonzero(usable), min(SESSION_SHARE * (most - n_own), most), 1)


def window_starts(
    known: Bools,
    missing_share: Floats,
    length: int,
    n_windows: int,
    edges: tuple[int, int],
    n_own: int,
    alike: Callable[[Ints, int], Bools] | None = None,
) -> tuple[Ints, int]:
    """Return the first frames of up to ``n_windows`` windows in known stretches, and their length, halved until enough
    fit.

    known and missing_share (F,) are those of ``training_frames``, of the take in the first ``n_own`` frames, then of
    its session, where windows are sought that the take lacks. A window is a stretch in which the marker is known,
    together with ``edges`` frames before and after it. alike: which windows, of first frames (n,) and a length,
    resemble the gap; only these are used, unless too few of a quarter of the length do.
    """
    wanted, shortest = length, length // SHORTEST_ALIKE if alike else 1
    starts = np.zeros(0, dtype=np.intp)
    while n_windows and length >= max(shortest, 1):
        starts = _starts_of_length(known, missing_share, length, n_windows, edges, (0, n_own), alike)
        if n_own < len(known):
            lacking, session = n_windows - len(starts), (n_own, len(known))
            others = _starts_of_length(known, missing_share, length, lacking, edges, session, alike)
            starts = np.append(starts, others)
        if len(starts) >= MIN_WINDOWS:
            break
        length //= 2
    if alike and len(starts) < MIN_WINDOWS:
        return window_starts(known, missing_share, wanted, n_windows, edges, n_own)
    return starts, max(length, 1)


def _starts_of_length(
    known: Bools,
    missing_share: Floats,
    length: int,
    n_windows: int,
    edges: tuple[int, int],
    span: tuple[int, int],
    alike: Callable[[Ints, int], Bools] | None,
) -> Ints:
    """Return the first frames of up to ``n_windows`` windows of one length, which lie with their edges in a span of
    frames (start, stop); the other arguments are those of the caller.
    """
    before, after = edges
    # Prefix sums: entry b less entry a is the sum over the frames a to b - 1.
    unknown, missing = np.append(0, np.cumsum(~known)), np.append(0.0, np.cumsum(missing_share))
    candidates = np.arange(span[0] + before, span[1] - length - after + 1)
    starts = candidates[unknown[candidates + length + after] == unknown[candidates - before]]
    if alike:
        starts = starts[alike(starts, length)]
    if len(starts):
        # Drop the windows that lack many neighbours, unless too few would be left.
        mean = (missing[starts + length] - missing[starts]) / length
        rank = min(MIN_CANDIDATES * length, len(starts)) - 1
        starts = starts[mean <= max(MAX_WINDOW_MISSING, np.partition(mean, rank)[rank])]
    return spread_out(starts, n_windows, max(int(WINDOW_SPACING * length), MIN_WINDOW_SPACING))
