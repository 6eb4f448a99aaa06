"""``mocapclean check``: check takes against limits, for people and for CI; the takes are not changed."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, reading, working
from mocapclean.cli.stages import stages_shown


@click.command("check")
@click.argument("places", nargs=-1, required=True, type=FILE, metavar="FILES_OR_FOLDERS...")
@click.option("--junit", "junit_file", type=FILE, help="Write JUnit XML: a suite per folder, a case per take.")
@click.option("--json", "json_file", type=FILE, help="Write all verdicts, measures and findings as JSON.")
@click.option("--html", type=FILE, help="Write a page with pictures of all takes, for any browser.")
@click.option("--overwrite/--no-overwrite", default=None, help="Replace these files if they exist.")
@click.option("-q", "--quiet/--no-quiet", default=None, help="Print only failing takes, and the totals.")
@click.option("-v", "--verbose/--no-verbose", default=None, help="Print every exceeded limit, and what to do.")
@working
@reading
@guarded
def command(**options: Any) -> int:
    """Check takes (.c3d, .bvh, .amc) against the limits under check: in the configuration.

    A folder stands for all takes in it and below it. Exits 0 when all takes pass, 1 when some fail, 2 when the command
    or the configuration is wrong.
    """
    with stages_shown(options):
        from mocapclean.cli.work import check

        return check.work(**options)
