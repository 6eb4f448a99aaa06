"""``mocapclean report``: the page of a report that exists already, with pictures of the takes whose files are found."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, OUTPUT, TAKES, Command, examples, overwriting, verbose


@click.command("report", cls=Command, epilog=examples("mocapclean report all.json captures/ clean/ -o report.html"))
@click.argument("report", type=FILE)
@click.argument("files", nargs=-1, type=FILE, metavar=f"[{TAKES}]")
@click.option("-o", "--output", type=FILE, required=True, help=f"{OUTPUT}a page, .html.")
@overwriting(default=False)
@verbose()
@guarded
def command(**options: Any) -> int:
    """Write the page of REPORT, a JSON report of fill or check, for any browser.

    Captures, repaired files and sidecars that are not in the places that the report names are looked for by name
    among FILES_OR_FOLDERS. A take whose files are not found has its numbers in the page, without
    pictures.
    """
    from mocapclean.cli.actions import report

    return report.work(**options)
