"""``mocapclean man``: the manual pages of the command, one for each of its commands."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, Command, examples, overwriting


@click.command("man", cls=Command, epilog=examples("mocapclean man --out-dir ~/.local/share/man/man1"))
@click.option("--out-dir", type=FILE, required=True, help="Folder for the pages, such as mocapclean-fill.1.")
@overwriting(default=False)
@guarded
def command(**options: Any) -> int:
    """Write the manual pages, which 'man mocapclean-fill' shows."""
    from mocapclean.cli.actions import man

    return man.work(**options)
