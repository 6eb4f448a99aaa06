"""Summarise what happened to a take: counts, every gap, bone lengths, and errors against a known truth."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import Settings
from mocapclean.evaluation import metrics
from mocapclean.geometry.joint_motion import angles_between, joint_motion
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.pipeline.frame_range import touching
from mocapclean.pipeline.outcome import BoneReport, Counts, GapReport, Outcome
from mocapclean.take import Take
from mocapclean.take.bones import bones_of
from mocapclean.take.status import Codes, Status, counted, supplied


@dataclass(frozen=True, kw_only=True)
class Turns:
    """What is known of the answer for a take with poses besides millimetres.

    sd: (F, J) degrees, the error bars of rotations about each axis, NaN without an answer; None without any. misfit:
    (F, J) mm, see ``Solution``.
    """

    sd: Floats | None = None
    misfit: Floats | None = None


def summarise(
    before: Take,
    after: Take,
    codes: Codes,
    settings: Settings,
    sd: Floats | None = None,
    turns: Turns | None = None,
) -> Outcome:
    """Return the counts, gaps and bones of a take, as an Outcome without paths, hashes and method.

    before: the take with the trust that detection left. after: the take as it was written. codes: (F, M) the status of
    every sample. sd: (F, M) mm, the error bars of what the method answered, NaN elsewhere, or None if it gives none.
    turns: for takes with poses.
    """
    inside = np.flatnonzero(counted(codes).any(axis=1))
    frames = slice(int(inside[0]), int(inside[-1]) + 1) if inside.size else slice(0, len(codes))
    counts = _counts(before, codes, settings)
    moves = _moves(before, after, codes)
    limit = settings.left_limit(counts.samples)
    too_many = limit is not None and counts.left > limit
    bones_from, bones, skeleton_rmse = bone_reports(before, after, frames)
    return Outcome(
        source=Path(),
        status="repaired" if counts.filled or counts.moved or counts.invalidated else "unchanged",
        error=f"{counts.left:,} samples are left, more than --max-left {settings.max_left}." if too_many else "",
        exit_code=int(too_many),
        n_frames=len(before.trusted),
        n_markers=len(before.markers),
        first_frame=before.first_frame,
        judged=None if counts.outside == 0 else before.numbers(frames.start, frames.stop),
        rate=before.rate,
        counts=counts,
        statuses=_statuses(codes),
        largest_move=_largest(moves),
        gaps=_with_turns(_gaps(before, codes, moves, settings, sd), before, after, codes, turns or Turns()),
        findings=touching(after.findings, frames),
        bones_from=bones_from,
        bones=bones,
        skeleton_rmse=skeleton_rmse,
    )


def _counts(before: Take, codes: Codes, settings: Settings) -> Counts:
    inside = counted(codes)
    untrusted = ~before.trusted & inside
    missing = before.distrusted_by("missing") & inside
    left = untrusted & ~supplied(codes)
    return Counts(
        samples=int(inside.sum()),
        untrusted=int(untrusted.sum()),
        missing=int(missing.sum()),
        filled=int(supplied(codes).sum()),
        replaced=int((codes == Status.REPLACED).sum()),
        left=int(left.sum()),
        moved=int((codes == Status.MOVED).sum()),
        suspicious=int((codes == Status.SUSPICIOUS).sum()),
        invalidated=int((left & ~missing).sum()) if settings.invalidate else 0,
        outside=int((~inside).sum()),
    )


def _statuses(codes: Codes) -> Mapping[Status, int]:
    """Return how many samples have each status that occurs."""
    numbers = np.bincount(codes.ravel()).tolist()
    return {Status(value): number for value, number in enumerate(numbers) if number}


def _moves(before: Take, after: Take, codes: Codes) -> Floats:
    """Return the distances (F, M), mm, of replaced samples between the file and the output, NaN for all others.

    A joint counts with all that hangs on it, because its own rotation moves those alone.
    """
    distances = np.linalg.norm(after.positions - before.positions, axis=2)
    if before.skeleton is not None and before.poses is not None:
        distances = _farthest_below(before.skeleton, distances)
    return np.where(codes == Status.REPLACED, distances, np.nan)


def _farthest_below(skeleton: Skeleton, distances: Floats) -> Floats:
    """Return for each joint the largest of its distance (F, J) and those of all that hangs on it."""
    farthest = distances.copy()
    for joint in reversed(range(len(skeleton.parents))):
        if (parent := skeleton.parents[joint]) >= 0:
            farthest[:, parent] = np.maximum(farthest[:, parent], farthest[:, joint])
    return farthest


def _with_turns(
    gaps: tuple[GapReport, ...], before: Take, after: Take, codes: Codes, turns: Turns
) -> tuple[GapReport, ...]:
    """Return the gaps with their channels and degrees, for a take with poses; any others as they are."""
    if before.skeleton is None or before.poses is None or before.known is None or not gaps:
        return gaps
    assert after.poses is not None
    skeleton, owners = before.skeleton, before.owners
    turned = _turned(skeleton, before.poses, after.poses, codes)
    columns = {name: column for column, name in enumerate(before.markers)}
    reports = []
    for gap in gaps:
        joint = columns[gap.marker]
        span = (slice(gap.start, gap.stop), joint)
        unknown = ~before.known[gap.start : gap.stop].all(axis=0) & (owners == joint)
        sd = turns.sd[span] if turns.sd is not None else None
        reports.append(
            replace(
                gap,
                channels=tuple(skeleton.channels[index].name for index in np.flatnonzero(unknown)),
                expected_degrees=metrics.expected_error(sd) if sd is not None and gap.n_filled else None,
                largest_turn=_largest(turned[span]),
                fitted=float(turns.misfit[span].max()) if turns.misfit is not None and gap.n_filled else None,
            )
        )
    return tuple(reports)


def _turned(skeleton: Skeleton, before: Floats, after: Floats, codes: Codes) -> Floats:
    """Return the degrees (F, J) that replaced samples turn between the file and the output, NaN for all others."""
    rotations = [joint_motion(skeleton, poses, np.isfinite(poses)).rotations for poses in (before, after)]
    return np.where(codes == Status.REPLACED, angles_between(*rotations), np.nan)


def _largest(moves: Floats) -> float | None:
    """Return the largest distance that is not NaN, or None without any."""
    known = moves[~np.isnan(moves)]
    return float(known.max()) if known.size else None


def _gaps(before: Take, codes: Codes, moves: Floats, settings: Settings, sd: Floats | None) -> tuple[GapReport, ...]:
    """Return a report of every run of untrusted samples."""
    rules = {name: before.distrusted_by(name) for name in dict.fromkeys(f.rule for f in before.findings if f.frames)}
    gaps = []
    for marker, start, stop in column_runs(~before.trusted & counted(codes)):
        span = (slice(start, stop), marker)
        n_filled = int(supplied(codes[span]).sum())
        expected = metrics.expected_error(sd[span]) if sd is not None else None
        gaps.append(
            GapReport(
                marker=before.markers[marker],
                start=start,
                stop=stop,
                rules=tuple(name for name, mask in rules.items() if mask[span].any()),
                status=_status_of(codes[span]),
                n_filled=n_filled,
                n_replaced=int((codes[span] == Status.REPLACED).sum()),
                largest_move=_largest(moves[span]),
                expected=expected,
                grade=settings.grades.of(expected) if expected is not None and n_filled else "",
            )
        )
    return tuple(gaps)


def _status_of(codes: Codes) -> Status:
    """Return the most frequent status of the samples of a gap that were left, or of all where none was left."""
    left = codes[~supplied(codes)]
    return Status(Counter((left if left.size else codes).tolist()).most_common(1)[0][0])


def bone_reports(
    before: Take, after: Take, frames: slice
) -> tuple[str, tuple[BoneReport, ...], tuple[float | None, float | None]]:
    """Return where the bones come from, each bone before and after, and the RMS length error before and after, mm.

    frames: those that are measured. The reference of a rigid pair is from all frames.
    """
    source, bones = bones_of(before)
    columns = {name: column for column, name in enumerate(before.markers)}
    ends = np.array([(columns[b.start], columns[b.end]) for b in bones], dtype=np.intp).reshape(-1, 2)
    lengths = np.array([b.length for b in bones])
    states = [(before.positions[frames], before.trusted[frames])]
    if after is not before:
        states.append((after.positions[frames], (before.trusted | after.filled)[frames]))
    measured = [metrics.bone_lengths(*state, ends, lengths) for state in states]
    errors = [metrics.skeleton_rmse(*state, ends, lengths) for state in states]
    reports = tuple(
        BoneReport(start=bone.start, end=bone.end, reference=bone.length, before=was, after=now)
        for bone, was, now in zip(bones, measured[0], measured[-1], strict=True)
    )
    return source, reports, (errors[0], errors[-1])


def with_accuracy(outcome: Outcome, after: Take, truth: Take) -> Outcome:
    """Return the outcome with errors of the filled samples against the reference: in all, by marker, gap length and
    gap.
    """
    where = after.filled & truth.trusted
    columns = {name: column for column, name in enumerate(after.markers)}

    def judged(mask: Bools) -> metrics.Error | None:
        return metrics.error(truth.positions, after.positions, where & mask)

    def mask_of(gaps: Sequence[GapReport]) -> Bools:
        mask = np.zeros_like(where)
        for gap in gaps:
            mask[gap.start : gap.stop, columns[gap.marker]] = True
        return mask

    def of_marker(marker: str) -> metrics.Error | None:
        column = columns[marker]
        return metrics.error(truth.positions[:, column], after.positions[:, column], where[:, column])

    def of_gap(gap: GapReport) -> metrics.Error | None:
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
