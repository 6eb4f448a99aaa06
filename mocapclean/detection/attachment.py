"""Attachment: which markers move with others, so that a rule about segments can judge them.

A floor marker beside a walker, a ball, a resting prop or a computed point has no segment among the other markers. A
regression on them still fits it in the frames that it was learnt from. It is therefore tried on frames that it was not
learnt from, against the guess that the marker stays, or moves on as it did.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.prediction import carried, predict
from mocapclean.detection.steps import SLIDE_SECONDS
from mocapclean.detection.stillness import resting, still_samples
from mocapclean.geometry.distances import Rigidity
from mocapclean.numerics import interpolation
from mocapclean.numerics.robust import median

# Chosen by hand on takes of `bench trust`; no half was kept apart, and no sweep. Markers of a body have
# ratios of 0.0 to 0.6 there, still markers and computed points of 0.8 and more.
_BLOCKS = 5  # blocks of a marker's samples; each is predicted from what the others teach
_WINDOW_SECONDS = 0.5  # s, time over which the change of a position is predicted
_WINDOW_BLOCKS = 2  # windows, at least, that fit into a block
_VELOCITY_SHARE = 0.2  # share of the window before it over which the velocity is taken
_FEWEST_FRAMES = 600  # frames, at least, that remain of a take of which only every few are used; chosen for speed
_LEAST_RATE = 30.0  # Hz, least rate of these frames
_CLEARLY = 0.5  # share of the mean error of the guess that shows a segment where the median does not
_CARRIED = 0.5  # share of the median error of the guess that shows one without a regression: no other marker reaches it


def attached(positions: Floats, trusted: Bools, rigid: Rigidity, rate: float) -> Bools:
    """Return the markers (M,) whose motion the other markers predict, from positions (F, M, 3) and trust (F, M).

    For each window of half a second, the error of the predicted change of position is compared with that of a guess:
    no change, or the velocity before the window, whichever is nearer. The prediction must have the smaller median, or
    less than half of the mean. A change does not depend on where in its segment a marker sits.

    Most markers need no regression: their segment carries them. A fixed place in it predicts their changes with less
    than half of the median error of the guess, and less than the mean. Only the others are predicted.

    Faults must not hide a segment. Samples that repeat the one before are left out, unless the marker rests in half of
    them. A marker that fails is tried again without the best step of its place among the others.
    """
    still = still_samples(positions, trusted)
    judged = trusted & ~(still & ~resting(still, trusted))
    # Every few frames are enough for windows of half a second.
    thinned = max(1, min(len(judged) // _FEWEST_FRAMES, int(rate / _LEAST_RATE)))
    positions, judged, rate = positions[::thinned], judged[::thinned], rate / thinned
    filled = interpolation.linear(positions, judged)
    found = _are_carried(filled, judged, rigid, rate)
    found |= _are_attached(filled, judged, rigid, rate, ~found)
    left = ~found & (judged.sum(axis=0) > 0)
    if not left.any():
        return found
    slide = round(SLIDE_SECONDS * rate)
    stepped = predict(filled, judged, rigid, slide=slide, only=left, screened=False)
    for step in stepped.steps:
        filled[step.start :, step.marker] -= stepped.rotation[step.start :, step.marker] @ step.offset
    return found | _are_attached(filled, judged, rigid, rate, left)


def _are_carried(filled: Floats, judged: Bools, rigid: Rigidity, rate: float) -> Bools:
    """Return which markers (M,) their segments carry, by their judged samples (F, M) of positions (F, M, 3)."""
    block, residual = _blocks(judged), filled - carried(filled, judged, rigid)
    residual[~judged] = np.nan
    carried_on = np.zeros(judged.shape[1], dtype=bool)
    for m in range(judged.shape[1]):
        error, guessed = _errors(filled[:, m], residual[:, m], block[:, m], rate)
        if len(error):
            carried_on[m] = median(error) < _CARRIED * median(guessed) and error.mean() < guessed.mean()
    return carried_on


def _are_attached(filled: Floats, judged: Bools, rigid: Rigidity, rate: float, only: Bools) -> Bools:
    """Return which of some markers (M,) are attached, by their judged samples (F, M) of positions (F, M, 3)."""
    if not only.any():
        return only
    block = _blocks(judged)
    # Samples as predicted by regressions that were learnt from the other blocks.
    residual = np.full(filled.shape, np.nan)
    for index in range(_BLOCKS):
        left_out = judged & (block == index)
        prediction = predict(filled, judged & ~left_out, rigid, only=only)
        known = left_out & prediction.predicted
        residual[known] = (filled - prediction.positions)[known]
    attached = np.zeros_like(only)
    for m in np.flatnonzero(only).tolist():
        error, guessed = _errors(filled[:, m], residual[:, m], block[:, m], rate)
        if len(error):
            attached[m] = median(error) < median(guessed) or error.mean() < _CLEARLY * guessed.mean()
    return attached


def _blocks(trusted: Bools) -> Ints:
    """Return the block (F, M) of each trusted sample, from 0 on, of about equal size for each marker; -1 elsewhere."""
    rank, number = np.cumsum(trusted, axis=0) - 1, np.maximum(trusted.sum(axis=0), 1)
    return np.where(trusted, _BLOCKS * rank // number, -1)


def _errors(path: Floats, residual: Floats, block: Ints, rate: float) -> tuple[Floats, Floats]:
    """Return the errors (n,) of one marker's predicted and of its guessed changes, mm, over all windows.

    path, residual: (F, 3) mm, the residual NaN where it does not count. block: (F,).
    """
    size = int(np.count_nonzero(block >= 0)) // _BLOCKS
    length = max(1, min(round(_WINDOW_SECONDS * rate), size // _WINDOW_BLOCKS))
    before = max(1, round(_VELOCITY_SHARE * length))
    start = np.arange(before, len(path) - length)
    end = start + length
    # Windows that lie in one block, with a known velocity before them.
    seen = (block[start] == block[end]) & (block[start - before] >= 0) & np.isfinite(residual[start, 0])
    start, end = start[seen], end[seen]
    error = np.linalg.norm(residual[end] - residual[start], axis=1)
    change = path[end] - path[start]
    moved_on = (path[start] - path[start - before]) * (length / before)
    return error, np.minimum(np.linalg.norm(change, axis=1), np.linalg.norm(change - moved_on, axis=1))
