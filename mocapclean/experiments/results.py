"""Results of an experiment: rows to select and average, and the tables and figures made of them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mocapclean.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Row:
    """The result of one finished trial. series: reads its curves; empty if the trial has none."""

    take: str
    method: str
    variant: str
    parameters: str
    cell: Mapping[str, str]
    seed: int
    values: Mapping[str, float]
    series: Callable[[], Mapping[str, Floats]] = field(repr=False)

    @property
    def label(self) -> str:
        """Return the method and its variant."""
        return f"{self.method} {self.variant}".rstrip()


@dataclass(frozen=True)
class Results:
    """The rows of finished trials, in the order of the trials."""

    rows: tuple[Row, ...]

    def where(self, *, take: str | None = None, label: str | None = None, **cell: object) -> "Results":
        """Return the rows with this take, label and values of the cell; None matches all."""
        wanted = {name: str(value) for name, value in cell.items()}
        return Results(
            tuple(
                row
                for row in self.rows
                if (take is None or row.take == take)
                and (label is None or row.label == label)
                and all(row.cell.get(name) == value for name, value in wanted.items())
            )
        )

    def mean(self, measure: str) -> float | None:
        """Return the mean of a measure over all rows that have it; None if there are none."""
        values = [row.values[measure] for row in self.rows if measure in row.values]
        return float(np.mean(values)) if values else None

    @property
    def takes(self) -> list[str]:
        """Return the takes in the order of the rows."""
        return list(dict.fromkeys(row.take for row in self.rows))

    @property
    def labels(self) -> list[str]:
        """Return the methods with their variants, in the order of the rows."""
        return list(dict.fromkeys(row.label for row in self.rows))

    def cells(self, *names: str) -> list[tuple[str, ...]]:
        """Return the distinct values of these parts of the cells, in the order of the rows that have all of them."""
        cells = (row.cell for row in self.rows if all(name in row.cell for name in names))
        return list(dict.fromkeys(tuple(cell[name] for name in names) for cell in cells))


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table of text: a title, a header and rows."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A line of a figure: its label in the legend and its points. dashed: the values are printed ones or the truth."""

    label: str
    x: Sequence[float] | Floats
    y: Sequence[float] | Floats
    dashed: bool = False


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Axes of a figure with curves, or with a picture (rows, columns) whose values are shown as colours.

    extent: left, right, bottom, top of the picture. ticks: names of its rows from the bottom up, or of the x axis.
    """

    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...] = ()
    log_x: bool = False
    log_y: bool = False
    picture: Floats | None = None
    extent: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0)
    ticks: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Panels side by side. name: of the file, without its suffix."""

    name: str
    title: str
    panels: tuple[Panel, ...]


def number(value: float | None, digits: int = 3) -> str:
    """Return a value as text with at least this many significant digits, without an exponent; "-" for None."""
    if value is None or not np.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(decimals, 6)}f}"


def geometric_mean(ratios: Iterable[float]) -> float | None:
    """Return the geometric mean of positive ratios; None if there are none."""
    logs = np.log(list(ratios))
    return float(np.exp(logs.mean())) if logs.size else None


def with_printed(ours: Sequence[float | None], printed: Sequence[float | None]) -> tuple[list[str], list[str], str]:
    """Return our values and the printed values as text, and the geometric mean of ours / printed over all pairs."""
    both = [(a, b) for a, b in zip(ours, printed, strict=True) if a and b]
    ratio = number(geometric_mean(a / b for a, b in both))
    return [number(a) for a in ours], [number(b) for b in printed], ratio
