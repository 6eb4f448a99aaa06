"""``mocapclean methods``: every method, its parameters, defaults and reference."""

from typing import Any

import click

from mocapclean.cli import completing
from mocapclean.cli.guard import guarded
from mocapclean.cli.options import Command, examples, verbose


@click.command("methods", cls=Command, epilog=examples("mocapclean methods", "mocapclean methods kriging"))
@click.argument("names", nargs=-1, shell_complete=completing.methods)
@click.option("--check", is_flag=True, help="Try the laws of all methods on NAMES, such as one of your own package.")
@verbose()
@guarded
def command(**options: Any) -> int:
    """List the methods, or show NAMES in full: model, source, parameters.

    Methods of other installed packages are listed too. --check exits with code 1 if a law that must hold is broken.
    """
    from mocapclean.cli.actions import methods

    return methods.work(**options)
