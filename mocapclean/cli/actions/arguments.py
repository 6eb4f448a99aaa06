"""The settings of a command, made of its arguments."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from mocapclean.batch.inputs import SUFFIXES, find
from mocapclean.config.loading import resolve
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.units import MILLIMETRES


def resolve_settings(config: Path | None, assignments: tuple[str, ...], options: dict[str, Any]) -> Settings:
    """Return the settings of a command, from its configuration file and its options. None: an option not given."""
    for name in ("markers", "exclude"):
        options[name] = names(options[name]) or None
    for name in ("include_files", "exclude_files", "learn_from"):
        options[name] = options.get(name) or None
    for name, number in (("unit", float), ("workers", int)):
        with suppress(ValueError):
            options[name] = number(options.get(name) or "")
    return resolve(config, {key: value for key, value in options.items() if value is not None}, assignments)


def names(values: Iterable[str]) -> list[str]:
    """Return the names of a repeatable option, of which each value may hold several with commas."""
    return [part.strip() for value in values for part in value.split(",") if part.strip()]


def millimetres(unit: str) -> float:
    """Return the millimetres of a unit of length, given by name or as a number; raise UsageError for another text."""
    try:
        return MILLIMETRES[unit] if unit in MILLIMETRES else float(unit)
    except ValueError:
        raise UsageError(f"--unit must be {', '.join(MILLIMETRES)}, or millimetres per unit. Got {unit!r}.") from None


def takes_in(files: Iterable[Path]) -> list[Path]:
    """Return all takes in some files and folders, each once; raise UsageError if there is none."""
    files = tuple(files)
    for path in files:
        if not path.exists():
            raise UsageError(f"{path}: the file or folder must exist. It does not.")
    takes = list(dict.fromkeys(each.path for each in find(files)))
    if not takes:
        raise UsageError(f"the folders must hold at least one take ({', '.join(SUFFIXES)}). Got none.")
    return takes
