"""``mocapclean inspect``: show the content of a take and its gaps; no file is written."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, reading
from mocapclean.cli.stages import stages_shown


@click.command("inspect")
@click.argument("files", nargs=-1, required=True, type=FILE)
@click.option("--json", "as_json", is_flag=True, help="Print all rows as JSON, as in a report.")
@click.option("-v", "--verbose/--no-verbose", default=None, help="Print every gap and finding.")
@reading
@guarded
def command(**options: Any) -> int:
    """Show markers, frames, rate, gaps and findings of FILES (.c3d, .bvh, .amc). Writes nothing."""
    with stages_shown(options):
        from mocapclean.cli.work import inspect

        return inspect.work(**options)
