"""What a method gets wrong on this very take: hide trusted samples as the real ones are lost, fill them, compare.

Hidden is the take's own pattern of gaps, moved in time: the same markers, the same lengths, and what was lost together
is hidden together. Gaps inside the take are shifted by a common number of frames, around its end if need be; gaps at
one end go to the other end. A gap is hidden only where its marker is trusted all along and ``MARGIN`` frames beyond, so
that it joins no other gap; of several shifts that one is taken which loses and meets the fewest gaps.
All that is really missing stays missing while the method fills what is hidden. Nothing is drawn at random: the same
take gives the same answer.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass as plain_dataclass
from dataclasses import field, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.evaluation import metrics
from mocapclean.evaluation.metrics import Error
from mocapclean.parameters import STRICT, About
from mocapclean.take import Solution, Take

Gaps = NDArray[np.intp]
"""Gaps as rows (marker, start, stop), half open."""

MARGIN = 2
SHIFTS = 24
COPIES = 8
WINDOWS = 16
GOLDEN = (5**0.5 - 1) / 2  # its multiples, less their whole parts, are spread evenly however many are taken


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """How much is hidden: as many samples as are really lost, within limits."""

    rounds: Annotated[
        int, Field(ge=1, le=100), About(symbol="k", text="times that other samples are hidden and filled")
    ] = 1
    least: Annotated[
        float, Field(ge=0, le=0.2), About(symbol="α", text="share of trusted samples to hide at least")
    ] = 0.01
    most: Annotated[float, Field(ge=0, le=0.2), About(symbol="β", text="share of trusted samples to hide at most")] = (
        0.05
    )
    gaps: Annotated[
        int, Field(ge=1), About(symbol="n", text="gaps of mean length that hold the most samples to hide")
    ] = 80


@plain_dataclass(frozen=True, kw_only=True)
class Check:
    """Hidden gaps and the samples in them; the error of those that were filled; covered: the share of their
    coordinates within the method's own 90 % intervals, or None if it gives none.
    """

    gaps: int = 0
    samples: int = 0
    error: Error | None = None
    covered: float | None = None


@plain_dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """What a method got wrong on hidden samples of the take itself, in all and by length of gap.

    because: why there is no answer, or "".
    """

    rounds: int = 0
    total: Check = Check()
    by_length: Mapping[str, Check] = field(default_factory=dict)
    because: str = ""


def check(
    take: Take,
    wanted: Bools,
    solve: Callable[[Take, Bools], Solution],
    params: Params,
    leave: Callable[[float | None], bool] = lambda expected: False,
) -> SelfCheck:
    """The errors of a method on trusted samples of the take that it was not shown.

    wanted: (F, M) the samples whose gaps are to be imitated. solve: the method, asked for the gaps of
    samples (F, M). leave: whether a gap of this expected 3D error, mm, would be left unfilled. Where nothing can be
    hidden, the answer says why. Raises what solve raises.
    """
    pattern = _pattern(take, wanted)
    found: list[_Trial] = []
    for turn in range(params.rounds):
        hidden = hide(take, wanted, params, turn)
        if not hidden.any():
            break
        solution = solve(replace(take, trusted=take.trusted & ~hidden), hidden)
        found += _trials(take, hidden, solution, leave)
    if not found:
        reason = f"none of the {len(pattern)} gaps fits where its marker is trusted"
        return SelfCheck(because=reason if len(pattern) else "there is no gap to fill of a marker that is seen")
    return SelfCheck(rounds=params.rounds, total=_pooled(found), by_length=_by_length(pattern, found))


def hide(take: Take, wanted: Bools, params: Params, turn: int = 0) -> Bools:
    """Trusted samples (F, M) to hide; another turn hides others."""
    pattern = _pattern(take, wanted)
    room = _room(take, pattern, params)
    hidden = np.zeros_like(take.trusted)
    ends, *copies = _copies(pattern, len(hidden), turn)
    for k in range(COPIES):
        gaps = _best([ends] if k == 0 else copies, ~take.trusted | hidden)
        for marker, start, stop in _portion(gaps, room, len(hidden), whole=not hidden.any()):
            hidden[start:stop, marker] = True
    return hidden


def _pattern(take: Take, wanted: Bools) -> Gaps:
    """The real gaps that are to be filled, of markers that are trusted somewhere."""
    seen: Bools = np.asarray(take.trusted.any(axis=0))
    gaps = [gap for gap in column_runs(~take.trusted) if seen[gap[0]] and wanted[gap[1], gap[0]]]
    return np.array(gaps, dtype=np.intp).reshape(-1, 3)


def _room(take: Take, pattern: Gaps, params: Params) -> Floats:
    """How many samples to hide in gaps of each class of length: of all that are hidden, its share of the real loss."""
    lost = np.bincount(_classes(pattern), _lengths(pattern), minlength=len(metrics.LENGTH_CLASSES) + 1)
    n_trusted, n_lost = take.trusted.sum(), lost.sum()
    most = min(params.most * n_trusted, params.gaps * n_lost / max(len(pattern), 1))
    goal = min(max(n_lost, params.least * n_trusted), most)
    return np.asarray(goal * lost / max(n_lost, 1))


def _classes(gaps: Gaps) -> NDArray[np.intp]:
    return np.asarray(np.searchsorted(metrics.LENGTH_CLASSES, _lengths(gaps)), dtype=np.intp)


def _lengths(gaps: Gaps) -> NDArray[np.intp]:
    return np.asarray(gaps[:, 2] - gaps[:, 1])


def _copies(pattern: Gaps, n_frames: int, turn: int) -> Iterator[Gaps]:
    """The gaps at the ends of the take at the other end; then all others, as each shift places them."""
    at_end = (pattern[:, 1] == 0) | (pattern[:, 2] == n_frames)
    marker, start, stop = pattern[at_end].T
    yield np.column_stack([marker, n_frames - stop, n_frames - start])
    marker, start, stop = pattern[~at_end].T
    for k in range(turn * SHIFTS, (turn + 1) * SHIFTS):
        first = (start + int(n_frames * ((k + 1) * GOLDEN % 1.0))) % n_frames
        last = first + stop - start
        inside = (first >= MARGIN) & (last + MARGIN <= n_frames)
        yield np.column_stack([marker, first, last])[inside]


def _best(copies: Sequence[Gaps], taken: Bools) -> Gaps:
    """The gaps of one copy that have no taken sample (F, M) in them or within the margin: of the copy with the most.

    Samples in frames in which nothing is taken count twice.
    """
    before = np.concatenate([np.zeros_like(taken[:1], dtype=np.intp), taken.cumsum(axis=0)])
    calm = np.concatenate([[0], (~taken.any(axis=1)).cumsum()])

    def free(gaps: Gaps) -> Gaps:
        marker, low, high = gaps[:, 0], np.maximum(gaps[:, 1] - MARGIN, 0), np.minimum(gaps[:, 2] + MARGIN, len(taken))
        untaken: Gaps = gaps[before[high, marker] == before[low, marker]]
        return untaken

    return max(map(free, copies), key=lambda gaps: (_lengths(gaps) + calm[gaps[:, 2]] - calm[gaps[:, 1]]).sum())


def _portion(gaps: Gaps, room: Floats, n_frames: int, *, whole: bool) -> Iterator[Gaps]:
    """Gaps while there is room for their class of length; those of one stretch of time together, the stretches spread.

    room: samples for each class, taken up as gaps are; the last gap may be larger. whole: have the first stretch even
    without room, so that what was lost together stays so.
    """
    window, classes = gaps[:, 1] * WINDOWS // n_frames, _classes(gaps)
    order = np.lexsort((gaps[:, 1], (window + 1) * GOLDEN % 1.0))
    for k in order:
        if room[classes[k]] > 0 or (whole and window[k] == window[order[0]]):
            room[classes[k]] -= gaps[k, 2] - gaps[k, 1]
            yield gaps[k]


class _Trial(NamedTuple):
    """A hidden gap: its length, and the misses (n, 3) and sd (n,) of what was filled of it, mm."""

    length: int
    misses: Floats
    sd: Floats | None


def _trials(take: Take, hidden: Bools, solution: Solution, leave: Callable[[float | None], bool]) -> Iterator[_Trial]:
    for marker, start, stop in column_runs(hidden):
        span = (slice(start, stop), marker)
        filled = solution.filled[span]
        sd = None if solution.sd is None else solution.sd[span][filled]
        kept = slice(0) if sd is not None and leave(metrics.expected_error(sd)) else slice(None)
        misses = (solution.positions[span] - take.positions[span])[filled]
        yield _Trial(stop - start, misses[kept], None if sd is None else sd[kept])


def _pooled(trials: Sequence[_Trial]) -> Check:
    misses = np.concatenate([trial.misses for trial in trials])
    known = [trial.sd for trial in trials if trial.sd is not None]
    return Check(
        gaps=len(trials),
        samples=sum(trial.length for trial in trials),
        error=metrics.error(np.zeros_like(misses), misses, np.ones(len(misses), dtype=bool)),
        covered=metrics.coverage(misses, np.concatenate(known)) if known else None,
    )


def _by_length(pattern: Gaps, trials: Sequence[_Trial]) -> dict[str, Check]:
    """One entry for each class that the real gaps have, also where no gap of it was hidden."""
    names = [name for name, _ in metrics.by_length(_lengths(pattern).tolist())]
    classes = {name: [trials[k] for k in members] for name, members in metrics.by_length([t.length for t in trials])}
    return {name: _pooled(classes[name]) if name in classes else Check() for name in names}
