"""``mocapclean config``: a configuration with every key, its JSON Schema, and what a configuration comes to."""

from typing import Any

import click

from mocapclean.cli.guard import guarded
from mocapclean.cli.options import FILE, OUTPUT, Command, examples, overwriting


@click.command(
    "config",
    cls=Command,
    epilog=examples(
        "mocapclean config --init -o studio.yaml",
        "mocapclean config --schema -o mocapclean.schema.json",
        "mocapclean config --show studio.yaml",
    ),
)
@click.option("--init", is_flag=True, help="All keys with today's defaults, as YAML with comments.")
@click.option("--schema", is_flag=True, help="The JSON Schema of a configuration, for editors.")
@click.option("--show", type=FILE, help="All keys with the values that this configuration gives them, as YAML.")
@click.option("-o", "--output", type=FILE, help=f"{OUTPUT}YAML or JSON (default: standard output).")
@overwriting(default=False)
@guarded
def command(**options: Any) -> int:
    """Write a configuration, or its schema: give one of --init, --schema and --show."""
    from mocapclean.cli.actions import config

    return config.work(**options)
