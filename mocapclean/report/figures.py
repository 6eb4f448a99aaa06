"""Figures of takes with matplotlib: the map of the samples, the curves of a marker, the lengths of bones."""

import importlib.util
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.errors import UsageError
from mocapclean.evaluation.metrics import INTERVAL_90
from mocapclean.pipeline.view import View
from mocapclean.report.vocabulary import KINDS, kind_of
from mocapclean.take.bones import bones_of
from mocapclean.take.status import Status, supplied

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".png", ".svg", ".pdf")
"""The formats of a figure."""

# Sizes in inches and characters; chosen by hand, for a page of A4.
_WIDTH, _ROW, _MARGIN, _CURVE = 10.0, 0.16, 1.2, 1.9
_SHEET_COLUMNS = 2
_NAME = 18
_MOST_BONES = 6
_MARGIN_SECONDS = 0.35  # shown on both sides of a gap, and as much as the gap is long
_HATCHES = {"cross": "xx", "right_diagonal_line": "//", "dot": "..", "": ""}
_COLOURS = {kind.name: kind.colour for kind in KINDS}
_INK = "#1b1f24"
_TRACK = "#eceff3"


def require_matplotlib() -> None:
    """Raise UsageError unless matplotlib is installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise UsageError("a figure needs matplotlib. Run pip install '.[plots]' in the clone of mocapclean.")


def save(figure: "Figure", path: Path) -> None:
    """Write a figure in the format that its suffix names."""
    figure.savefig(path, dpi=120, format=path.suffix[1:].lower())


def sheet(views: Sequence[View], names: Sequence[str]) -> "Figure":
    """Return the maps of the samples of one take, or of several on one sheet."""
    n_columns = 1 if len(views) == 1 else _SHEET_COLUMNS
    n_rows = -(-len(views) // n_columns)
    tallest = max(len(view.before.markers) for view in views)
    figure = _figure(_WIDTH, n_rows * min(_MARGIN + tallest * _ROW, _WIDTH))
    for number, (view, name) in enumerate(zip(views, names, strict=True)):
        axes = figure.add_subplot(n_rows, n_columns, number + 1)
        _map(axes, view)
        axes.set_title(_text(name, 60), fontsize=10, loc="left")
    used = sorted({kind_of(Status(code)) for view in views for code in np.unique(view.codes).tolist()})
    _legend(figure, [kind for kind in KINDS if kind.name in used])
    return figure


def curves(view: View, marker: str, frames: tuple[int, int] | None = None) -> "Figure":
    """Return X, Y and Z of a marker before and after, with the 90 % band of what was filled.

    frames: indices of the first and last one; the whole take without.
    """
    column = view.before.markers.index(marker)
    start, stop = frames or (0, len(view.codes) - 1)
    shown = slice(max(start, 0), min(stop, len(view.codes) - 1) + 1)
    numbers = np.arange(len(view.codes))[shown] + view.before.first_frame
    before = np.where(view.in_file[shown, column, None], view.before.positions[shown, column], np.nan)
    after = np.where(view.in_output[shown, column, None], view.after.positions[shown, column], np.nan)
    filled = supplied(view.codes)[shown, column]
    replaced = view.codes[shown, column] == Status.REPLACED
    figure = _figure(_WIDTH, 3 * _CURVE + 0.8)
    all_axes: Any = figure.subplots(3, 1, sharex=True)
    for axis, axes in enumerate(all_axes):
        if view.sd is not None:
            half = INTERVAL_90 * view.sd[shown, column]
            band = (after[:, axis] - half, after[:, axis] + half)
            axes.fill_between(numbers, *band, color=_COLOURS["filled"], alpha=0.22, lw=0, label="90 % band")
        axes.plot(numbers, before[:, axis], color=_COLOURS["measured"], lw=3.5, alpha=0.75, label="before")
        axes.plot(numbers, np.where(filled, np.nan, after[:, axis]), color=_INK, lw=1.2, label="after")
        joined = np.where(_wider(filled), after[:, axis], np.nan)
        axes.plot(numbers, joined, color=_COLOURS["filled"], lw=2, ls=(0, (3, 1.5)), label="filled")
        if replaced.any():
            axes.plot(
                numbers[replaced],
                before[replaced, axis],
                "s",
                ms=4,
                color=_COLOURS["replaced"],
                label="replaced sample",
            )
        axes.set_ylabel(f"{'XYZ'[axis]}, mm")
        axes.grid(alpha=0.3)
    all_axes[-1].set_xlabel("frame")
    all_axes[0].set_title(_text(marker, 60), fontsize=11, loc="left")
    all_axes[0].legend(fontsize=8, ncols=5, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    return figure


def bone_lengths(view: View) -> "Figure":
    """Return the lengths over time, before and after, of the bones that deviate most after."""
    _, bones = bones_of(view.before)
    if not bones:
        raise UsageError("no bones are known, and no pair of markers is rigid in this take.")
    columns = {name: column for column, name in enumerate(view.before.markers)}
    numbers = np.arange(len(view.codes)) + view.before.first_frame
    lengths = []
    for bone in bones:
        ends = [columns[bone.start], columns[bone.end]]
        lengths.append(
            [_length(view.before.positions, view.in_file, ends), _length(view.after.positions, view.in_output, ends)]
        )
    worst = [
        np.nanmax(np.abs(after - bone.length), initial=0.0) for bone, (_, after) in zip(bones, lengths, strict=True)
    ]
    order = np.argsort(worst)[::-1][:_MOST_BONES]
    figure = _figure(_WIDTH, len(order) * 1.5 + 0.8)
    all_axes: Any = figure.subplots(len(order), 1, sharex=True, squeeze=False)[:, 0]
    for axes, number in zip(all_axes, order, strict=True):
        bone, (before, after) = bones[number], lengths[number]
        axes.plot(numbers, before, color=_COLOURS["replaced"], lw=2.5, alpha=0.8, label="before")
        axes.plot(numbers, after, color=_COLOURS["filled"], lw=1, label="after")
        axes.axhline(bone.length, color=_INK, lw=0.8, ls=":", label="reference")
        axes.set_ylabel("mm")
        axes.set_title(_text(f"{bone.start} – {bone.end}", 60), fontsize=9, loc="left")
        axes.grid(alpha=0.3)
    all_axes[0].legend(fontsize=8, ncols=3, loc="lower right", bbox_to_anchor=(1, 1), frameon=False)
    all_axes[-1].set_xlabel("frame")
    return figure


def around(view: View, marker: str, frame: int) -> tuple[int, int]:
    """Return the first and last index to show of the gap of a marker at an index, with a margin on both sides."""
    column = view.before.markers.index(marker)
    gap = next(
        ((int(a), int(b)) for a, b in runs(~view.before.trusted[:, column]) if a <= frame < b), (frame, frame + 1)
    )
    margin = max(round(_MARGIN_SECONDS * view.before.rate), gap[1] - gap[0])
    return max(gap[0] - margin, 0), min(gap[1] + margin, len(view.codes)) - 1


def small_map(view: View, caption: str) -> str:
    """Return the map of the samples as a small picture in HTML (SVG), for notebooks; it needs no matplotlib."""
    n_frames, n_markers = view.codes.shape
    width, row = 640.0, min(12.0, max(1.5, 320.0 / n_markers))
    areas = [f'<rect width="{width:g}" height="{n_markers * row:.1f}" fill="{_TRACK}"/>']
    for column, start, stop, kind in _areas(view):
        x, wide = start / n_frames * width, max((stop - start) / n_frames * width, 1.0)
        name = escape(f"{_text(view.before.markers[column], 60)}: {kind}")
        areas.append(
            f'<rect x="{x:.1f}" y="{column * row:.1f}" width="{wide:.1f}" height="{row * 0.85:.1f}" '
            f'fill="{_COLOURS[kind]}"><title>{name}</title></rect>'
        )
    return (
        f'<figure style="margin:0"><svg xmlns="http://www.w3.org/2000/svg" role="img" width="{width:g}" '
        f'height="{n_markers * row:.0f}" aria-label="{escape(caption)}">{"".join(areas)}</svg>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _map(axes: "Axes", view: View) -> None:
    """Draw a row for each marker and an area for each run of samples that is not measured."""
    first, (n_frames, n_markers) = view.before.first_frame, view.codes.shape
    axes.barh(range(n_markers), n_frames, left=first - 0.5, height=0.8, color=_TRACK)
    kinds = {kind.name: kind for kind in KINDS}
    least = n_frames / 1500  # a span is at least as wide as a dot of the picture
    for column, start, stop, kind in _areas(view):
        style = kinds[kind]
        axes.barh(
            column, max(stop - start, least), left=first + start - 0.5, height=0.8, color=style.colour,
            hatch=_HATCHES[style.hatch], edgecolor="white", lw=0,
        )  # fmt: skip
    for event in view.events:
        axes.axvline(event.frame + first, color=_INK, lw=0.7, ls=":")
        label = f"{event.context[:1]} {event.label}".strip()
        axes.text(event.frame + first, -0.8, _text(label, _NAME), fontsize=6, rotation=30, va="bottom")
    axes.set_yticks(range(n_markers), [_text(name, _NAME) for name in view.before.markers], fontsize=6)
    axes.set_ylim(n_markers - 0.4, -0.6)
    axes.set_xlim(first - 0.5, first + n_frames - 0.5)
    axes.set_xlabel("frame", fontsize=8)


def _areas(view: View) -> list[tuple[int, int, int, str]]:
    """Return column, start, stop and kind of each run of samples of one status that is not measured."""
    areas = []
    for code in np.unique(view.codes).tolist():
        if code != Status.MEASURED:
            for column in np.flatnonzero((view.codes == code).any(axis=0)).tolist():
                spans = runs(view.codes[:, column] == code)
                areas += [(column, int(start), int(stop), kind_of(Status(code))) for start, stop in spans]
    return areas


def _legend(figure: "Figure", kinds: Sequence[Any]) -> None:
    from matplotlib.patches import Patch

    handles = [Patch(facecolor=k.colour, hatch=_HATCHES[k.hatch], edgecolor="white", label=k.name) for k in kinds]
    figure.legend(handles=handles, loc="outside upper right", ncols=len(handles), fontsize=8, frameon=False)


def _length(positions: Floats, known: Bools, ends: list[int]) -> Floats:
    """Return the distance (F,) of two markers, NaN where one is not there."""
    distance = np.linalg.norm(positions[:, ends[0]] - positions[:, ends[1]], axis=1)
    return np.where(known[:, ends].all(axis=1), distance, np.nan)


def _wider(mask: Bools) -> Bools:
    """Return a mask (F,) with one more frame on both sides of each run."""
    wider = mask.copy()
    wider[1:] |= mask[:-1]
    wider[:-1] |= mask[1:]
    return wider


def _text(text: str, most: int) -> str:
    """Return a text of at most some characters that matplotlib does not read as mathematics."""
    short = text if len(text) <= most else f"{text[: most - 1]}…"
    return short.replace("$", r"\$")


def _figure(width: float, height: float) -> "Figure":
    """Return an empty figure that belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")
