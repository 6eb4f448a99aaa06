"""``mocapclean report``: the page of a report that exists already, with pictures of the takes whose files are found."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE


@click.command("report")
@click.argument("report", type=FILE)
@click.argument("takes", nargs=-1, type=FILE, metavar="[TAKES]...")
@click.option("-o", "--output", type=FILE, required=True, help="The page to write.")
@click.option("--overwrite", is_flag=True, help="Replace the page if it exists.")
@guarded
def command(**options: Any) -> int:
    """Write the page of REPORT, a JSON report of fill or check, for any browser.

    Captures, repaired files and sidecars that are not in the places that the report names are looked for by name
    among TAKES, which are files and folders. A take whose files are not found has its numbers in the page, without
    pictures.
    """
    from mocapclean.cli.work import report

    return report.work(**options)
