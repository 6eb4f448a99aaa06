"""Read a take, leave out excluded markers and detect untrusted samples: the first part of fill, inspect and check."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean import formats, progress
from mocapclean.arrays import Bools, Ints, column_runs
from mocapclean.config.settings import Settings
from mocapclean.detection import detect
from mocapclean.detection.spans import distrust, read_spans
from mocapclean.errors import FormatError, UsageError
from mocapclean.pipeline.frame_range import chosen_frames
from mocapclean.take import Take
from mocapclean.take.bones import check_names
from mocapclean.take.names import is_pattern, matching_columns, matching_joints, similar_names
from mocapclean.take.status import Codes, detected, leave_outside


@dataclass(frozen=True, kw_only=True)
class Prepared:
    """A take as read, and the markers to work on with their trust lowered.

    whole: all markers of the file. selected: the markers that ``--exclude`` leaves, after detection; with poses all
    joints, because each is part of the skeleton. columns: the place of each selected marker in the whole take.
    excluded: those selected joints (M,) that ``--exclude`` names. frames: those to judge and repair, as indices; all
    others keep what the file has, and methods may learn from them.
    """

    whole: Take
    selected: Take
    columns: Ints
    excluded: Bools
    frames: slice

    @property
    def codes(self) -> Codes:
        """The status (F, M) of the selected samples after detection."""
        codes = detected(self.selected)
        inside = np.zeros(len(codes), dtype=bool)
        inside[self.frames] = True
        leave_outside(codes, inside)
        return codes

    @property
    def judged(self) -> tuple[int, int] | None:
        """The first and the last number of the frames to judge and repair; None for all of the take."""
        frames = self.frames.start, self.frames.stop
        return None if frames == (0, len(self.whole.trusted)) else self.whole.numbers(*frames)

    @property
    def touched(self) -> Bools:
        """The samples (F, M) of the gaps that lie in the frames to repair, in whole or in part."""
        gaps = np.zeros_like(self.selected.trusted)
        for marker, start, stop in column_runs(~self.selected.trusted):
            gaps[start:stop, marker] = start < self.frames.stop and stop > self.frames.start
        return gaps

    @property
    def format(self) -> str:
        """The name of the file's format."""
        return self.whole.origin.format if self.whole.origin else ""

    @property
    def largest(self) -> float:
        """The largest coordinate that the file can hold, mm."""
        return self.whole.origin.largest if self.whole.origin else np.inf

    def with_selected(self, selected: Take) -> Take:
        """Return the whole take in which the selected markers are their processed version, in the frames to repair."""
        arrays = {name: getattr(self.whole, name).copy() for name in ("positions", "trusted", "filled", "moved")}
        for name, array in arrays.items():
            array[self.frames, self.columns] = getattr(selected, name)[self.frames]
        for name in ("poses", "known"):
            if getattr(self.whole, name) is not None:
                arrays[name] = getattr(self.whole, name).copy()
                arrays[name][self.frames] = getattr(selected, name)[self.frames]
        return replace(self.whole, findings=selected.findings, exchanged=selected.exchanged, **arrays)


def prepare(source: Path, settings: Settings) -> Prepared:
    """Read a file, leave excluded markers out, and lower the trust of the others by spans and rules.

    Raises FormatError for a file that cannot be read, UsageError for markers or spans that it does not have.
    """
    progress.stage("reading")
    whole = read_take(source, settings)
    for pattern in settings.markers:
        matching(pattern, whole, "--markers")
    frames = chosen_frames(whole, settings)
    excluded = np.zeros(len(whole.markers), dtype=bool)
    for pattern in settings.exclude:
        # A pattern of carried points alone excludes nothing, because they are left out already.
        if matching_columns(pattern, whole.markers) or not matching_columns(pattern, formats.carried(whole)):
            excluded[matching(pattern, whole, "--exclude")] = True
    if excluded.all():
        raise UsageError(f"{source}: --exclude must leave at least one marker.")
    columns = np.flatnonzero(~excluded | (whole.poses is not None))
    # The file's own gaps come first, so that a span of the user over a gap is not reported as missing by the user.
    selected = detect(whole.select(columns), {"missing": settings.rules["missing"]})
    if settings.gaps:
        selected = distrust(selected, read_spans(settings.gaps))
    rules = {name: rule for name, rule in settings.rules.items() if name != "missing"}
    with progress.within("detecting"):
        found = detect(selected, rules, fix_swaps=settings.fix_swaps, replace=settings.replace)
    found = _exchanged_within(frames, found, selected)
    selected = _without(found, selected, excluded[columns])
    return Prepared(whole=whole, selected=selected, columns=columns, excluded=excluded[columns], frames=frames)


def _exchanged_within(frames: slice, found: Take, before: Take) -> Take:
    """Return a take after detection in which labels are exchanged in these frames alone.

    Elsewhere the samples of an exchange are as they were before it, and are not trusted.
    """
    if not found.exchanged:
        return found
    back = found.moved.copy()
    back[frames] = False
    cut = (replace(e, start=max(e.start, frames.start), stop=min(e.stop, frames.stop)) for e in found.exchanged)
    return replace(
        found,
        positions=np.where(back[..., None], before.positions, found.positions),
        trusted=found.trusted & ~back,
        moved=found.moved & ~back,
        exchanged=tuple(each for each in cut if each.start < each.stop),
    )


def _without(found: Take, before: Take, excluded: Bools) -> Take:
    """Return a take after detection in which excluded joints (J,) keep their trust and have no findings of rules."""
    if found.known is None or before.known is None or not excluded.any():
        return found
    names = {name for name, is_out in zip(found.markers, excluded, strict=True) if is_out}
    findings = tuple(f for f in found.findings if f.marker not in names or f.rule == "missing")
    return found.with_known(np.where(excluded[found.owners], before.known, found.known), findings=findings)


def read_take(source: Path, settings: Settings) -> Take:
    """Return the take with the skeleton and the extra points that the settings name."""
    if not source.exists():
        raise FormatError(source, "the file must exist. It does not.")
    own_skeleton = formats.needs_skeleton(source, settings.format)
    options: dict[str, Any] = {"rate": settings.rate, "unit": settings.unit_mm, "format": settings.format}
    if own_skeleton:
        options["skeleton"] = settings.skeleton
    take = formats.read(source, **options)
    exact = [name for name in settings.markers if not is_pattern(name)]
    others = [name for name in exact if not matching_columns(name, take.markers)]
    if others and formats.lists_points(source, settings.format):
        take = formats.read(source, points=others, **options)
    if settings.skeleton and not own_skeleton:
        skeleton = formats.read_skeleton(settings.skeleton, settings.unit_mm)
        check_names(take.markers, skeleton)
        take = replace(take, skeleton=skeleton)
    return take


def read_reference(selected: Take, settings: Settings) -> Take | None:
    """Return the reference take (the truth), reordered to the selected markers, or None if the settings name none.

    Frames are matched by their numbers in the files. Markers and frames that the reference does not have are untrusted
    in it. Raises UsageError unless it shares a marker and a frame.
    """
    path = settings.reference
    if path is None:
        return None
    skeleton = settings.skeleton if formats.needs_skeleton(path) else None
    truth = formats.read(path, skeleton=skeleton, rate=settings.rate, unit=settings.unit_mm)
    columns = {name: column for column, name in enumerate(truth.markers)}
    order = np.array([columns.get(name, -1) for name in selected.markers])
    if (order < 0).all():
        raise UsageError(f"{path}: the reference must share marker names with the take.")
    frames = np.arange(len(selected.trusted)) + selected.first_frame - truth.first_frame
    inside = (frames >= 0) & (frames < len(truth.trusted))
    if not inside.any():
        raise UsageError(
            f"{path}: the reference must share frames with the take, {_span(selected)}. It has {_span(truth)}."
        )
    place = np.ix_(np.clip(frames, 0, len(truth.trusted) - 1), order)
    known = truth.trusted[place] & inside[:, None] & (order >= 0)
    return replace(selected, positions=truth.positions[place], trusted=known)


def _span(take: Take) -> str:
    """Return the first and last frame number of a take."""
    first, last = take.numbers(0, len(take.trusted))
    return f"{first} to {last}"


def matching(pattern: str, take: Take, option: str) -> list[int]:
    """Return the columns of a take that a pattern matches; UsageError, naming the option, if none does.

    Of a take with poses a pattern may also name a joint with all that hangs on it.
    """
    if take.poses is not None and take.skeleton is not None:
        kind, columns = "joints", matching_joints(pattern, take.skeleton)
    else:
        kind, columns = "markers", matching_columns(pattern, take.markers)
    if not columns:
        near = similar_names(pattern, take.markers) or list(take.markers[:5])
        raise UsageError(f"{option} must name {kind} of the take. Got {pattern!r}; near: {', '.join(near)}.")
    return columns
