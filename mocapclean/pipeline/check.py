"""Check one take (gaps, distrusted samples, bones, rate) against the limits in the settings; nothing is written."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np

from mocapclean import logs, progress
from mocapclean.arrays import Bools, runs
from mocapclean.config.settings import DEFAULT_METHOD, MarkerLimits, Settings, TakeLimits
from mocapclean.dictionaries.dictionary import load
from mocapclean.errors import MocapcleanError
from mocapclean.pipeline.choose import checked_before_filling
from mocapclean.pipeline.frame_range import touching, within
from mocapclean.pipeline.outcome import BoneReport, Breach, Outcome, Verdict
from mocapclean.pipeline.prepare import Prepared, prepare
from mocapclean.pipeline.summary import bone_reports, summarise
from mocapclean.pipeline.view import Keep, View, view
from mocapclean.take import Take
from mocapclean.take.names import matching_columns


@dataclass(frozen=True)
class CheckTake:
    """Check takes against the limits of ``settings.check``; callable by a pool of workers."""

    settings: Settings
    keep: Callable[[Verdict, View | None], None] | None = None
    """Called with each verdict and, unless the file cannot be read, the view of its take."""

    def __call__(self, job: Path) -> Verdict:
        """Return the verdict on a take. A file that cannot be read is a breach, not an exception."""
        views: list[View] = []
        verdict = self._verdict(job, views.append if self.keep else None)
        if self.keep:
            self.keep(verdict, views[0] if views else None)
        return verdict

    def _verdict(self, job: Path, keep: Keep | None) -> Verdict:
        started = perf_counter()
        try:
            with logs.about(job):
                verdict = _check(job, self.settings, keep)
        except MocapcleanError as error:
            advice = "correct what the message names, or export the take again"
            verdict = unchecked(job, "readable", _without_path(str(error), job), advice)
        return replace(verdict, seconds=perf_counter() - started)

    def undo(self, job: Path) -> None:
        """Do nothing: a check leaves nothing to undo."""


def unchecked(source: Path, limit: str, message: str, advice: str) -> Verdict:
    """Return the verdict on a take that could not be checked."""
    return Verdict(source=source, breaches=(Breach(limit=limit, message=message, advice=advice),))


def _without_path(message: str, source: Path) -> str:
    """Return the message of an error without the path that it begins with; a verdict names its file itself."""
    return message.removeprefix(str(source)).lstrip(":, ").removesuffix(".")


def _check(source: Path, settings: Settings, keep: Keep | None) -> Verdict:
    """Return the verdict on a take; raises what reading and detection raise."""
    prepared = prepare(source, settings)
    whole = prepared.selected
    take = within(whole, prepared.frames)
    inspected: Outcome | None = None
    if keep is not None:
        keep(view(prepared.whole, whole, prepared.whole, whole, prepared.codes, None))
        inspected = replace(summarise(whole, whole, prepared.codes, settings), source=source, status="inspected")
    limits = settings.check
    missing = take.distrusted_by("missing") | take.distrusted_by("user")
    _, bones, _ = bone_reports(whole, whole, prepared.frames)
    inner = _longest_inner_gap(take, missing)
    bone = max(bones, key=lambda bone: bone.before.deviation or 0.0, default=None)
    measures: dict[str, float] = {
        "longest_gap": max(_longest_run(column)[0] for column in missing.T),
        "longest_inner_gap": round(inner.n_frames / take.rate, 3),
        "missing": _percent(missing),
        "replaced": _percent(~take.trusted & ~missing),
        "distrusted": _percent((~take.trusted & ~missing) | take.suspicious),
        "swaps": sum(finding.rule == "swap" for finding in take.findings) // 2,
        "bone_deviation": round((bone.before.deviation or 0.0) if bone else 0.0, 3),
        "rate": take.rate,
        "duration": round(len(take.trusted) / take.rate, 6),
    }
    breaches = [
        *_take_breaches(take, measures, str(inner), _farthest_off(take, bone), limits),
        *_gap_breaches(take, missing, _without_own_gap_limit(take, limits), limits.longest_gap),
        *(breach for name, own in limits.markers.items() for breach in _marker_breaches(take, missing, name, own)),
        *_required_breaches(take, limits),
    ]
    if limits.expected_error is not None:
        error, why = _self_check_error(prepared, settings)
        if error is not None:
            measures["expected_error"] = round(error, 3)
        breaches += _error_breaches(error, why, limits.expected_error)
    return Verdict(
        source=source,
        format=prepared.format,
        n_frames=len(whole.trusted),
        n_markers=len(take.markers),
        first_frame=whole.first_frame,
        judged=prepared.judged,
        measures=measures,
        breaches=tuple(breaches),
        findings=touching(whole.findings, prepared.frames),
        inspected=inspected and replace(inspected, format=prepared.format),
    )


def _percent(mask: Bools) -> float:
    """Return the share of True in a mask, in percent."""
    return round(100.0 * float(mask.mean()), 4) if mask.size else 0.0


def _longest_run(column: Bools) -> tuple[int, int]:
    """Return the length and the start of the longest run of a mask (F,)."""
    return max(((int(stop - start), int(start)) for start, stop in runs(column)), default=(0, 0))


@dataclass(frozen=True)
class _Gap:
    """A gap of a marker, with the numbers of its first and last frame in the file."""

    n_frames: int
    marker: str = ""
    first: int = 0
    last: int = 0

    def __str__(self) -> str:
        return f"{self.marker} in frames {self.first}-{self.last}"


def _longest_inner_gap(take: Take, missing: Bools) -> _Gap:
    """Return the longest run of missing samples (F, M) of a marker that is seen before and after it."""
    longest = _Gap(0)
    for marker, column in zip(take.markers, missing.T, strict=True):
        for start, stop in runs(column):
            if start > 0 and stop < len(column) and stop - start > longest.n_frames:
                longest = _Gap(int(stop - start), marker, *take.numbers(start, stop))
    return longest


def _farthest_off(take: Take, bone: BoneReport | None) -> str:
    """Return the name of a bone and the number of the frame in which its length is farthest off, as words."""
    if bone is None or bone.before.deviation is None:
        return ""
    ends = [take.markers.index(bone.start), take.markers.index(bone.end)]
    known = take.trusted[:, ends].all(axis=1)
    lengths = np.linalg.norm(take.positions[:, ends[0]] - take.positions[:, ends[1]], axis=1)
    frame = int(np.argmax(np.where(known, np.abs(lengths - bone.reference), -1.0)))
    return f"{bone.start} - {bone.end} in frame {frame + take.first_frame}"


def _take_breaches(
    take: Take, measures: dict[str, float], inner: str, bone: str, limits: TakeLimits
) -> Iterator[Breach]:
    """Yield the breaches of limits on the take as a whole.

    inner: the words for the marker and the frames of the longest inner gap. bone: those for the worst bone.
    """
    for name, what, which, unit, advice in (
        ("longest_inner_gap", "the longest inner gap is ", f", of {inner}", " s", "fill the take"),
        ("missing", "", " of all samples are missing", " %", "look at the camera set-up, or fill the take"),
        (
            "replaced",
            "",
            " of all samples would be replaced by a fill",
            " %",
            "read the findings; label the take anew",
        ),
        ("distrusted", "", " of all samples are distrusted or suspicious", " %", "read the findings"),
        ("swaps", "spans with swapped labels: ", "", "", "exchange them: mocapclean fill --fix-swaps"),
        ("bone_deviation", "a bone is off its length by ", f", {bone}", " mm", "look at the labels of its markers"),
    ):
        limit = getattr(limits, name)
        if limit is not None and measures[name] > limit:
            message = f"{what}{measures[name]:g}{unit}{which}, {limit:g}{unit} allowed"
            yield Breach(limit=name, found=measures[name], allowed=limit, message=message, advice=advice)
    if limits.rates and not any(np.isclose(take.rate, rate, rtol=1e-3) for rate in limits.rates):
        allowed = " or ".join(f"{rate:g}" for rate in limits.rates)
        message = f"the frame rate is {take.rate:g} Hz, {allowed} allowed"
        yield Breach(limit="rates", found=take.rate, message=message, advice="capture or export at that rate")
    duration = measures["duration"]
    if limits.shortest is not None and duration < limits.shortest:
        message = f"the take lasts {duration:g} s, at least {limits.shortest:g} s required"
        advice = "look whether the take was cut off"
        yield Breach(limit="shortest", found=duration, allowed=limits.shortest, message=message, advice=advice)
    if limits.longest is not None and duration > limits.longest:
        message = f"the take lasts {duration:g} s, {limits.longest:g} allowed"
        yield Breach(limit="longest", found=duration, allowed=limits.longest, message=message, advice="split it")
    if not take.trusted.any():
        message = "no sample of the take is trusted: all are missing or distrusted"
        yield Breach(limit="trusted", message=message, advice="read the findings; export the take again")
    if limits.units:
        for finding in take.findings:
            if finding.rule == "units" and finding.level == "error":
                yield Breach(limit="units", message=finding.message, advice=finding.advice)


def _marker_breaches(take: Take, missing: Bools, pattern: str, limits: MarkerLimits) -> Iterator[Breach]:
    """Yield the breaches of limits on the markers that a pattern matches."""
    columns = matching_columns(pattern, take.markers)
    if not columns:
        message = f"no marker is called {pattern}, which has limits of its own"
        yield Breach(limit="markers", marker=pattern, message=message, advice="correct the name in check.markers")
    yield from _gap_breaches(take, missing, columns, limits.longest_gap)
    for column in columns:
        for name, what, mask in (
            ("missing", "missing", missing),
            ("distrusted", "distrusted or suspicious", (~take.trusted & ~missing) | take.suspicious),
        ):
            limit, found = getattr(limits, name), _percent(mask[:, column])
            if limit is not None and found > limit:
                yield Breach(
                    limit=f"markers.{name}",
                    marker=take.markers[column],
                    found=found,
                    allowed=limit,
                    message=f"{take.markers[column]} is {what} in {found:g} % of the frames, {limit:g} % allowed",
                    advice="look at what hides it from the cameras",
                )


def _without_own_gap_limit(take: Take, limits: TakeLimits) -> list[int]:
    """Return the columns of the markers without a longest gap of their own."""
    own = {
        c
        for name, one in limits.markers.items()
        if one.longest_gap is not None
        for c in matching_columns(name, take.markers)
    }
    return [column for column in range(len(take.markers)) if column not in own]


def _gap_breaches(take: Take, missing: Bools, columns: list[int], limit: int | None) -> Iterator[Breach]:
    """Yield a breach for each of some markers whose longest gap is above the limit."""
    for column in columns:
        length, start = _longest_run(missing[:, column])
        if limit is not None and length > limit:
            first, last = take.numbers(start, start + length)
            yield Breach(
                limit="longest_gap",
                marker=take.markers[column],
                found=length,
                allowed=limit,
                message=f"{take.markers[column]} is missing for {length} frames ({first}-{last}), {limit} allowed",
                advice="fill it by hand or capture the take again",
            )


def _required_breaches(take: Take, limits: TakeLimits) -> Iterator[Breach]:
    """Yield a breach for each required pattern with a marker that is absent or never seen."""
    for pattern in limits.required:
        columns = matching_columns(pattern, take.markers)
        seen = [column for column in columns if take.trusted[:, column].any()]
        if not columns or len(seen) < len(columns):
            names = [take.markers[column] for column in columns if column not in seen] or [pattern]
            what = "never seen" if columns else "not there"
            yield Breach(
                limit="required",
                marker=names[0],
                message=f"{', '.join(names)}: {what}",
                advice="label it, or take it off check.required",
            )


def _self_check_error(prepared: Prepared, settings: Settings) -> tuple[float | None, str]:
    """Return the 3D RMS error, mm, of the method on hidden samples, or None and the reason."""
    take, wanted = prepared.selected, prepared.touched
    if not wanted.any():
        return 0.0, ""
    method = DEFAULT_METHOD if settings.method == "auto" else settings.method
    library = load(settings.dictionary) if settings.dictionary else None
    with progress.within("self-check"):
        checked = checked_before_filling(method, take, wanted, settings, library)
    error = checked.total.error
    return (error.rmse_3d, "") if error else (None, checked.because or "no hidden sample could be filled")


def _error_breaches(error: float | None, why: str, limit: float) -> Iterator[Breach]:
    """Yield a breach where the expected error of a fill is above its limit, or cannot be measured."""
    advice = "fill the longest gaps by hand, or look at the method"
    if error is None:
        message = f"the expected fill error cannot be measured: {why}"
        yield Breach(limit="expected_error", allowed=limit, message=message, advice=advice)
    elif error > limit:
        message = f"a fill is expected to be {error:.1f} mm off (3D RMS on hidden samples), {limit:g} allowed"
        yield Breach(limit="expected_error", found=error, allowed=limit, message=message, advice=advice)
