"""The two losses of the truncated nuclear norm papers, and the tables and panels over them.

Random: a share of the markers is out in each frame. Blocks: 10 random markers are out in each block of frames, our
reading of "continuous" loss.
"""

from collections.abc import Mapping

from mocapclean.experiments.jobs import Loss
from mocapclean.experiments.results import Curve, Panel, Results, Table, number

RATIOS = (0.2, 0.3, 0.4, 0.5, 0.6)
LENGTHS = (20, 30, 40, 50, 60)
OUT = 10


def losses(quick: bool) -> list[Loss]:
    """All ratios and lengths, or the first and the last of each."""
    step = 4 if quick else 1
    return [
        *(Loss(ratio=ratio) for ratio in RATIOS[::step]),
        *(Loss(length=length, out=OUT) for length in LENGTHS[::step]),
    ]


def over_losses(results: Results, measure: str, title: str) -> Table:
    """A measure for each take and method: ratios, then lengths; the mean over seeds."""
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
    """A measure over the ratio, and over the length of blocks."""
    return tuple(
        Panel(title=title, x_label=x_label, y_label=y_label, curves=curves(results, part, measure))
        for part, title, x_label in (
            ("ratio", "random loss", "share of markers out"),
            ("length", f"{OUT} markers out in blocks", "frames"),
        )
    )


def curves(results: Results, part: str, measure: str) -> tuple[Curve, ...]:
    """One curve for each method over this part of the cell."""
    found = []
    for label in results.labels:
        mine = results.where(label=label)
        points = [(float(value), mine.where(**{part: value}).mean(measure)) for (value,) in mine.cells(part)]
        known = [(x, y) for x, y in points if y is not None]
        if known:
            found.append(Curve(label=label, x=[x for x, _ in known], y=[y for _, y in known]))
    return tuple(found)
