"""The action of ``mocapclean inspect``: show the content of a take and its gaps; no file is written."""

from pathlib import Path
from typing import Any

import click

from mocapclean import progress
from mocapclean.cli.actions.arguments import resolve_settings, takes_in
from mocapclean.cli.guard import complain
from mocapclean.errors import MocapcleanError
from mocapclean.pipeline.inspection import inspect
from mocapclean.pipeline.outcome import Outcome
from mocapclean.report import record
from mocapclean.report.text import inspection


def work(
    files: tuple[Path, ...], config: Path | None, assignments: tuple[str, ...], as_json: bool, **options: Any
) -> int:
    """Print the content of takes and their gaps; return the exit code."""
    settings = resolve_settings(config, assignments, options)
    code = 0
    for path in takes_in(files):
        try:
            outcome = inspect(path, settings)
            progress.finish()
        except MocapcleanError as error:
            progress.finish()
            complain(str(error))
            code = max(code, error.exit_code)
            outcome = Outcome(source=path, status="failed", error=str(error), exit_code=error.exit_code)
        if as_json:
            click.echo(record.line(record.row(outcome)))
        elif outcome.status != "failed":
            click.echo(inspection(outcome, verbose=settings.verbose))
    return code
