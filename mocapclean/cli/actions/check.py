"""The action of ``mocapclean check``: check takes against limits, for people and for CI; the takes are not changed."""

import contextlib
import os
from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path
from typing import Any

import click

from mocapclean.batch.pool import JobResults, run
from mocapclean.cli.actions.arguments import resolve_settings, takes_in
from mocapclean.cli.actions.batching import TakeBar, one_take_alone, stopping, worker_limits
from mocapclean.cli.guard import complain
from mocapclean.config.presets import PRESETS
from mocapclean.config.settings import Settings, TakeLimits
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import check_output, make_folder, new_file
from mocapclean.pipeline.check import CheckTake, unchecked
from mocapclean.pipeline.outcome import Verdict
from mocapclean.pipeline.view import View
from mocapclean.report import ci
from mocapclean.report.record import checked, line, verdict_row
from mocapclean.report.text import verdict


def work(
    files: tuple[Path, ...],
    preset: str | None,
    report_file: Path | None,
    junit_file: Path | None,
    summary: Path | None,
    annotations: str | None,
    as_json: bool,
    config: Path | None,
    assignments: tuple[str, ...],
    **options: Any,
) -> int:
    """Check takes against limits, print the verdicts and write them; return the exit code."""
    named = (f"check.preset={preset}",) if preset else ()
    settings = resolve_settings(config, (*named, *assignments), options)
    takes = takes_in(files)
    reports = _Reports(report=report_file, junit=junit_file, summary=summary)
    written = [path for path in (report_file, junit_file, summary, settings.html) if path]
    _check_outputs(written, [*takes, *([config] if config else [])], settings)
    page = _Page(settings.html, takes) if settings.html else None
    verdicts = dict[Path, Verdict]()
    with stopping() as stop:
        limits = worker_limits(settings, alone=len(takes) == 1)
        one_take_alone(len(takes), limits, quiet=settings.quiet)
        results: JobResults[Path, Verdict] = run(
            CheckTake(settings, page.keep() if page else None), takes, limits, stop
        )
        with contextlib.closing(results):
            _print_verdicts(results, verdicts, settings, takes, as_json=as_json)
    if stop.signal:
        complain(f"Interrupted after {len(verdicts)} of {len(takes)} takes. No file was written.")
        return 128 + stop.signal
    in_order = [verdicts[take] for take in takes]
    reports.write(in_order, settings)
    if page:
        page.write(in_order)
    if (annotations or ("github" if os.environ.get("GITHUB_ACTIONS") == "true" else "none")) == "github":
        for line in ci.annotations(in_order):
            click.echo(line, err=True)
    n_failed = sum(not each.passes for each in in_order)
    if not settings.quiet and not as_json:
        click.echo(f"{len(in_order) - n_failed} of {len(in_order)} takes pass; {_limits(settings)}")
    return int(n_failed > 0)


def _limits(settings: Settings) -> str:
    """Return the words for where the limits come from."""
    check = settings.check
    if check.preset is None:
        return "the default limits" if check == TakeLimits() else "limits of the configuration"
    others = [name for name, value in PRESETS[check.preset].items() if getattr(check, name) != value]
    return f"limits of the preset {check.preset}{' but for ' if others else ''}{', '.join(others)}"


def _check_outputs(outputs: list[Path], inputs: list[Path], settings: Settings) -> None:
    """Raise UsageError for outputs that would replace an input, each other, or an existing file."""
    for path in outputs:
        for source in inputs:
            check_output(path, source, True)
        check_output(path, None, settings.overwrite)
    if len(set(outputs)) < len(outputs):
        raise UsageError(f"{outputs[0]}: --report, --junit, --summary and --html must be different files.")


class _Page:
    """The page of a check, with the data of its takes."""

    def __init__(self, path: Path, takes: list[Path]) -> None:
        from mocapclean.report.page.building import require_library
        from mocapclean.report.page.places import data_file

        require_library()
        self.path = path
        self.files = {take: data_file(path, str(take)) for take in takes}

    def keep(self) -> Callable[[Verdict, View | None], None]:
        """Return what a worker does with a checked take."""
        from mocapclean.report.page.checking import KeepChecked
        from mocapclean.report.page.places import data_folder

        make_folder(data_folder(self.path))
        return KeepChecked(self.files)

    def write(self, verdicts: list[Verdict]) -> None:
        """Write the page of all verdicts."""
        from mocapclean.report.page.building import PageTake, write_page
        from mocapclean.report.page.checking import checked_row
        from mocapclean.report.page.places import MOST_EMBEDDED, remove_data

        embed = len(verdicts) <= MOST_EMBEDDED
        files = {verdict.source: path for verdict in verdicts if (path := self.files[verdict.source]).exists()}
        takes = (PageTake(row=checked_row(verdict), data=files.get(verdict.source)) for verdict in verdicts)
        write_page(self.path, takes, embed=embed)
        if embed:
            remove_data(self.path, list(files.values()))


def _print_verdicts(
    results: JobResults[Path, Verdict],
    verdicts: dict[Path, Verdict],
    settings: Settings,
    takes: list[Path],
    *,
    as_json: bool,
) -> None:
    """Add each verdict to ``verdicts`` when it arrives, and print it as soon as those of all earlier takes are printed.

    Workers finish in any order, and a log must be the same in every run.
    """
    n_printed = 0
    with TakeBar(len(takes), quiet=settings.quiet) as bar:
        for source, result in results:
            if isinstance(result, MocapcleanError):
                result = unchecked(source, "finished", str(result).removesuffix("."), "raise --timeout or --memory")
            verdicts[source] = result
            ready = list(takewhile(verdicts.__contains__, takes[n_printed:]))
            n_printed += len(ready)
            with bar.aside():
                _print(ready, verdicts, settings, as_json=as_json)
            bar.advance()
    # After an interruption those of takes behind an unfinished one are left.
    _print([take for take in takes[n_printed:] if take in verdicts], verdicts, settings, as_json=as_json)


def _print(takes: list[Path], verdicts: dict[Path, Verdict], settings: Settings, *, as_json: bool) -> None:
    """Print the verdicts of some takes, as words or as lines of JSON; with --quiet those alone that fail."""
    for take in takes:
        if not (settings.quiet and verdicts[take].passes):
            text = line(verdict_row(verdicts[take])) if as_json else None
            click.echo(text or verdict(verdicts[take], verbose=settings.verbose))


@dataclass(frozen=True, kw_only=True)
class _Reports:
    """The files of a check: JSON, JUnit XML, and a summary in Markdown."""

    report: Path | None
    junit: Path | None
    summary: Path | None

    def write(self, verdicts: list[Verdict], settings: Settings) -> None:
        """Write those that are asked for; the summary of a step of GitHub Actions is added to its file."""
        if self.junit:
            from mocapclean.report.junit import junit  # the XML library is not needed without it

            with new_file(self.junit) as part:
                part.write_bytes(junit(verdicts, settings.check.preset))
        if self.report:
            with new_file(self.report) as part:
                part.write_text(checked(verdicts, settings.as_json()), encoding="utf-8", newline="\n")
        if self.summary:
            with new_file(self.summary) as part:
                part.write_text(self._markdown(verdicts, settings), encoding="utf-8", newline="\n")
        elif step := os.environ.get("GITHUB_STEP_SUMMARY"):
            try:
                with Path(step).open("a", encoding="utf-8", newline="\n") as file:
                    file.write(self._markdown(verdicts, settings))
            except OSError as fault:
                raise UsageError(f"{step}: GITHUB_STEP_SUMMARY cannot be written: {fault.strerror or fault}.") from None

    @staticmethod
    def _markdown(verdicts: list[Verdict], settings: Settings) -> str:
        words = _limits(settings)
        return ci.markdown(verdicts, f"{words[0].upper()}{words[1:]}.")
