"""The action of ``mocapclean plot``: figures of takes as PNG, SVG or PDF; the takes are not changed."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.batch.inputs import find
from mocapclean.cli.actions.arguments import resolve_settings
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.files import check_output, new_file
from mocapclean.pipeline.prepare import matching, prepare
from mocapclean.pipeline.repair import repair
from mocapclean.pipeline.view import View, view
from mocapclean.report import figures
from mocapclean.take.status import counted


def work(
    files: tuple[Path, ...],
    marker: str | None,
    bones: bool,
    config: Path | None,
    assignments: tuple[str, ...],
    **options: Any,
) -> int:
    """Draw a figure of takes; return the exit code."""
    figures.require_matplotlib()
    settings = resolve_settings(config, assignments, options)
    output = options["output"]
    takes = [each.path for each in find(files)]
    if output.suffix.lower() not in figures.SUFFIXES:
        raise UsageError(f"{output}: a figure must be {', '.join(figures.SUFFIXES)}.")
    if not takes or ((marker or bones) and len(takes) > 1) or (marker and bones):
        raise UsageError("give takes, and for --marker or --bones one take and one of both options.")
    for take in takes:
        check_output(output, take, settings.overwrite)
    figure = _of_one(takes[0], marker, settings) if marker or bones else _sheet(takes, settings)
    with new_file(output) as part:
        figures.save(figure, part)
    return 0


def _sheet(takes: list[Path], settings: Settings) -> Any:
    """Return the maps of takes as they are in their files."""
    views = []
    for path in takes:
        prepared = prepare(path, settings)
        take = prepared.selected
        views.append(view(prepared.whole, take, prepared.whole, take, prepared.codes, None))
    return figures.sheet(views, [path.name for path in takes])


def _of_one(path: Path, marker: str | None, settings: Settings) -> Any:
    """Return the curves of a marker, or the bones, of a take that is filled for the figure."""
    one = _filled(path, settings)
    if marker is None:
        return figures.bone_lengths(one)
    (name,) = [one.before.markers[column] for column in matching(marker, one.before, "--marker")][:1]
    inside = np.flatnonzero(counted(one.codes).any(axis=1))
    return figures.curves(one, name, (int(inside[0]), int(inside[-1])))


def _filled(path: Path, settings: Settings) -> View:
    """Return the view of a take that is repaired into a temporary folder."""
    views: list[View] = []
    with tempfile.TemporaryDirectory(prefix="mocapclean-") as folder:
        outcome = repair(path, Path(folder) / path.name, settings, keep=views.append)
    if outcome.status == "failed" or not views:
        raise MocapcleanError(outcome.error)
    return views[0]
