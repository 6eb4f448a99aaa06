"""Options that several commands share, and how they become Settings."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import click

from mocapclean.config.loading import resolve
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError

Command = TypeVar("Command", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)


_READING = (
    click.option("--skeleton", type=FILE, help="Joints and bones: the .asf of an .amc; for C3D an .asf or .bvh."),
    click.option("--rate", type=float, help="Frames per second, for files that do not say (AMC: 120)."),
    click.option("--unit", help="Unit of length of a BVH file: mm, cm (default), m, in, or mm per unit."),
    click.option("--gaps", type=FILE, help="CSV of spans you distrust: marker,first,last (the file's frame numbers)."),
    click.option("--markers", multiple=True, metavar="NAME", help="Repair only these markers; wildcards allowed."),
    click.option("--exclude", multiple=True, metavar="NAME", help="Leave these markers out altogether."),
    click.option("--detect/--no-detect", default=None, help="Look for samples that cannot be trusted (default: yes)."),
    click.option("--config", type=FILE, help="YAML file with any of these options and every method's parameters."),
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="KEY=VALUE",
        help="A parameter of the method, or a.b=value.",
    ),
)


def reading(command: Command) -> Command:
    """Add the options that decide what is read and what is trusted."""
    for option in reversed(_READING):
        command = option(command)
    return command


def settings(config: Path | None, assignments: tuple[str, ...], options: dict[str, Any]) -> Settings:
    """Settings from the configuration file and the options that were given."""
    for name in ("markers", "exclude"):
        options[name] = [part.strip() for value in options[name] for part in value.split(",") if part.strip()] or None
    for name in ("include_files", "exclude_files"):
        options[name] = options.get(name) or None
    for name, number in (("unit", float), ("workers", int)):
        with suppress(ValueError):
            options[name] = number(options.get(name) or "")
    return resolve(config, {key: value for key, value in options.items() if value is not None}, assignments)


def distinct(files: tuple[Path, ...]) -> tuple[Path, ...]:
    """The inputs as given; raises UsageError for folders."""
    for path in files:
        if path.is_dir():
            raise UsageError(f"{path}: an input must be a file. Got a folder.")
    return files
