"""``mocapclean check``: takes against limits, for people and for CI; reads and detects, writes nothing to the takes."""

from pathlib import Path
from typing import Any

import click
from tqdm import tqdm

from mocapclean.batch.inputs import named
from mocapclean.checking import check
from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, reading, settings
from mocapclean.config import Settings
from mocapclean.errors import UsageError
from mocapclean.formats import check_output, new_file
from mocapclean.records import Verdict
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
    for place in places:
        if not place.exists():
            raise UsageError(f"{place}: the file or folder must exist. It does not.")
    takes = list(dict.fromkeys(found.path for found in named(places)))
    if not takes:
        raise UsageError("there must be takes in the folders. Got none.")
    outputs = [path for path in (junit_file, json_file) if path]
    for path in outputs:
        for kept in (*takes, *([config] if config else [])):
            check_output(path, kept, True)
        check_output(path, None, chosen.overwrite)
    if len(outputs) == 2 and outputs[0] == outputs[1]:
        raise UsageError(f"{outputs[0]}: --junit and --json must be different files.")
    verdicts = []
    for source in tqdm(takes, unit="take", disable=None if len(takes) > 1 and not chosen.quiet else True):
        found = check(source, chosen)
        verdicts.append(found)
        if not (chosen.quiet and found.passes):
            with tqdm.external_write_mode():
                click.echo(verdict(found, verbose=chosen.verbose))
    _write(verdicts, junit_file, json_file, chosen)
    failed = sum(not found.passes for found in verdicts)
    click.echo(f"{len(verdicts) - failed} of {len(verdicts)} takes pass")
    return int(failed > 0)


def _write(verdicts: list[Verdict], junit_file: Path | None, json_file: Path | None, chosen: Settings) -> None:
    if junit_file:
        with new_file(junit_file) as part:
            part.write_bytes(junit(verdicts))
    if json_file:
        with new_file(json_file) as part:
            part.write_text(checked(verdicts, chosen.model_dump(mode="json")), encoding="utf-8")
