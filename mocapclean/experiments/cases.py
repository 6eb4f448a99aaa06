"""The cases of a bench on real takes, in two halves of the takes, and the calibration of expected errors in them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.evaluation import metrics
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Row, Table, number

HALF_NAMES = ("chosen on", "reported on")
"""The halves of the takes: constants are chosen on the first, and results are reported on the second."""

_LIMITS = metrics.LENGTH_CLASSES
# Names of the classes of gap length, frames; the limits are those of the reports.
CLASSES = (*(f"{low + 1}-{high}" for low, high in zip((0, *_LIMITS), _LIMITS, strict=False)), f"over {_LIMITS[-1]}")
_SUMS = ("coordinates", "covered", "squared", "expected")
CALIBRATION_MEASURES = tuple(f"{what} {name}" for name in CLASSES for what in _SUMS)
"""Columns of ``calibration``."""

Case = tuple[str, str, int]
"""A take, a pattern and a seed."""


def calibration(errors: Floats, sd: Floats, filled: Bools, untrusted: Bools) -> dict[str, float | int]:
    """Return sums over the filled samples, for each class of gap length that has some.

    coordinates: their number. covered: those within 1.645 sd. squared: squared 3D errors, mm². expected: their
    expectation 3 sd². errors: (F, M, 3), mm. sd: (F, M), mm. filled: the samples (F, M) that count. untrusted: (F, M),
    whose runs are the gaps.
    """
    lengths = np.zeros(filled.shape, dtype=np.intp)
    for marker, start, stop in column_runs(untrusted):
        lengths[start:stop, marker] = stop - start
    error, deviation = errors[filled], sd[filled]
    sums: dict[str, float | int] = {}
    for name, members in metrics.by_length(lengths[filled].tolist()) if filled.any() else ():
        inside = np.abs(error[members]) <= metrics.INTERVAL_90 * deviation[members, None]
        values = inside.size, int(inside.sum()), np.sum(error[members] ** 2), np.sum(3.0 * deviation[members] ** 2)
        sums |= {f"{what} {name}": value for what, value in zip(_SUMS, values, strict=True)}
    return sums


def pooled(rows: Sequence[Row], what: str, classes: Sequence[str] = CLASSES) -> float:
    """Return one of the sums of ``calibration`` over some rows and classes of gap length."""
    return sum(row.values.get(f"{what} {name}", 0.0) for row in rows for name in classes)


def inside(rows: Sequence[Row], classes: Sequence[str] = CLASSES) -> str:
    """Return the share of the coordinates within 1.645 sd as text."""
    return share(pooled(rows, "covered", classes), pooled(rows, "coordinates", classes))


def over_expected(rows: Sequence[Row], classes: Sequence[str] = CLASSES) -> str:
    """Return the RMS 3D error over the expected one, over all samples of the rows, as text."""
    expected = pooled(rows, "expected", classes)
    return number((pooled(rows, "squared", classes) / expected) ** 0.5 if expected else None)


@dataclass(frozen=True)
class Half:
    """The rows of one half of the takes, by method and case."""

    name: str
    rows: Mapping[str, Mapping[Case, Row]]

    def of(self, label: str, patterns: Sequence[str]) -> dict[Case, Row]:
        """Return the rows of a method in the cases of these patterns that it has filled."""
        rows = self.rows.get(label, {})
        return {case: row for case, row in rows.items() if case[1] in patterns and "rmse" in row.values}

    def errors(self, label: str, patterns: Sequence[str]) -> dict[Case, float]:
        """Return the RMSE of a method in each case of these patterns that it has filled."""
        return {case: row.values["rmse"] for case, row in self.of(label, patterns).items()}

    def best(self, labels: Sequence[str], patterns: Sequence[str]) -> dict[Case, float]:
        """Return the least RMSE of these methods in each case."""
        least: dict[Case, float] = {}
        for label in labels:
            for case, error in self.errors(label, patterns).items():
                least[case] = min(error, least.get(case, np.inf))
        return least


def by_half(results: Results, halves: Mapping[str, Sequence[str]]) -> list[Half]:
    """Return the rows of both halves, given the takes of each; a half without rows is left out."""
    both = []
    for name, takes in halves.items():
        rows: dict[str, dict[Case, Row]] = {label: {} for label in results.labels}
        for row in results.rows:
            if row.take in takes:
                rows[row.label][row.take, row.cell["pattern"], row.seed] = row
        both.append(Half(name, {label: cases for label, cases in rows.items() if cases}))
    return [half for half in both if half.rows]


def pairs_of(ours: Mapping[Case, float], theirs: Mapping[Case, float]) -> list[tuple[float, float]]:
    """Return the errors of two methods in each case that both have."""
    return [(error, theirs[case]) for case, error in ours.items() if case in theirs]


def share(count: float, of: float) -> str:
    """Return a share as text in percent; "-" of nothing."""
    return f"{100 * count / of:.1f} %" if of else "-"


def calibration_tables(both: Sequence[Half]) -> list[Table]:
    """Return the tables of coordinates inside the 90 % intervals, and of errors over expected ones, by gap length."""
    rows: dict[str, list[tuple[str, ...]]] = {"inside": [], "expected": []}
    for half in both:
        for label, cases in half.rows.items():
            all_rows = list(cases.values())
            total = pooled(all_rows, "coordinates")
            if total:
                groups = [*((name,) for name in CLASSES), CLASSES]
                cells = [inside(all_rows, group) for group in groups]
                rows["inside"].append((half.name, label, *cells, str(int(total))))
                rows["expected"].append((half.name, label, *(over_expected(all_rows, group) for group in groups)))
    header = ("half", "method", *CLASSES, "all")
    return [
        Table(
            title=f"Coordinates within {metrics.INTERVAL_90:g} sd (90 % if expected errors are right), by frames",
            header=(*header, "coordinates"),
            rows=tuple(rows["inside"]),
        ),
        Table(
            title="RMS 3D error over expected 3D error (1 if expected errors are right), by frames",
            header=header,
            rows=tuple(rows["expected"]),
        ),
    ]


def error_figure(results: Results, name: str, patterns: Sequence[str]) -> Figure:
    """Return the figure of the cumulative share of cases over their error, with a panel for each pattern."""
    panels = []
    for pattern in patterns:
        curves = []
        for label in results.labels:
            rows = results.where(label=label, pattern=pattern).rows
            errors = sorted(row.values["rmse"] for row in rows if "rmse" in row.values)
            cumulative = (np.arange(len(errors)) + 1.0) / max(len(errors), 1)
            curves.append(Curve(label=label, x=errors, y=cumulative))
        panels.append(
            Panel(title=pattern, x_label="RMSE, mm", y_label="share of cases", curves=tuple(curves), log_x=True)
        )
    return Figure(name=name, title="Cumulative share of cases over their error", panels=tuple(panels))
