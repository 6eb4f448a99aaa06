"""The error of a method on trusted samples of the take itself, hidden in the pattern of its real gaps.

The real gaps are copied to other times: the same markers, the same lengths, and gaps that overlap in time still do.
Gaps inside the take are shifted by a common number of frames, modulo its length; gaps at one end move to the other end.
A copy is hidden only where its marker is trusted, and ``MARGIN`` frames beyond, so that it does not join another gap.
Of several shifts the one is used that keeps most gaps, away from other gaps. The real gaps stay missing while the
method fills the hidden ones; a method that goes gap by gap begins with its fill of the real ones. Nothing is random:
the same take always has the same result.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.evaluation import metrics
from mocapclean.evaluation.metrics import Error
from mocapclean.geometry.distances import exact_pairs, mean_distances
from mocapclean.parameters import About, Field, parameters
from mocapclean.take import Solution, Take

Gaps = NDArray[np.intp]
"""Gaps as rows (marker, start, stop), half open."""

MARGIN = 2  # frames between a hidden gap and the next gap or the end of the take; chosen by hand
SHIFTS = 24  # shifts that are compared for one copy of the pattern; chosen by hand, no sweep was kept
COPIES = 8  # most copies of the pattern that are hidden, the first of gaps at the ends; chosen by hand
SEGMENTS = 16  # parts of equal length that a take is divided into, to spread the hidden gaps over it; chosen by hand
EXACT_SD = 0.01  # mm, SD of a distance below which one point follows another exactly; as in `mocapclean bench markers`
DISTANCE_FRAMES = 600  # most frames from which the SD of a distance is computed; as there
# The fractional parts of its multiples are evenly spread over 0 to 1 for any number of them (the golden ratio less 1).
GOLDEN_RATIO = (5**0.5 - 1) / 2


@parameters
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
        int, Field(ge=1), About(symbol="n", text="hide at most the samples of this many gaps of mean length")
    ] = 40


@dataclass(frozen=True, kw_only=True)
class HiddenGaps:
    """The result of a method on hidden gaps.

    missing: samples of the real gaps that these stand for. gaps, samples: the number of hidden gaps, and that of the
    samples in them. error: over the samples that were filled; None without any. covered: the share of their coordinates
    within the method's own 90 % intervals; None without intervals. expected: the 3D error, mm, that the method expects
    of these samples; None without error bars. factor: how many times wider the error bars of the real gaps are made
    than the method gives them, at least 1.
    """

    missing: int = 0
    gaps: int = 0
    samples: int = 0
    error: Error | None = None
    covered: float | None = None
    expected: float | None = None
    factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """The errors of a method on hidden samples of a take: in total, and by length of gap.

    represented: the share of the real missing samples whose length class was measured; the total stands for these only.
    ``by_length`` has every class that the real gaps have, also those of which nothing could be hidden. because: the
    reason where nothing was measured, or "".
    """

    rounds: int = 0
    represented: float = 0.0
    total: HiddenGaps = HiddenGaps()
    by_length: Mapping[str, HiddenGaps] = field(default_factory=dict)
    because: str = ""


def check(
    take: Take,
    wanted: Bools,
    solve: Callable[[Take, Bools], Solution],
    params: Params,
    leave: Callable[[float | None], bool] = lambda expected: False,
) -> SelfCheck:
    """Return the errors of a method on trusted samples of the take that were hidden from it.

    wanted: (F, M), the samples whose gaps are copied. solve: the method, given the take and the samples (F, M) to fill.
    leave: whether a gap of this expected 3D error, mm, would be left unfilled; such gaps are not judged. Where nothing
    can be hidden, the result has the reason. Raises what ``solve`` raises.
    """
    pattern = _gap_pattern(take, wanted)
    filled: list[_FilledGap] = []
    for turn in range(params.rounds):
        hidden = hide(take, wanted, params, turn)
        if not hidden.any():
            break
        solution = solve(replace(take, trusted=take.trusted & ~_with_followers(take, hidden)), hidden)
        filled += _filled_gaps(take, hidden, solution, leave)
    if not filled:
        reason = f"none of the {len(pattern)} gaps fits where its marker is trusted"
        return SelfCheck(because=reason if len(pattern) else "there is no gap to fill of a marker that is seen")
    total, by_length = _pooled(filled, _lengths(pattern).sum()), _by_length(pattern, filled)
    measured = sum(found.missing for found in by_length.values() if found.error)
    return SelfCheck(
        rounds=params.rounds,
        represented=measured / total.missing,
        total=total,
        by_length=_with_factors(by_length),
    )


def widened(sd: Floats, trusted: Bools, checked: SelfCheck) -> Floats:
    """Return the error bars (F, M), mm, each times the factor of the length class of its gap; the others as they are.

    trusted: (F, M), whose runs of untrusted samples are the gaps.
    """
    wider = sd.copy()
    gaps = list(column_runs(~trusted))
    for name, members in metrics.by_length([stop - start for _, start, stop in gaps]) if gaps else []:
        factor = checked.by_length[name].factor if name in checked.by_length else 1.0
        for marker, start, stop in (gaps[k] for k in members):
            wider[start:stop, marker] *= factor
    return wider


def hide(take: Take, wanted: Bools, params: Params, turn: int = 0) -> Bools:
    """Return trusted samples (F, M) to hide, in copies of the gaps of ``wanted`` (F, M); each turn has others."""
    pattern = _gap_pattern(take, wanted)
    budget = _sample_budget(take, pattern, params)
    hidden = np.zeros_like(take.trusted)
    at_ends, *shifted = _copied_patterns(pattern, len(hidden), turn)
    for k in range(COPIES):
        gaps = _best_copy([at_ends] if k == 0 else shifted, ~take.trusted | hidden)
        for marker, start, stop in _within_budget(gaps, budget, len(hidden), first_copy=not hidden.any()):
            hidden[start:stop, marker] = True
    return hidden


def _gap_pattern(take: Take, wanted: Bools) -> Gaps:
    """Return the real gaps that are to be filled, of markers that are trusted in some frame."""
    is_seen: Bools = np.asarray(take.trusted.any(axis=0))
    gaps = [gap for gap in column_runs(~take.trusted) if is_seen[gap[0]] and wanted[gap[1], gap[0]]]
    return np.array(gaps, dtype=np.intp).reshape(-1, 3)


def _sample_budget(take: Take, pattern: Gaps, params: Params) -> Floats:
    """Return the number of samples to hide in gaps of each length class.

    The total is the number of missing samples, within the limits of the parameters; a class has its share of these.
    """
    lost = np.bincount(_length_classes(pattern), _lengths(pattern), minlength=len(metrics.LENGTH_CLASSES) + 1)
    n_trusted, n_lost = take.trusted.sum(), lost.sum()
    most = min(params.most * n_trusted, params.gaps * n_lost / max(len(pattern), 1))
    goal = min(max(n_lost, params.least * n_trusted), most)
    return np.asarray(goal * lost / max(n_lost, 1))


def _length_classes(gaps: Gaps) -> Ints:
    """Return the class of each gap's length, as an index into ``metrics.LENGTH_CLASSES``."""
    return np.asarray(np.searchsorted(metrics.LENGTH_CLASSES, _lengths(gaps)), dtype=np.intp)


def _lengths(gaps: Gaps) -> Ints:
    """Return the length of each gap in frames."""
    return np.asarray(gaps[:, 2] - gaps[:, 1])


def _copied_patterns(pattern: Gaps, n_frames: int, turn: int) -> Iterator[Gaps]:
    """Yield the gaps at the ends of the take, moved to the other end; then all other gaps, once for each shift."""
    at_end = (pattern[:, 1] == 0) | (pattern[:, 2] == n_frames)
    marker, start, stop = pattern[at_end].T
    yield np.column_stack([marker, n_frames - stop, n_frames - start])
    marker, start, stop = pattern[~at_end].T
    for k in range(turn * SHIFTS, (turn + 1) * SHIFTS):
        shifted_start = (start + int(n_frames * ((k + 1) * GOLDEN_RATIO % 1.0))) % n_frames
        shifted_stop = shifted_start + stop - start
        inside = (shifted_start >= MARGIN) & (shifted_stop + MARGIN <= n_frames)
        yield np.column_stack([marker, shifted_start, shifted_stop])[inside]


def _best_copy(copies: Sequence[Gaps], unavailable: Bools) -> Gaps:
    """Return the possible gaps of the copy that has most samples in them.

    A gap is possible without an unavailable sample (F, M) in it and within the margin around it. Samples count twice in
    frames without an unavailable sample.
    """
    # Running sums: of unavailable samples of each marker, and of frames without any
    unavailable_before = np.concatenate([np.zeros_like(unavailable[:1], dtype=np.intp), unavailable.cumsum(axis=0)])
    complete_before = np.concatenate([[0], (~unavailable.any(axis=1)).cumsum()])
    n_frames = len(unavailable)

    def possible(gaps: Gaps) -> Gaps:
        marker, low, high = gaps[:, 0], np.maximum(gaps[:, 1] - MARGIN, 0), np.minimum(gaps[:, 2] + MARGIN, n_frames)
        kept: Gaps = gaps[unavailable_before[high, marker] == unavailable_before[low, marker]]
        return kept

    def score(gaps: Gaps) -> int:
        return int((_lengths(gaps) + complete_before[gaps[:, 2]] - complete_before[gaps[:, 1]]).sum())

    return max(map(possible, copies), key=score)


def _within_budget(gaps: Gaps, budget: Floats, n_frames: int, *, first_copy: bool) -> Iterator[Gaps]:
    """Yield gaps until the budget of their length class is spent, segment by segment of the take.

    The order of the segments is spread over the take, and the gaps of one segment follow each other, so that gaps that
    overlap in time stay together. budget: samples of each class, reduced by each gap; the last gap may exceed it.
    first_copy: yield the whole first segment whatever the budget.
    """
    segment, classes = gaps[:, 1] * SEGMENTS // n_frames, _length_classes(gaps)
    order = np.lexsort((gaps[:, 1], (segment + 1) * GOLDEN_RATIO % 1.0))
    for k in order:
        if budget[classes[k]] > 0 or (first_copy and segment[k] == segment[order[0]]):
            budget[classes[k]] -= gaps[k, 2] - gaps[k, 1]
            yield gaps[k]


class _FilledGap(NamedTuple):
    """A hidden gap: its length in frames, and the errors (n, 3) and sd (n,) of its filled samples, mm."""

    length: int
    errors: Floats
    sd: Floats | None


def _filled_gaps(
    take: Take, hidden: Bools, solution: Solution, leave: Callable[[float | None], bool]
) -> Iterator[_FilledGap]:
    """Yield the hidden gaps with the errors of a solution; without errors if the gap would be left unfilled."""
    for marker, start, stop in column_runs(hidden):
        span = (slice(start, stop), marker)
        filled = solution.filled[span]
        sd = None if solution.sd is None else solution.sd[span][filled]
        kept = slice(0) if sd is not None and leave(metrics.expected_error(sd)) else slice(None)
        errors = (solution.positions[span] - take.positions[span])[filled]
        yield _FilledGap(stop - start, errors[kept], None if sd is None else sd[kept])


def _pooled(gaps: Sequence[_FilledGap], missing: int) -> HiddenGaps:
    """Return the result over all samples of some gaps, which stand for so many missing samples."""
    if not gaps:
        return HiddenGaps(missing=int(missing))
    errors = np.concatenate([gap.errors for gap in gaps])
    sd = [gap.sd for gap in gaps if gap.sd is not None]
    return HiddenGaps(
        missing=int(missing),
        gaps=len(gaps),
        samples=sum(gap.length for gap in gaps),
        error=metrics.error(np.zeros_like(errors), errors, np.ones(len(errors), dtype=bool)),
        covered=metrics.coverage(errors, np.concatenate(sd)) if sd else None,
        expected=metrics.expected_error(np.concatenate(sd)) if sd else None,
    )


def _by_length(pattern: Gaps, gaps: Sequence[_FilledGap]) -> dict[str, HiddenGaps]:
    """Return the result of each length class that the real gaps have; 0 gaps where none of it was hidden."""
    lengths = _lengths(pattern)
    hidden = {name: [gaps[k] for k in members] for name, members in metrics.by_length([g.length for g in gaps])}
    real = metrics.by_length(lengths.tolist())
    return {name: _pooled(hidden.get(name, []), int(lengths[members].sum())) for name, members in real}


def _with_factors(by_length: Mapping[str, HiddenGaps]) -> dict[str, HiddenGaps]:
    """Return the classes, in the order of their length, with the factors of their error bars.

    A measured class has the RMS error over the expected one, or 1 if that is more: error bars are never narrowed. Any
    other class has the larger factor of the nearest measured classes on both sides.
    """
    factors = [_factor(found) for found in by_length.values()]
    settled = [
        factor or max(next(filter(None, factors[k:]), 1.0), next(filter(None, factors[k::-1]), 1.0))
        for k, factor in enumerate(factors)
    ]
    return {name: replace(found, factor=f) for (name, found), f in zip(by_length.items(), settled, strict=True)}


def _factor(found: HiddenGaps) -> float | None:
    """Return the factor of a measured class, at least 1; None where nothing was measured or no error was expected."""
    if not found.error or not found.expected:
        return None
    return max(1.0, found.error.rmse_3d / found.expected)


def _with_followers(take: Take, hidden: Bools) -> Bools:
    """Return the hidden samples (F, M), and in the same frames those of points that follow their markers exactly.

    Such a point is computed from the marker and would tell where it is. The joints of a skeleton stay.
    """
    if take.skeleton is not None:
        return hidden
    _, deviation = mean_distances(take.positions, take.trusted, DISTANCE_FRAMES)
    return np.asarray(hidden | (hidden.astype(float) @ exact_pairs(deviation, EXACT_SD) > 0.0), dtype=bool)
