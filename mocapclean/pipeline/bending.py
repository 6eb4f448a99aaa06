"""Find the filled gaps that make the distances of rigid pairs of markers worse than they were."""

import numpy as np

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.take import Take
from mocapclean.take.bones import rigid_pairs

_LARGEST_RATIO = 1.5
"""Times the RMS deviation of a pair's distance before the fill, up to which that after the fill is accepted.

Chosen by hand together with ``_LARGEST_RISE``, no sweep was kept.
"""
_LARGEST_RISE = 5.0
"""mm, by which the RMS deviation of a pair's distance may rise in any case: the width of a marker, by hand."""


def bending(before: Take, after: Take) -> Bools:
    """Return the filled samples (F, M) without which no rigid pair deviates more than is accepted.

    Of each pair, the runs of filled frames with the largest mean square deviation are returned, as few as are needed.
    The RMS deviation of what remains is at most 1.5 times that of the trusted frames, or 5 mm more.

    before: the take with its gaps. after: the same take with filled samples.
    """
    bent = np.zeros_like(after.filled)
    seen = before.trusted | after.filled
    columns = {name: column for column, name in enumerate(before.markers)}
    for pair in rigid_pairs(before):
        ends = [columns[pair.start], columns[pair.end]]
        distance = np.linalg.norm(after.positions[:, ends[0]] - after.positions[:, ends[1]], axis=1)
        squares = np.square(distance - pair.length)
        trusted = before.trusted[:, ends[0]] & before.trusted[:, ends[1]]
        rms = float(squares[trusted].mean() ** 0.5)
        known = seen[:, ends[0]] & seen[:, ends[1]]
        for start, stop in _worst_runs(
            squares, known, known & ~trusted, max(_LARGEST_RATIO * rms, rms + _LARGEST_RISE)
        ):
            bent[start:stop, ends] |= after.filled[start:stop, ends]
    return bent


def _worst_runs(squares: Floats, known: Bools, filled: Bools, limit: float) -> list[tuple[int, int]]:
    """Return the fewest runs of filled frames (F,), worst mean first, without which the RMS is at most ``limit``.

    squares: (F,) squared deviations, read where they are known (F,).
    """
    spans = runs(filled)
    sums = np.array([squares[start:stop].sum() for start, stop in spans])
    counts = spans[:, 1] - spans[:, 0]
    order = np.argsort(-sums / counts, kind="stable")
    # What remains without the k worst runs, for k = 0, 1, ...
    total = squares[known].sum() - np.append(0.0, np.cumsum(sums[order]))
    frames = known.sum() - np.append(0, np.cumsum(counts[order]))
    needed = int(np.argmax(total <= limit**2 * frames))
    return [(int(start), int(stop)) for start, stop in spans[order[:needed]]]
