"""Fill gaps in passes: later passes also use filled samples as neighbours and beside the parts of a split gap."""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.solvers.kriging.gap_segment import CLEARLY_BETTER, GapSegment
from mocapclean.solvers.kriging.gap_splitting import join_segments, split_gap
from mocapclean.solvers.kriging.take_state import TakeState

SETTLED_CHANGE = 0.3
"""Root mean square change of a gap in one pass, relative to its SD, up to which the gap is not filled again.

It was added to save passes; chosen by hand, no sweep was kept.
"""

Answer = tuple[Floats, Floats]
"""The positions (L, 3) of a segment and their SD (L,) per coordinate, mm."""


class GapSpan(NamedTuple):
    """A gap: the column of its marker, its first frame and the frame after its last."""

    marker: int
    start: int
    stop: int


class PassOutcome(NamedTuple):
    """The outcome of one pass over some gaps, which decides what the next pass fills.

    incomplete_training: whether a gap was learnt from frames that lack many neighbours. split: gaps filled in segments.
    """

    incomplete_training: bool
    split: list[GapSpan]


def fill_in_passes(state: TakeState, fillable: Bools, wanted: Bools) -> int:
    """Fill the wanted gaps, and others only where the wanted ones need them; return the number of passes.

    fillable: (F, M) samples that may be filled. wanted: (F, M) samples whose gaps need a fill. Other gaps
    are filled only where the wanted ones learn from them.
    """
    gaps = [GapSpan(*run) for run in column_runs(fillable & ~state.known)]
    wanted_gaps = [gap for gap in gaps if wanted[gap.start : gap.stop, gap.marker].any()]
    passes, incomplete, to_fill = 0, False, wanted_gaps
    while to_fill and passes < state.params.passes:
        before = state.positions
        outcome = fill_gaps(state, to_fill)
        passes += 1
        incomplete |= outcome.incomplete_training
        if passes == 1:
            if incomplete:
                # Gaps learn from filled samples: fill the others as well.
                fill_gaps(state, sorted(set(gaps) - set(wanted_gaps)))
            # Split gaps are filled again, since each segment can now be bridged from the fill of the next one.
            to_fill = gaps if incomplete else outcome.split
        else:
            # Later passes fill only the gaps that the last pass still changed.
            to_fill = [gap for gap in gaps if incomplete and _changed(state, gap, before)]
    return passes


def fill_gaps(state: TakeState, gaps: list[GapSpan]) -> PassOutcome:
    """Fill gaps and update the state; every gap is filled from the state before the pass.

    A segment without an answer stays as it is: its samples are missing, and its interpolated positions are not read.
    """
    incomplete, split = False, []
    positions, sd = state.positions.copy(), state.sd.copy()
    for gap in gaps:
        marker = gap.marker
        # Segments in which the same neighbours are known are filled by themselves, then joined.
        spans = split_gap(state.known, state.distances.weights(marker), gap.start, gap.stop)
        segments = [GapSegment(state, marker, first, last, whole=len(spans) == 1) for first, last in spans]
        answers = [segment.fill() for segment in segments]
        incomplete |= any(segment.incomplete_training for segment in segments)
        if len(spans) > 1:
            split.append(gap)
            alone = GapSegment(state, *gap, alone=True).fill()
            if alone and _has_less_variance(alone, answers):
                spans, answers = [(gap.start, gap.stop)], [alone]
        for (first, last), answer in zip(spans, answers, strict=True):
            if answer:
                positions[first:last, marker], sd[first:last, marker] = answer
        answered = [span for span, answer in zip(spans, answers, strict=True) if answer]
        join_segments(positions[:, marker], answered, state.rate)
    state.positions, state.sd = state.bones.restored(positions, sd, state.trusted), sd
    state.missing = np.asarray(~(state.known | np.isfinite(sd)), dtype=float)
    return PassOutcome(incomplete, split)


def _has_less_variance(alone: Answer, answers: list[Answer | None]) -> bool:
    """Whether the answer of a whole gap has a much smaller variance than those of its segments, or one has none."""
    answered = [answer for answer in answers if answer]
    if len(answered) < len(answers):
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
