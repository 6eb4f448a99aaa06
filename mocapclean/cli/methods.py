"""``mocapclean methods``: every method, its parameters, defaults and reference."""

from typing import Any

import click

from mocapclean.cli.guard import guarded


@click.command("methods")
@click.argument("names", nargs=-1)
@guarded
def command(**options: Any) -> int:
    """List the methods, or show NAMES in full: model, source, parameters."""
    from mocapclean.cli.work import methods

    return methods.work(**options)
