"""The action of ``mocapclean config``: a configuration with every key, its JSON Schema, and what one comes to."""

import json
from pathlib import Path

import click

from mocapclean.config import template
from mocapclean.config.loading import resolve
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.files import check_output, new_file


def work(init: bool, schema: bool, show: Path | None, output: Path | None, overwrite: bool) -> int:
    """Write a configuration or its schema; return the exit code."""
    if init + schema + (show is not None) != 1:
        raise UsageError("give one of --init, --schema and --show.")
    if output:
        check_output(output, show, overwrite)
    if schema:
        text = json.dumps(template.schema(), indent=1, ensure_ascii=False) + "\n"
    else:
        text = template.as_yaml(resolve(show, {}) if show else Settings())
    if output is None:
        click.echo(text, nl=False)
        return 0
    with new_file(output) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    return 0
