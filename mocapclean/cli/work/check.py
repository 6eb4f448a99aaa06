"""The work of ``mocapclean check``: check takes against limits, for people and for CI; the takes are not changed."""

import contextlib
from collections.abc import Callable
from itertools import takewhile
from pathlib import Path
from typing import Any

import click

from mocapclean.batch.inputs import find
from mocapclean.batch.pool import JobResults, run
from mocapclean.cli.guard import complain
from mocapclean.cli.work.arguments import resolve_settings
from mocapclean.cli.work.batching import TakeBar, one_take_alone, stopping, worker_limits
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import check_output, make_folder, new_file
from mocapclean.pipeline.check import CheckTake, unchecked
from mocapclean.pipeline.outcome import Verdict
from mocapclean.pipeline.view import View
from mocapclean.report.record import checked
from mocapclean.report.text import verdict


def work(
    places: tuple[Path, ...],
    junit_file: Path | None,
    json_file: Path | None,
    config: Path | None,
    assignments: tuple[str, ...],
    **options: Any,
) -> int:
    """Check takes against limits, print the verdicts and write them; return the exit code."""
    settings = resolve_settings(config, assignments, options)
    takes = _takes(places)
    written = [path for path in (junit_file, json_file, settings.html) if path]
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
            _print_verdicts(results, verdicts, settings, takes)
    if stop.signal:
        complain(f"Interrupted after {len(verdicts)} of {len(takes)} takes. No file was written.")
        return 128 + stop.signal
    in_order = [verdicts[take] for take in takes]
    _write_files(in_order, junit_file, json_file, settings)
    if page:
        page.write(in_order)
    n_failed = sum(not each.passes for each in in_order)
    click.echo(f"{len(in_order) - n_failed} of {len(in_order)} takes pass")
    return int(n_failed > 0)


def _takes(places: tuple[Path, ...]) -> list[Path]:
    """Return all takes in some files and folders; raise UsageError if there is none."""
    for place in places:
        if not place.exists():
            raise UsageError(f"{place}: the file or folder must exist. It does not.")
    takes = list(dict.fromkeys(each.path for each in find(places)))
    if not takes:
        raise UsageError("the folders must hold at least one take. Got none.")
    return takes


def _check_outputs(outputs: list[Path], inputs: list[Path], settings: Settings) -> None:
    """Raise UsageError for outputs that would replace an input, each other, or an existing file."""
    for path in outputs:
        for source in inputs:
            check_output(path, source, True)
        check_output(path, None, settings.overwrite)
    if len(set(outputs)) < len(outputs):
        raise UsageError(f"{outputs[0]}: --junit, --json and --html must be different files.")


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
    results: JobResults[Path, Verdict], verdicts: dict[Path, Verdict], settings: Settings, takes: list[Path]
) -> None:
    """Add each verdict to ``verdicts`` when it arrives, and print it as soon as those of all earlier takes are printed.

    Workers finish in any order, and a log must be the same in every run.
    """
    n_printed = 0
    with TakeBar(len(takes), quiet=settings.quiet) as bar:
        for source, result in results:
            if isinstance(result, MocapcleanError):
                result = unchecked(source, "finished", f"{source}: {result}", "raise --timeout or --memory")
            verdicts[source] = result
            ready = list(takewhile(verdicts.__contains__, takes[n_printed:]))
            n_printed += len(ready)
            with bar.aside():
                _print(ready, verdicts, settings)
            bar.advance()
    # After an interruption those of takes behind an unfinished one are left.
    _print([take for take in takes[n_printed:] if take in verdicts], verdicts, settings)


def _print(takes: list[Path], verdicts: dict[Path, Verdict], settings: Settings) -> None:
    """Print the verdicts of some takes; with --quiet those alone that fail."""
    for take in takes:
        if not (settings.quiet and verdicts[take].passes):
            click.echo(verdict(verdicts[take], verbose=settings.verbose))


def _write_files(verdicts: list[Verdict], junit_file: Path | None, json_file: Path | None, settings: Settings) -> None:
    if junit_file:
        from mocapclean.report.junit import junit  # the XML library is not needed without it

        with new_file(junit_file) as part:
            part.write_bytes(junit(verdicts))
    if json_file:
        with new_file(json_file) as part:
            part.write_text(checked(verdicts, settings.as_json()), encoding="utf-8")
