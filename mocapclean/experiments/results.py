"""What came out: rows to choose from and to average, and the tables and figures made of them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mocapclean.arrays import Floats


@dataclass(frozen=True, kw_only=True)
class Row:
    """One finished job. series: read its columns, empty where it kept none."""

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
        """The method and its variant."""
        return f"{self.method} {self.variant}".rstrip()


@dataclass(frozen=True)
class Results:
    """Rows in the order of their jobs."""

    rows: tuple[Row, ...]

    def where(self, *, take: str | None = None, label: str | None = None, **cell: object) -> "Results":
        """The rows of a take, a label and a cell; what is not named may be anything."""
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
        """The mean of a measure, over seeds and whatever else was left open; None without a value."""
        values = [row.values[measure] for row in self.rows if measure in row.values]
        return float(np.mean(values)) if values else None

    @property
    def takes(self) -> list[str]:
        """The takes in order."""
        return list(dict.fromkeys(row.take for row in self.rows))

    @property
    def labels(self) -> list[str]:
        """The methods and variants in order."""
        return list(dict.fromkeys(row.label for row in self.rows))

    def cells(self, *names: str) -> list[tuple[str, ...]]:
        """The distinct values of these parts of a cell, in order, of the rows that have them all."""
        found = (row.cell for row in self.rows if all(name in row.cell for name in names))
        return list(dict.fromkeys(tuple(cell[name] for name in names) for cell in found))


@dataclass(frozen=True, kw_only=True)
class Table:
    """A title, and aligned columns of text."""

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A line: its name in the legend, and its points; dashed for what is printed or given."""

    label: str
    x: Sequence[float] | Floats
    y: Sequence[float] | Floats
    dashed: bool = False


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Axes with curves, or with a picture (rows, columns) in the colours of its values.

    extent: left, right, bottom, top of the picture; ticks: names of its rows from the bottom up.
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
    """Panels side by side; name: that of its file."""

    name: str
    title: str
    panels: tuple[Panel, ...]


def number(value: float | None, digits: int = 3) -> str:
    """A value for a table: this many significant digits at least, no exponent; "-" for none."""
    if value is None or not np.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(decimals, 6)}f}"


def geometric_mean(ratios: Iterable[float]) -> float | None:
    """The geometric mean of positive ratios; None without any."""
    logs = np.log(list(ratios))
    return float(np.exp(logs.mean())) if logs.size else None


def beside(ours: Sequence[float | None], printed: Sequence[float | None]) -> tuple[list[str], list[str], str]:
    """Our values and the printed ones as text, and the geometric mean of ours / printed where both are there."""
    both = [(a, b) for a, b in zip(ours, printed, strict=True) if a and b]
    ratio = number(geometric_mean(a / b for a, b in both))
    return [number(a) for a in ours], [number(b) for b in printed], ratio
