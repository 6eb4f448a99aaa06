"""The action of ``mocapclean convert``: write takes as files of another format."""

from collections import Counter
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from mocapclean import formats, progress
from mocapclean.batch.inputs import find
from mocapclean.cli.actions.arguments import resolve_settings
from mocapclean.cli.guard import complain
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import make_folder
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.pipeline.conversion import Conversion, convert
from mocapclean.report.record import line
from mocapclean.report.text import converted


def work(files: tuple[Path, ...], to: str | None, out_dir: Path | None, as_json: bool, **options: Any) -> int:
    """Convert takes and print what became of each; return the exit code."""
    settings = resolve_settings(None, (), {**options, "exclude": ()})
    code = 0
    for source, output in _pairs(files, out_dir, to):
        try:
            done = convert(source, output, settings, to)
            progress.finish()
        except MocapcleanError as error:
            progress.finish()
            complain(str(error))
            code = max(code, error.exit_code)
            continue
        click.echo(line(_row(done)) if as_json else converted(done))
    return code


def _pairs(files: tuple[Path, ...], out_dir: Path | None, to: str | None) -> list[tuple[Path, Path]]:
    """Return the inputs and their outputs; raise UsageError where these are not known or are not different."""
    if out_dir is None:
        if len(files) != 2 or any(path.is_dir() for path in files):
            raise UsageError("give an input and an output, or --out-dir for several inputs.")
        return [(files[0], files[1])]
    if to not in DECLARATIONS:
        raise UsageError(f"--out-dir must go with --to and one of {', '.join(DECLARATIONS)}. Got {to!r}.")
    suffix = DECLARATIONS[to].suffixes[0]
    pairs = [(each.path, out_dir / each.relative.with_suffix(suffix)) for each in find(files, skip=out_dir)]
    if not pairs:
        raise UsageError(f"the inputs must hold at least one take ({', '.join(formats.suffixes())}). Got none.")
    outputs = Counter(output for _, output in pairs)
    if twice := next((output for output, count in outputs.items() if count > 1), None):
        raise UsageError(f"{twice}: two results would have this name. Convert them one by one.")
    for folder in dict.fromkeys(output.parent for output in outputs):
        make_folder(folder)
    return pairs


def _row(done: Conversion) -> dict[str, Any]:
    """Return the record of a converted take as JSON has it."""
    row = {field.name: getattr(done, field.name) for field in fields(done) if field.name != "findings"}
    return {name: str(value) if isinstance(value, Path) else value for name, value in row.items()}
