"""The settings of a command, made of its arguments."""

from contextlib import suppress
from pathlib import Path
from typing import Any

from mocapclean.config.loading import resolve
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.units import MILLIMETRES


def resolve_settings(config: Path | None, assignments: tuple[str, ...], options: dict[str, Any]) -> Settings:
    """Return the settings of a command, from its configuration file and its options. None: an option not given."""
    for name in ("markers", "exclude"):
        options[name] = [part.strip() for value in options[name] for part in value.split(",") if part.strip()] or None
    for name in ("include_files", "exclude_files", "learn_from"):
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
