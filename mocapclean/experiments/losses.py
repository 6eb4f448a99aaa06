"""The two losses of the truncated nuclear norm papers (Hu et al. 2017, Imamura & Okuda 2018), their tables and panels.

Random loss: a share of the markers is hidden in each frame. Continuous loss: 10 random markers are hidden in each block
of frames; the papers do not define it further, so this is our reading.
"""

from collections.abc import Mapping

from mocapclean.experiments.results import Curve, Panel, Results, Table, number
from mocapclean.experiments.trials import Loss

RATIOS = (0.2, 0.3, 0.4, 0.5, 0.6)
"""Shares of the markers hidden in each frame; Hu et al. 2017."""

LENGTHS = (20, 30, 40, 50, 60)
"""Frames of a block; Hu et al. 2017."""

OUT = 10
"""Markers hidden in each block; Hu et al. 2017."""


def losses(quick: bool) -> list[Loss]:
    """Return all losses; with ``quick`` only the first and the last ratio and length."""
    step = 4 if quick else 1
    return [
        *(Loss(ratio=ratio) for ratio in RATIOS[::step]),
        *(Loss(length=length, out=OUT) for length in LENGTHS[::step]),
    ]


def over_losses(results: Results, measure: str, title: str) -> Table:
    """Return a table of a measure, mean over seeds: takes and methods over ratios and lengths."""
    cells: list[Mapping[str, str]] = [
        *({"ratio": ratio} for (ratio,) in results.cells("ratio")),
        *({"length": length} for (length,) in results.cells("length")),
    ]
    rows = [
        (take, label, *(number(results.where(take=take, label=label, **cell).mean(measure)) for cell in cells))
        for take in results.takes
        for label in results.where(take=take).labels
    ]
    heads = [f"{100 * float(c['ratio']):.0f} %" if "ratio" in c else f"{c['length']} fr" for c in cells]
    return Table(title=title, header=("take", "method", *heads), rows=tuple(rows))


def panels(results: Results, measure: str, y_label: str) -> tuple[Panel, ...]:
    """Return a panel of a measure over the ratio, and one over the length of blocks."""
    return tuple(
        Panel(title=title, x_label=x_label, y_label=y_label, curves=curves(results, part, measure))
        for part, title, x_label in (
            ("ratio", "random loss", "share of markers hidden"),
            ("length", f"{OUT} markers hidden in blocks", "frames"),
        )
    )


def curves(results: Results, part: str, measure: str) -> tuple[Curve, ...]:
    """Return a curve of a measure for each method, over the values of ``part`` of the cells."""
    curves = []
    for label in results.labels:
        subset = results.where(label=label)
        points = [(float(value), subset.where(**{part: value}).mean(measure)) for (value,) in subset.cells(part)]
        known = [(x, y) for x, y in points if y is not None]
        if known:
            curves.append(Curve(label=label, x=[x for x, _ in known], y=[y for _, y in known]))
    return tuple(curves)
