"""``mocapclean inspect``: what is in a take and where its gaps are; writes nothing."""

from pathlib import Path
from typing import Any

import click

from mocapclean.cli.guard import complain, guarded
from mocapclean.cli.options import FILE, distinct, reading, settings
from mocapclean.errors import MocapcleanError
from mocapclean.pipeline.outcome import Outcome
from mocapclean.pipeline.repair import inspect
from mocapclean.report import record
from mocapclean.report.text import inspection


@click.command("inspect")
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--json", "as_json", is_flag=True, help="Print the whole record as JSON.")
@click.option("-v", "--verbose/--no-verbose", default=None, help="Print every gap and finding.")
@reading
@guarded
def command(
    files: tuple[Path, ...], config: Path | None, assignments: tuple[str, ...], as_json: bool, **options: Any
) -> int:
    """Show what FILES hold: markers, frames, rate, gaps, and what trust detection says. Writes nothing."""
    chosen = settings(config, assignments, options)
    outcomes, code = [], 0
    for path in distinct(files):
        try:
            outcome = inspect(path, chosen)
        except MocapcleanError as fault:
            complain(str(fault))
            code = max(code, fault.exit_code)
            outcome = Outcome(source=path, status="failed", error=str(fault), exit_code=fault.exit_code)
        outcomes.append(outcome)
        if not as_json and outcome.status != "failed":
            click.echo(inspection(outcome, verbose=chosen.verbose))
    if as_json:
        for piece in record.text(map(record.row, outcomes), chosen.model_dump(mode="json")):
            click.echo(piece, nl=False)
    return code
