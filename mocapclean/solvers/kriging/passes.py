"""Fill gaps in passes: later passes also use filled samples as neighbours."""

from functools import partial
from typing import NamedTuple

import numpy as np

from mocapclean import progress
from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.cores import in_parts
from mocapclean.solvers.kriging.answers import answers
from mocapclean.solvers.kriging.calm_steps import calm
from mocapclean.solvers.kriging.gap_segment import CLEARLY_BETTER, Answer, GapSegment
from mocapclean.solvers.kriging.gap_splitting import split_gap
from mocapclean.solvers.kriging.joining import join_parts
from mocapclean.solvers.kriging.take_state import TakeState

SETTLED_CHANGE = 0.3
"""Root mean square change of a gap in one pass, relative to its SD, up to which the gap is not filled again.

It was added to save passes; chosen by hand, no sweep was kept.
"""

PART = 16  # most gaps that are filled together on one core; chosen among 32, 16 and 10: shares two cores best


class GapSpan(NamedTuple):
    """A gap: the column of its marker, its first frame and the frame after its last."""

    marker: int
    start: int
    stop: int


class PassOutcome(NamedTuple):
    """The outcome of one pass over some gaps, which decides what the next pass fills.

    incomplete_training: whether a gap was learnt from frames that lack many neighbours.
    alone: gaps that would be split, and are filled from the marker's own path, which later passes do not change.
    """

    incomplete_training: bool
    alone: list[GapSpan]


def fill_in_passes(state: TakeState, fillable: Bools, wanted: Bools) -> int:
    """Fill the wanted gaps, and others only where the wanted ones need them; return the number of passes.

    fillable: (F, M) samples that may be filled. wanted: (F, M) samples whose gaps need a fill. Other gaps
    are filled only where the wanted ones learn from them. Where the state began with a solution, its gaps are not
    filled again.
    """
    own = slice(0, state.n_own)
    gaps = [GapSpan(*run) for run in column_runs(fillable & ~state.known[own] & ~state.begun[own])]
    wanted_gaps = [gap for gap in gaps if wanted[gap.start : gap.stop, gap.marker].any()]
    passes, incomplete, to_fill = 0, False, wanted_gaps
    while to_fill and passes < state.params.passes:
        before = state.positions
        outcome = fill_gaps(state, to_fill, first=passes == 0)
        passes += 1
        gaps = [gap for gap in gaps if gap not in outcome.alone]
        # With a solution to begin with, gaps have learnt from filled samples in the first pass already.
        incomplete |= outcome.incomplete_training and not state.begun.any()
        if passes == 1:
            if incomplete:
                # Gaps learn from filled samples: fill the others as well.
                others = fill_gaps(state, sorted(set(gaps) - set(wanted_gaps)), first=True)
                gaps = [gap for gap in gaps if gap not in others.alone]
            to_fill = gaps if incomplete else []
        else:
            # Later passes fill only the gaps that the last pass still changed.
            to_fill = [gap for gap in gaps if _changed(state, gap, before)]
    return passes


class _FilledGap(NamedTuple):
    """The answers of a gap.

    spans: (first frame, frame after the last) of its segments. answers: one for each. alone: whether the one segment is
    the whole gap, from the marker's own path, where the gap would be split. incomplete_training: as in ``PassOutcome``.
    """

    spans: list[tuple[int, int]]
    answers: list[Answer | None]
    alone: bool
    incomplete_training: bool


def fill_gaps(state: TakeState, gaps: list[GapSpan], *, first: bool) -> PassOutcome:
    """Fill gaps and update the state; every gap is filled from the state before the pass.

    A segment without an answer stays as it is: its samples are missing, and its interpolated positions are not read.
    first: whether it is the first pass over these gaps, in which their segments are compared with the own path.
    """
    progress.stage("filling", len(gaps))
    parts = _parts(gaps)
    positions, sd = state.positions.copy(), state.sd.copy()
    outcome = PassOutcome(False, [])
    # The frames of a session have no part in what follows.
    track, spread, fixed = positions[: state.n_own], sd[: state.n_own], (state.known | state.begun)[: state.n_own]
    for part, filled in zip(parts, in_parts(partial(_answered, state, first), parts), strict=True):
        progress.advance(len(part))
        for gap, found in zip(part, filled, strict=True):
            answered = [(span, answer) for span, answer in zip(found.spans, found.answers, strict=True) if answer]
            for (start, stop), answer in answered:
                positions[start:stop, gap.marker], sd[start:stop, gap.marker] = answer
            own = fixed[:, gap.marker]
            join_parts(track[:, gap.marker], spread[:, gap.marker], own, [span for span, _ in answered], state.rate)
            outcome = outcome._replace(incomplete_training=outcome.incomplete_training or found.incomplete_training)
            if found.alone:
                outcome.alone.append(gap)
    track[:], spread[:] = state.limits.restored(track, spread, fixed, state.rate)
    for marker in {gap.marker for gap in gaps}:
        near = state.distances.nearest(marker)
        calm(track[:, marker], spread[:, marker], fixed[:, marker], track[:, near], fixed[:, near])
    state.positions, state.sd = state.bones.restored(positions, sd, state.trusted), sd
    state.missing = np.asarray(~(state.known | np.isfinite(sd)), dtype=float)
    return outcome


def _parts(gaps: list[GapSpan]) -> list[list[GapSpan]]:
    """Return the gaps in parts that take about as long; an even number of them, unless they are few."""
    n_parts = 2 * -(-len(gaps) // (2 * PART)) if len(gaps) > PART else 1
    # Every part has gaps of all lengths.
    ordered = sorted(gaps, key=lambda gap: gap.stop - gap.start)
    return [part for part in (ordered[k::n_parts] for k in range(n_parts)) if part]


def _answered(state: TakeState, first: bool, gaps: list[GapSpan]) -> list[_FilledGap]:
    """Return the answers of gaps from a state, which stays as it is; first: as in ``fill_gaps``."""
    # Segments in which the same neighbours are known are filled by themselves, then joined.
    spans = [split_gap(state.known, state.distances.weights(gap.marker), gap.start, gap.stop) for gap in gaps]
    parts = [
        [GapSegment(state, gap.marker, *span, whole=len(of_gap) == 1) for span in of_gap]
        for gap, of_gap in zip(gaps, spans, strict=True)
    ]
    alone = [
        [GapSegment(state, *gap, alone=True)] if first and len(of_gap) > 1 else []
        for gap, of_gap in zip(gaps, spans, strict=True)
    ]
    found = iter(answers([segment for both in zip(parts, alone, strict=True) for each in both for segment in each]))
    filled = []
    for gap, of_gap, segments, whole in zip(gaps, spans, parts, alone, strict=True):
        of_parts, incomplete = [next(found) for _ in segments], any(part.incomplete_training for part in segments)
        of_whole = next(found) if whole else None
        if of_whole and _has_less_variance(of_whole, of_parts):
            filled.append(_FilledGap([(gap.start, gap.stop)], [of_whole], True, incomplete))
        else:
            filled.append(_FilledGap(of_gap, of_parts, False, incomplete))
    return filled


def _has_less_variance(alone: Answer, of_segments: list[Answer | None]) -> bool:
    """Whether the answer of a whole gap has a much smaller variance than those of its segments, or one has none."""
    answered = [answer for answer in of_segments if answer]
    if len(answered) < len(of_segments):
        return True
    return bool(
        CLEARLY_BETTER * np.square(alone[1]).mean() < np.square(np.concatenate([sd for _, sd in answered])).mean()
    )


def _changed(state: TakeState, gap: GapSpan, before: Floats) -> bool:
    """Whether the fill of a gap differs from the positions (F, M, 3) before the pass by more than a share of its SD."""
    span = slice(gap.start, gap.stop)
    sd = state.sd[span, gap.marker]
    answered = np.isfinite(sd)
    change = (state.positions[span, gap.marker] - before[span, gap.marker])[answered]
    return bool(answered.any() and np.square(change).mean() > SETTLED_CHANGE**2 * np.square(sd[answered]).mean())
