"""``mocapclean inspect``: show the content of a take and its gaps; no file is written."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import AS_JSON, FILE, TAKES, Command, examples, reading, verbose
from mocapclean.cli.stages import stages_shown


@click.command(
    "inspect",
    cls=Command,
    epilog=examples("mocapclean inspect take.c3d", "mocapclean inspect captures/ --json | jq .takes[].counts"),
)
@click.argument("files", nargs=-1, required=True, type=FILE, metavar=TAKES)
@AS_JSON
@verbose("every gap and finding")
@reading
@guarded
def command(**options: Any) -> int:
    """Show markers, frames, rate, gaps and findings of takes (.c3d, .bvh, .amc, .trc, .csv, .tsv). Writes nothing.

    A folder stands for all takes in it and below it.
    """
    with stages_shown(options):
        from mocapclean.cli.actions import inspect

        return inspect.work(**options)
