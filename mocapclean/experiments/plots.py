"""Draw figures with matplotlib, an optional extra, as PNG and SVG; the same results give the same bytes."""

from collections import Counter
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.experiments.results import Figure, Panel
from mocapclean.files import new_file

_PANEL_WIDTH = 5.2  # inches
_PANEL_HEIGHT = 4.2  # inches
_TICK_HEIGHT = 0.15  # inches for each named row of a picture
_MOST_MARKED_POINTS = 40  # a curve of more points is drawn without marks
_ROUNDING = 1e-8  # values below this share of the largest are rounding errors


def can_draw() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


def draw(figure: Figure, folder: Path) -> Iterator[Path]:
    """Write ``folder/name.png`` and ``.svg``, replacing existing files, and yield their paths."""
    import matplotlib
    from matplotlib.figure import Figure as Canvas

    height = max(_PANEL_HEIGHT, *(_TICK_HEIGHT * len(panel.ticks) for panel in figure.panels))
    with matplotlib.rc_context({"svg.hashsalt": "mocapclean", "font.size": 9}):
        canvas = Canvas(figsize=(_PANEL_WIDTH * len(figure.panels), height), layout="constrained")
        canvas.suptitle(figure.title)
        axes = canvas.subplots(1, len(figure.panels), squeeze=False)[0]
        _paint(canvas, axes, figure)
        for suffix, metadata in ((".png", {"Software": None}), (".svg", {"Date": None, "Creator": None})):
            path = folder / f"{figure.name}{suffix}"
            with new_file(path) as part:
                canvas.savefig(part, format=suffix[1:], dpi=120, metadata=metadata)
            yield path


def _paint(canvas: Any, axes: Any, figure: Figure) -> None:
    """Draw all panels; pictures share one scale of colours."""
    pictures = [np.asarray(p.picture) for p in figure.panels if p.picture is not None]
    finite = [picture[np.isfinite(picture)] for picture in pictures]
    low, high = (min(p.min() for p in finite), max(p.max() for p in finite)) if finite else (0.0, 1.0)
    image = None
    for axis, panel in zip(axes, figure.panels, strict=True):
        axis.set(title=panel.title, xlabel=panel.x_label, ylabel=panel.y_label)
        if panel.picture is None:
            _lines(axis, panel)
            continue
        image = axis.imshow(
            panel.picture, aspect="auto", origin="lower", extent=panel.extent, vmin=low, vmax=high, interpolation="none"
        )
        axis.set_yticks(range(len(panel.ticks)), panel.ticks, fontsize=6 if len(panel.ticks) > 12 else 9)
    if image is not None:
        canvas.colorbar(image, ax=list(axes))


def _lines(axis: Any, panel: Panel) -> None:
    """Draw the curves of a panel; a dashed curve has the colour of the solid curve with its label."""
    colours = {label: f"C{k}" for k, label in enumerate(dict.fromkeys(curve.label for curve in panel.curves))}
    paired = Counter(curve.label for curve in panel.curves)
    for curve in panel.curves:
        few = len(curve.x) <= _MOST_MARKED_POINTS
        axis.plot(
            curve.x,
            curve.y,
            label=None if curve.dashed and paired[curve.label] > 1 else curve.label,
            color=colours[curve.label],
            linestyle="--" if curve.dashed else "-",
            marker="." if few else None,
            linewidth=1.2 if few else 0.8,
        )
    if panel.log_x:
        axis.set_xscale("log")
    if panel.log_y:
        axis.set_yscale("log")
        _above_rounding(axis, panel)
    else:
        axis.set_ylim(bottom=0)
    if panel.ticks:
        axis.set_xticks(range(len(panel.ticks)), panel.ticks)
    if panel.curves:
        axis.legend(fontsize=8)
    axis.grid(visible=True, alpha=0.3)


def _above_rounding(axis: Any, panel: Panel) -> None:
    """Cut a logarithmic axis off above values that are rounding errors."""
    values = np.concatenate([np.asarray(curve.y, dtype=np.float64) for curve in panel.curves] or [np.zeros(0)])
    highest = float(values.max(initial=0.0))
    if 0.0 <= values.min(initial=highest) < _ROUNDING * highest:
        axis.set_ylim(bottom=_ROUNDING * highest)
