"""One take against limits: read, detect, measure, and say which limits it does not keep; nothing is written."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from time import perf_counter

import numpy as np

from mocapclean.arrays import Bools, runs
from mocapclean.config.settings import DEFAULT_METHOD, MarkerLimits, Settings, TakeLimits
from mocapclean.dictionaries.dictionary import load
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import self_check
from mocapclean.pipeline.choose import solver
from mocapclean.pipeline.outcome import Breach, Verdict
from mocapclean.pipeline.repair import examine
from mocapclean.pipeline.summary import account
from mocapclean.take import Take
from mocapclean.take.bones import subject_of


@dataclass(frozen=True)
class Check:
    """Hold takes against the limits of ``settings.check``; work for a pool."""

    settings: Settings

    def __call__(self, job: Path) -> Verdict:
        """Whether a take keeps the limits. What cannot be read is a breach, not an exception."""
        started = perf_counter()
        try:
            verdict = _check(job, self.settings)
        except MocapcleanError as fault:
            advice = "correct what the message names, or export the take again"
            verdict = unchecked(job, "readable", str(fault), advice)
        return replace(verdict, seconds=perf_counter() - started)

    def undo(self, job: Path) -> None:
        """Nothing: a check leaves nothing behind."""


def unchecked(source: Path, limit: str, message: str, advice: str) -> Verdict:
    """The verdict on a take of which nothing is known but what was in the way."""
    return Verdict(source=source, breaches=(Breach(limit=limit, message=message, advice=advice),))


def _check(source: Path, settings: Settings) -> Verdict:
    _, play = examine(source, settings)
    limits = settings.check
    missing = play.distrusted_by("missing") | play.distrusted_by("user")
    outcome = account(play, play, play, np.ones_like(play.trusted), settings)
    bone = max(outcome.bones, key=lambda bone: bone.before.deviation or 0.0, default=None)
    measures: dict[str, float] = {
        "longest_gap": max(_longest(column)[0] for column in missing.T),
        "missing": _percent(missing),
        "distrusted": _percent(~play.trusted & ~missing),
        "swaps": sum(finding.rule == "swap" for finding in play.findings) // 2,
        "bone_deviation": round((bone.before.deviation or 0.0) if bone else 0.0, 3),
        "rate": play.rate,
        "duration": round(len(play.trusted) / play.rate, 6),
    }
    breaches = [
        *_of_take(play, measures, f"{bone.start} - {bone.end}" if bone else "", limits),
        *_gaps(play, missing, _others(play, limits), limits.longest_gap),
        *(breach for name, own in limits.markers.items() for breach in _of_markers(play, missing, name, own)),
        *_required(play, limits),
    ]
    if limits.expected_error is not None:
        error, why = _expected_error(play, settings)
        if error is not None:
            measures["expected_error"] = round(error, 3)
        breaches += _of_error(error, why, limits.expected_error)
    return Verdict(
        source=source,
        format=play.origin.format if play.origin else source.suffix[1:].lower(),
        n_frames=len(play.trusted),
        n_markers=len(play.markers),
        first_frame=play.first_frame,
        measures=measures,
        breaches=tuple(breaches),
        findings=play.findings,
    )


def _percent(mask: Bools) -> float:
    return round(100.0 * float(mask.mean()), 4) if mask.size else 0.0


def _longest(column: Bools) -> tuple[int, int]:
    """The length and the start of the longest run of a mask (F,)."""
    return max(((int(stop - start), int(start)) for start, stop in runs(column)), default=(0, 0))


def _of_take(play: Take, measures: dict[str, float], bone: str, limits: TakeLimits) -> Iterator[Breach]:
    """The limits on the take as a whole."""
    for name, what, unit, advice in (
        ("missing", "of all samples are missing", " %", "look at the camera set-up, or fill the take"),
        ("distrusted", "of all samples cannot be trusted", " %", "read the findings"),
        ("swaps", "pairs of labels are swapped", "", "exchange them: mocapclean fill --fix-swaps"),
        ("bone_deviation", f"off its length is {bone}", " mm", "look at the labels of its markers"),
    ):
        limit = getattr(limits, name)
        if limit is not None and measures[name] > limit:
            message = f"{measures[name]:g}{unit} {what}, {limit:g}{unit} allowed"
            yield Breach(limit=name, found=measures[name], allowed=limit, message=message, advice=advice)
    if limits.rates and not any(np.isclose(play.rate, rate, rtol=1e-3) for rate in limits.rates):
        allowed = " or ".join(f"{rate:g}" for rate in limits.rates)
        message = f"the frame rate is {play.rate:g} Hz, {allowed} allowed"
        yield Breach(limit="rates", found=play.rate, message=message, advice="capture or export at that rate")
    duration = measures["duration"]
    if limits.shortest is not None and duration < limits.shortest:
        message = f"the take lasts {duration:g} s, at least {limits.shortest:g} asked for"
        yield Breach(
            limit="shortest", found=duration, allowed=limits.shortest, message=message, advice="was it cut off?"
        )
    if limits.longest is not None and duration > limits.longest:
        message = f"the take lasts {duration:g} s, {limits.longest:g} allowed"
        yield Breach(limit="longest", found=duration, allowed=limits.longest, message=message, advice="split it")
    if limits.units:
        for finding in play.findings:
            if finding.rule == "units" and finding.level == "error":
                yield Breach(limit="units", message=finding.message, advice=finding.advice)


def _of_markers(play: Take, missing: Bools, pattern: str, limits: MarkerLimits) -> Iterator[Breach]:
    """The limits on the markers of a name."""
    columns = _columns(play, pattern)
    if not columns:
        message = f"no marker is called {pattern}, which has limits of its own"
        yield Breach(limit="markers", marker=pattern, message=message, advice="correct the name in check.markers")
    yield from _gaps(play, missing, columns, limits.longest_gap)
    for column in columns:
        for name, what, mask in (
            ("missing", "missing", missing),
            ("distrusted", "distrusted", ~play.trusted & ~missing),
        ):
            limit, found = getattr(limits, name), _percent(mask[:, column])
            if limit is not None and found > limit:
                yield Breach(
                    limit=f"markers.{name}",
                    marker=play.markers[column],
                    found=found,
                    allowed=limit,
                    message=f"{play.markers[column]} is {what} in {found:g} % of the frames, {limit:g} % allowed",
                    advice="look at what hides it from the cameras",
                )


def _others(play: Take, limits: TakeLimits) -> list[int]:
    """The markers that have no longest gap of their own."""
    own = {c for name, one in limits.markers.items() if one.longest_gap is not None for c in _columns(play, name)}
    return [column for column in range(len(play.markers)) if column not in own]


def _gaps(play: Take, missing: Bools, columns: list[int], limit: int | None) -> Iterator[Breach]:
    """The longest gap of each of some markers that is above the limit."""
    for column in columns:
        length, start = _longest(missing[:, column])
        if limit is not None and length > limit:
            first, last = play.numbers(start, start + length)
            yield Breach(
                limit="longest_gap",
                marker=play.markers[column],
                found=length,
                allowed=limit,
                message=f"{play.markers[column]} is missing for {length} frames ({first}-{last}), {limit} allowed",
                advice="fill it by hand or capture the take again",
            )


def _required(play: Take, limits: TakeLimits) -> Iterator[Breach]:
    for pattern in limits.required:
        columns = _columns(play, pattern)
        seen = [column for column in columns if play.trusted[:, column].any()]
        if not columns or len(seen) < len(columns):
            names = [play.markers[column] for column in columns if column not in seen] or [pattern]
            what = "never seen" if columns else "not there"
            yield Breach(
                limit="required",
                marker=names[0],
                message=f"{', '.join(names)}: {what}",
                advice="label it, or take it off check.required",
            )


def _columns(play: Take, pattern: str) -> list[int]:
    return [
        column
        for column, name in enumerate(play.markers)
        if name == pattern or fnmatchcase(name, pattern) or fnmatchcase(subject_of(name)[1], pattern)
    ]


def _expected_error(play: Take, settings: Settings) -> tuple[float | None, str]:
    """The 3D error, mm, of the method on hidden samples of the take, or why there is none."""
    if play.trusted.all():
        return 0.0, ""
    method = DEFAULT_METHOD if settings.method == "auto" else settings.method
    library = load(settings.dictionary) if settings.dictionary else None
    solve = solver(method, settings, library)
    found = self_check.check(play, np.ones_like(play.trusted), solve, settings.hiding)
    error = found.total.error
    return (error.rmse_3d, "") if error else (None, found.because or "nothing that was hidden could be filled")


def _of_error(error: float | None, why: str, limit: float) -> Iterator[Breach]:
    advice = "fill the longest gaps by hand, or look at the method"
    if error is None:
        message = f"the expected fill error cannot be measured: {why}"
        yield Breach(limit="expected_error", allowed=limit, message=message, advice=advice)
    elif error > limit:
        message = f"a fill is expected to be {error:.1f} mm off (3D RMS on hidden samples), {limit:g} allowed"
        yield Breach(limit="expected_error", found=error, allowed=limit, message=message, advice=advice)
