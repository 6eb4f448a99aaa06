"""Choose the gaps that the bench of harm hides: of single markers, neighbours, props, inside a take and at its ends."""

from collections.abc import Callable, Sequence

import numpy as np

from mocapclean.arrays import Bools, Ints
from mocapclean.geometry.distances import rigidity
from mocapclean.simulate.variations import UNCHANGED
from mocapclean.take import Take

_SINGLES = 6  # single markers with a gap in one trial; chosen for speed
_GROUPS = 2  # groups of neighbours with a gap in one trial; chosen for speed
_NEIGHBOURS = 2  # markers that are hidden with their most rigid one
_TIMES = 3  # gaps of a prop in one trial; chosen for speed
_AT_ENDS = 2  # markers with a gap at the first frame, and at the last
_MOST_TRIES = 100  # random places that are tried for a gap


def _hide_inside(take: Take, hidden: Bools, columns: Sequence[int], length: int, rng: np.random.Generator) -> None:
    """Hide a gap of some columns at one random time, with a known sample before and after; nothing if none is free."""
    known = take.trusted & ~hidden
    for _ in range(_MOST_TRIES):
        start = int(rng.integers(1, len(known) - length))
        if known[start - 1 : start + length + 1, columns].all():
            hidden[start : start + length, columns] = True
            return


def _hide_at_end(take: Take, hidden: Bools, columns: Sequence[int], length: int, last: bool) -> None:
    """Hide the first or last frames of some columns if they and the next sample are known."""
    known = take.trusted & ~hidden
    end, beside = (slice(-length, None), -length - 1) if last else (slice(0, length), length)
    if known[end, columns].all() and known[beside, columns].all():
        hidden[end, columns] = True


def _single(take: Take, added: Ints, length: int, rng: np.random.Generator) -> Bools:
    """Return hidden gaps (F, M) of single markers, each at a time of its own."""
    hidden = np.zeros_like(take.trusted)
    for marker in rng.permutation(len(take.markers))[:_SINGLES]:
        _hide_inside(take, hidden, [int(marker)], length, rng)
    return hidden


def _together(take: Take, added: Ints, length: int, rng: np.random.Generator) -> Bools:
    """Return hidden gaps (F, M) of markers that are lost together with their two most rigid partners."""
    hidden = np.zeros_like(take.trusted)
    rigid = rigidity(take.positions, take.trusted)
    for marker in rng.permutation(len(take.markers))[:_GROUPS]:
        partners = rigid.partners(int(marker))[0][:_NEIGHBOURS]
        _hide_inside(take, hidden, [int(marker), *map(int, partners)], length, rng)
    return hidden


def _ends(take: Take, added: Ints, length: int, rng: np.random.Generator) -> Bools:
    """Return hidden gaps (F, M) of two markers in the first frames, and of two others in the last."""
    hidden = np.zeros_like(take.trusted)
    for place, marker in enumerate(rng.permutation(len(take.markers))[: 2 * _AT_ENDS]):
        _hide_at_end(take, hidden, [int(marker)], length, last=place % 2 == 0)
    return hidden


def _added(take: Take, added: Ints, length: int, rng: np.random.Generator) -> Bools:
    """Return hidden gaps (F, M) of all added markers together, at three times."""
    hidden = np.zeros_like(take.trusted)
    for _ in range(_TIMES):
        _hide_inside(take, hidden, added.tolist(), length, rng)
    return hidden


def _added_at_ends(take: Take, added: Ints, length: int, rng: np.random.Generator) -> Bools:
    """Return hidden gaps (F, M) of all added markers together, in the first and in the last frames."""
    hidden = np.zeros_like(take.trusted)
    for last in (False, True):
        _hide_at_end(take, hidden, added.tolist(), length, last)
    return hidden


Choice = Callable[[Take, Ints, int, np.random.Generator], Bools]
"""A function of a take, its added columns, the length of a gap and random numbers, which returns hidden gaps (F, M)."""

GAPS: dict[str, tuple[str, Choice]] = {
    "single markers": (UNCHANGED, _single),
    "three together": (UNCHANGED, _together),
    "at the ends": (UNCHANGED, _ends),
    "still marker": ("still marker", _added),
    "still marker, ends": ("still marker", _added_at_ends),
    "box, all markers": ("box at rest", _added),
    "box, ends": ("box at rest", _added_at_ends),
    "cup": ("cup moved once", _added),
    "ball": ("ball thrown", _added),
    "subject copied": ("two subjects", _single),
}
"""The kinds of hidden gaps: the variation of the take, and the choice of the gaps in it."""
