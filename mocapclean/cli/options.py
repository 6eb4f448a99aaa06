"""Options that several commands share, and the settings made of them."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import click

from mocapclean.config.loading import resolve
from mocapclean.config.settings import MILLIMETRES, Settings
from mocapclean.errors import UsageError

Command = TypeVar("Command", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)

_READING = (
    click.option("--skeleton", type=FILE, help="Joints and bones: the .asf of an .amc; for C3D an .asf or .bvh."),
    click.option("--rate", type=float, help="Frames per second, for files without a rate (AMC: 120)."),
    click.option(
        "--unit",
        help="Unit of length of BVH (default cm), or instead of that in a C3D: mm, cm, m, in, or mm.",
    ),
    click.option("--gaps", type=FILE, help="CSV of spans to distrust: marker,first,last (the file's frame numbers)."),
    click.option("--markers", multiple=True, metavar="NAME", help="Repair only these markers; wildcards allowed."),
    click.option("--exclude", multiple=True, metavar="NAME", help="Ignore these markers; wildcards allowed."),
    click.option("--detect/--no-detect", default=None, help="Look for untrustworthy samples (default: yes)."),
    click.option("--config", type=FILE, help="YAML file with options of this command and parameters of methods."),
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="KEY=VALUE",
        help="Set a parameter of the method, or any key as a.b=value.",
    ),
)


def reading(command: Command) -> Command:
    """Add the options that decide what is read and which samples are trusted."""
    for option in reversed(_READING):
        command = option(command)
    return command


def resolve_settings(config: Path | None, assignments: tuple[str, ...], options: dict[str, Any]) -> Settings:
    """Return the settings of a command, from its configuration file and its options. None: an option not given."""
    for name in ("markers", "exclude"):
        options[name] = [part.strip() for value in options[name] for part in value.split(",") if part.strip()] or None
    for name in ("include_files", "exclude_files"):
        options[name] = options.get(name) or None
    for name, number in (("unit", float), ("workers", int)):
        with suppress(ValueError):
            options[name] = number(options.get(name) or "")
    return resolve(config, {key: value for key, value in options.items() if value is not None}, assignments)


def millimetres(unit: str) -> float:
    """Return the millimetres of a unit of length, given by name or as a number; raise UsageError for another text."""
    try:
        return MILLIMETRES[unit] if unit in MILLIMETRES else float(unit)
    except ValueError:
        raise UsageError(f"--unit must be {', '.join(MILLIMETRES)}, or millimetres per unit. Got {unit!r}.") from None


def refuse_folders(files: tuple[Path, ...]) -> tuple[Path, ...]:
    """Return the inputs; raise UsageError if one of them is a folder."""
    for path in files:
        if path.is_dir():
            raise UsageError(f"{path}: an input must be a file. Got a folder.")
    return files
