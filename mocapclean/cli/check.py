"""``mocapclean check``: takes against limits, for people and for CI; reads and detects, writes nothing to the takes."""

import contextlib
from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from mocapclean.batch.inputs import named
from mocapclean.batch.pool import Answers, run
from mocapclean.cli.batching import limits, stopping, working
from mocapclean.cli.guard import complain, guarded
from mocapclean.cli.options import FILE, reading, settings
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import check_output, new_file
from mocapclean.pipeline.check import Check, unchecked
from mocapclean.pipeline.outcome import Verdict
from mocapclean.report.junit import junit
from mocapclean.report.record import checked
from mocapclean.report.text import verdict


@click.command("check")
@click.argument("places", nargs=-1, required=True, type=FILE, metavar="FILES_OR_FOLDERS...")
@click.option("--junit", "junit_file", type=FILE, help="Where JUnit XML goes: a suite a folder, a case a take.")
@click.option("--json", "json_file", type=FILE, help="Where everything goes as JSON.")
@click.option("--overwrite/--no-overwrite", default=None, help="Replace these two if they exist.")
@click.option("-q", "--quiet/--no-quiet", default=None, help="Print only takes that fail.")
@click.option("-v", "--verbose/--no-verbose", default=None, help="Print every breach, and what to do.")
@working
@reading
@guarded
def command(
    places: tuple[Path, ...],
    junit_file: Path | None,
    json_file: Path | None,
    config: Path | None,
    assignments: tuple[str, ...],
    **options: Any,
) -> int:
    """Check takes (.c3d, .bvh, .amc; all in a folder and below it) against the limits in check: of the configuration.

    Exits 0 when all pass, 1 when some fail, 2 when the command or the configuration is wrong.
    """
    chosen = settings(config, assignments, options)
    takes = _takes(places)
    _check_outputs([path for path in (junit_file, json_file) if path], [*takes, *([config] if config else [])], chosen)
    verdicts = dict[Path, Verdict]()
    with stopping() as stop:
        answers: Answers[Path, Verdict] = run(Check(chosen), takes, limits(chosen, alone=len(takes) == 1), stop)
        with contextlib.closing(answers):
            _follow(answers, verdicts, chosen, len(takes))
    if stop.signal:
        complain(f"interrupted after {len(verdicts)} of {len(takes)} takes; nothing was written.")
        return 128 + stop.signal
    in_order = [verdicts[take] for take in takes]
    _write(in_order, junit_file, json_file, chosen)
    failed = sum(not found.passes for found in in_order)
    click.echo(f"{len(in_order) - failed} of {len(in_order)} takes pass")
    return int(failed > 0)


def _takes(places: tuple[Path, ...]) -> list[Path]:
    for place in places:
        if not place.exists():
            raise UsageError(f"{place}: the file or folder must exist. It does not.")
    takes = list(dict.fromkeys(found.path for found in named(places)))
    if not takes:
        raise UsageError("there must be takes in the folders. Got none.")
    return takes


def _check_outputs(outputs: list[Path], inputs: list[Path], chosen: Settings) -> None:
    """Refuse outputs that would replace an input, each other, or what is there already."""
    for path in outputs:
        for kept in inputs:
            check_output(path, kept, True)
        check_output(path, None, chosen.overwrite)
    if len(outputs) == 2 and outputs[0] == outputs[1]:
        raise UsageError(f"{outputs[0]}: --junit and --json must be different files.")


def _follow(answers: Answers[Path, Verdict], verdicts: dict[Path, Verdict], chosen: Settings, n_takes: int) -> None:
    """Keep and tell each verdict as it comes."""
    with tqdm(total=n_takes, unit="take", disable=None if n_takes > 1 and not chosen.quiet else True) as bar:
        for source, answer in answers:
            if isinstance(answer, MocapcleanError):
                answer = unchecked(source, "finished", f"{source}: {answer}", "raise --timeout or --memory")
            verdicts[source] = answer
            if not (chosen.quiet and answer.passes):
                with tqdm.external_write_mode():
                    click.echo(verdict(answer, verbose=chosen.verbose))
            bar.update()


def _write(verdicts: list[Verdict], junit_file: Path | None, json_file: Path | None, chosen: Settings) -> None:
    if junit_file:
        with new_file(junit_file) as part:
            part.write_bytes(junit(verdicts))
    if json_file:
        with new_file(json_file) as part:
            part.write_text(checked(verdicts, chosen.model_dump(mode="json")), encoding="utf-8")
