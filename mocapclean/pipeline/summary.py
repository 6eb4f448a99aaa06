"""Say what happened to a take: count its samples, follow every gap, measure its bones, judge it against a truth."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import Settings
from mocapclean.evaluation import metrics
from mocapclean.pipeline.outcome import BoneReport, Counts, Gap, Outcome
from mocapclean.take import Take
from mocapclean.take.bones import bones_of


def account(
    before: Take,
    merged: Take,
    after: Take,
    wanted: Bools,
    settings: Settings,
    sd: Floats | None = None,
    largest: float = np.inf,
) -> Outcome:
    """Count samples, gaps and bones.

    before: what is trusted; merged: what was solved; after: what was written; wanted: (F, M) what the user asked for;
    sd: (F, M) mm, the error bars of what the method answered, NaN elsewhere, or None if it gives none. largest: mm, the
    largest coordinate that the file can hold.
    The caller adds what only it knows: paths, hashes, method.
    """
    untrusted = ~before.trusted
    left = untrusted & ~after.filled
    missing = before.distrusted_by("missing")
    counts = Counts(
        samples=untrusted.size,
        untrusted=int(untrusted.sum()),
        missing=int(missing.sum()),
        filled=int(after.filled.sum()),
        left=int(left.sum()),
        moved=int(after.moved.sum()),
        invalidated=int((left & ~missing).sum()) if settings.invalidate else 0,
    )
    limit = settings.left_limit(counts.samples)
    too_many = limit is not None and counts.left > limit
    source, bones, tan = _bones(before, after)
    return Outcome(
        source=Path(),
        status="repaired" if counts.filled or counts.moved or counts.invalidated else "unchanged",
        error=f"{counts.left} samples are left, more than --max-left {settings.max_left}." if too_many else "",
        exit_code=int(too_many),
        n_frames=len(before.trusted),
        n_markers=len(before.markers),
        first_frame=before.first_frame,
        rate=before.rate,
        counts=counts,
        gaps=_gaps(before, merged, after, wanted, settings, sd, largest),
        findings=after.findings,
        fitting=metrics.error(merged.positions, after.positions, after.changed),
        bones_from=source,
        bones=bones,
        skeleton_rmse=tan,
    )


def _gaps(
    before: Take, merged: Take, after: Take, wanted: Bools, settings: Settings, sd: Floats | None, largest: float
) -> tuple[Gap, ...]:
    rules = {name: before.distrusted_by(name) for name in dict.fromkeys(f.rule for f in before.findings if f.frames)}
    gaps = []
    for marker, start, stop in column_runs(~before.trusted):
        span = (slice(start, stop), marker)
        left = ~after.filled[span]
        expected = metrics.expected_error(sd[span]) if sd is not None else None
        if settings.too_uncertain(expected):
            why = "the expected error is above the limit"
        elif (merged.filled[span] & (np.abs(merged.positions[span]) > largest).any(axis=1)).any():
            why = "the file's numbers do not reach so far"
        else:
            why = _why_left(before, merged, wanted, marker, start, stop)
        gaps.append(
            Gap(
                marker=before.markers[marker],
                start=start,
                stop=stop,
                rules=tuple(name for name, mask in rules.items() if mask[span].any()),
                n_filled=int((~left).sum()),
                left_because=why if left.any() else "",
                expected=expected,
                grade=settings.grades.of(expected) if expected is not None and not left.all() else "",
            )
        )
    return tuple(gaps)


def _why_left(before: Take, merged: Take, wanted: Bools, marker: int, start: int, stop: int) -> str:
    if not wanted[:, marker].any() and before.trusted[:, marker].any() and not wanted.all():
        return "not asked for"
    if not wanted[start, marker]:
        return "longer than the limit"
    if not before.trusted[:, marker].any():
        return "the marker is never seen"
    if merged.filled[start:stop, marker].all():
        return "no pose reaches it"
    if not before.trusted[start:stop].any(axis=1).all():
        return "nothing is seen in some of these frames"
    if start == 0 or stop == len(before.trusted):
        return "at the end of the take, where the method has no answer"
    return "the method has no answer here"


def _bones(before: Take, after: Take) -> tuple[str, tuple[BoneReport, ...], tuple[float | None, float | None]]:
    source, bones = bones_of(before)
    columns = {name: column for column, name in enumerate(before.markers)}
    ends = np.array([(columns[b.start], columns[b.end]) for b in bones], dtype=np.intp).reshape(-1, 2)
    lengths = np.array([b.length for b in bones])
    states = ((before.positions, before.trusted), (after.positions, before.trusted | after.filled))
    first, second = (metrics.bone_lengths(*state, ends, lengths) for state in states)
    reports = tuple(
        BoneReport(start=bone.start, end=bone.end, reference=bone.length, before=was, after=now)
        for bone, was, now in zip(bones, first, second, strict=True)
    )
    was, now = (metrics.skeleton_rmse(*state, ends, lengths) for state in states)
    return source, reports, (was, now)


def judge(outcome: Outcome, after: Take, truth: Take) -> Outcome:
    """Add the error of the filled samples against the truth: in all, by marker, by length of gap, and by gap."""
    where = after.filled & truth.trusted
    columns = {name: column for column, name in enumerate(after.markers)}

    def judged(mask: Bools) -> metrics.Error | None:
        return metrics.error(truth.positions, after.positions, where & mask)

    def mask_of(gaps: Sequence[Gap]) -> Bools:
        mask = np.zeros_like(where)
        for gap in gaps:
            mask[gap.start : gap.stop, columns[gap.marker]] = True
        return mask

    def of_marker(marker: str) -> metrics.Error | None:
        column = columns[marker]
        return metrics.error(truth.positions[:, column], after.positions[:, column], where[:, column])

    def of_gap(gap: Gap) -> metrics.Error | None:
        span = (slice(gap.start, gap.stop), columns[gap.marker])
        return metrics.error(truth.positions[span], after.positions[span], where[span])

    classes = metrics.by_length([gap.stop - gap.start for gap in outcome.gaps]) if outcome.gaps else []
    lengths = {name: judged(mask_of([outcome.gaps[i] for i in members])) for name, members in classes}
    markers = {name: of_marker(name) for name in after.markers}
    return replace(
        outcome,
        accuracy=judged(np.ones_like(where)),
        accuracy_by_marker={name: found for name, found in markers.items() if found},
        accuracy_by_length={name: found for name, found in lengths.items() if found},
        gaps=tuple(replace(gap, error=of_gap(gap)) for gap in outcome.gaps),
    )
