"""Find pops in the first and last two frames of a take, where the path is known on one side alone or hardly on both.

A first frame that is far from where the next ones lead back to is a pop if no more than a few joints are: a take may
begin in another pose, and then the whole body jumps. A root at exactly 0, 0, 0 in the first or last frames is one that
the solver did not find.
"""

import numpy as np

from mocapclean.arrays import Floats, Ints, runs
from mocapclean.detection.joints.pops import REACH, SUSPECTED, Excursion, scored, usual_departures
from mocapclean.detection.joints.signals import Signals

_FEWEST = 3 * REACH
"""Frames of the shortest take whose ends are judged. Chosen by hand."""
_ONE_SIDED, _BY_ONE_FRAME = 3.0, 1.5
"""Times the threshold of other pops that a pop has to leave its path by, if the path is known on one side, and if one
frame shows the other side. Chosen on clean takes at even places that were cut at random frames."""
_SPANS = ((0, 1), (0, 2), (1, 2))
"""Frames of a pop, half open, counted from the end of the take."""


def find_at_ends(signals: Signals, longest: int) -> list[Excursion]:
    """Return the excursions at both ends that score at least ``SUSPECTED``, at most one for each signal and end.

    longest: frames of zeros of a translation that are one excursion at most.
    """
    n_frames, n_signals = signals.known.shape
    if n_frames < max(_FEWEST, longest + 2 * REACH) or not n_signals:
        return []
    usual = usual_departures(signals.paths)
    first = _at_start(signals.paths, signals.part == "rotation", usual, longest)
    last = _at_start(signals.paths[::-1], signals.part == "rotation", usual, longest)
    turned = [Excursion(one.signal, n_frames - one.stop, n_frames - one.start, one.size, one.score) for one in last]
    return first + turned


def _at_start(paths: Floats, is_rotation: bool, usual: Floats, longest: int) -> list[Excursion]:
    """Return the excursions in the first frames of paths (F, S, 4), the clearest of each signal."""
    best: dict[int, Excursion] = {}
    everywhere = np.arange(paths.shape[1])
    spans = [(start, stop, everywhere) for start, stop in _SPANS]
    if not is_rotation:
        spans += _zeros(paths[:longest])
    for start, stop, columns in spans:
        window = _led_back(paths[: stop + REACH, columns], start, stop)
        rows = np.column_stack([np.arange(len(columns)), *(np.full(len(columns), REACH + at) for at in (start, stop))])
        size, score = scored(window, rows, stop - start, usual[columns], is_rotation)
        is_zero = not is_rotation and not paths[:stop, columns].any()
        if not is_zero:
            score = score / (_ONE_SIDED if start == 0 else _BY_ONE_FRAME)
        for row in np.flatnonzero(score >= SUSPECTED):
            found = Excursion(int(columns[row]), start, stop, float(size[row]), float(score[row]))
            if found.signal not in best or found.score > best[found.signal].score:
                best[found.signal] = found
    return list(best.values())


def _zeros(paths: Floats) -> list[tuple[int, int, Ints]]:
    """Return the spans at the start of paths (F, S, 4) in which signals are zero: (start, stop, the signal)."""
    found = []
    for signal in range(paths.shape[1]):
        zero = np.asarray(~paths[:, signal].any(axis=1))
        if zero[0] and not zero.all():
            found.append((0, int(runs(zero)[0, 1]), np.array([signal])))
    return found


def _led_back(paths: Floats, start: int, stop: int) -> Floats:
    """Return paths (``REACH`` + F, S, 4) with frames before the first one that the frames without a pop lead back to.

    The pop is in frames start to stop. They lie on a straight line through the first two frames that are not in it.
    """
    first, second = (stop, stop + 1) if start == 0 else (start - 1, stop)
    velocity = (paths[second] - paths[first]) / (second - first)
    since = np.arange(-REACH, start if start == 0 else 0)[:, None, None] - first
    return np.concatenate([paths[first] + since * velocity, paths])
