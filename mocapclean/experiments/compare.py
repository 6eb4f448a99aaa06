"""Any methods on any takes: gaps as cameras leave them (``simulate.occlude``), errors in mm by length of gap.

Gaps at the ends of a take are judged apart: some methods leave them, others have to guess.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, column_runs
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.evaluation import metrics
from mocapclean.experiments.jobs import Capture, Choice, Entry, Found, Job, grid, solve
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number
from mocapclean.simulate import occlude
from mocapclean.take import Take

_LIMITS = metrics.LENGTH_CLASSES
CLASSES = (*(f"{low + 1}-{high}" for low, high in zip((0, *_LIMITS), _LIMITS, strict=False)), f"over {_LIMITS[-1]}")
GROUPS = ("inside", *CLASSES, "at ends")
MEASURES = (*(f"rmse {name}" for name in GROUPS), "rmse_3d", "largest", "left", "share", "seconds")
QUICK_FRAMES = 600
ENTRIES = (Entry(method="linear"), Entry(method="spline"), Entry(method=DEFAULT_METHOD))


@dataclass(frozen=True, kw_only=True)
class Occlusion:
    """A share of the samples hidden in gaps of natural lengths."""

    share: float = 0.05

    @property
    def cell(self) -> dict[str, str]:
        """Its share."""
        return {"loss": "occlusion", "share": f"{self.share:g}"}

    def missing(self, take: Take, seed: int) -> Bools:
        """The trusted samples (F, M) that are hidden."""
        rng = np.random.default_rng([seed, round(1000 * self.share)])
        return occlude(take, rng, self.share) & take.trusted


def jobs(choice: Choice) -> list[Job]:
    """Every method on every take."""
    return grid(choice.shortened(QUICK_FRAMES), choice.entries(ENTRIES), [Occlusion()], run)


def run(capture: Capture, entry: Entry, loss: Occlusion, seed: int) -> Found:
    """The error of the hidden samples in gaps inside the take, in all and by length, and in those at its ends."""
    truth = capture.take
    missing = loss.missing(truth, seed)
    solution, seconds = solve(truth, missing, entry)
    filled = missing & solution.filled
    measures: dict[str, float | int] = {
        "left": int((missing & ~filled).sum()),
        "share": float(missing.mean()),
        "seconds": seconds,
    }
    for name, where in _classes(~truth.trusted | missing):
        found = metrics.error(truth.positions, solution.positions, where & filled)
        if found:
            measures[f"rmse {name}"] = found.rmse
        if found and name == "inside":
            measures |= {"rmse_3d": found.rmse_3d, "largest": found.largest}
    return measures, {}


def _classes(untrusted: Bools) -> list[tuple[str, Bools]]:
    """The samples (F, M) of gaps at an end of the take, of all others, and of these by length."""
    gaps = list(column_runs(untrusted))
    inside = [(k, start, stop) for k, start, stop in gaps if start > 0 and stop < len(untrusted)]
    within = _samples(untrusted, inside)
    by_length = metrics.by_length([stop - start for _, start, stop in inside]) if inside else []
    lengths = [(name, _samples(untrusted, [inside[k] for k in members])) for name, members in by_length]
    return [("at ends", untrusted & ~within), ("inside", within), *lengths]


def _samples(untrusted: Bools, gaps: Sequence[tuple[int, int, int]]) -> Bools:
    where = np.zeros_like(untrusted)
    for marker, start, stop in gaps:
        where[start:stop, marker] = True
    return where


def tables(results: Results) -> list[Table]:
    """For each take and method the errors, in all and by length of gap."""
    columns = (*(f"rmse {name}" for name in GROUPS), "rmse_3d", "largest", "left", "seconds")
    rows = [
        (take, label, *(number(results.where(take=take, label=label).mean(column)) for column in columns))
        for take in results.takes
        for label in results.where(take=take).labels
    ]
    return [
        Table(
            title="Hidden samples, mm: RMSE of gaps inside the take, by frames, and at its ends; 3D, largest: inside",
            header=("take", "method", *GROUPS, "3D", "largest", "left", "seconds"),
            rows=tuple(rows),
        )
    ]


def figures(results: Results) -> list[Figure]:
    """The error over the length of gaps, one panel for each take."""
    panels = []
    for take in results.takes:
        curves = []
        for label in results.where(take=take).labels:
            mine = results.where(take=take, label=label)
            points = [(k, mine.mean(f"rmse {name}")) for k, name in enumerate(CLASSES)]
            known = [(x, y) for x, y in points if y is not None]
            curves.append(Curve(label=label, x=[x for x, _ in known], y=[y for _, y in known]))
        panels.append(
            Panel(
                title=take,
                x_label="frames of a gap",
                y_label="RMSE, mm",
                curves=tuple(curves),
                ticks=CLASSES,
                log_y=True,
            )
        )
    return [Figure(name="compare_lengths", title="Error of hidden samples by length of gap", panels=tuple(panels))]
