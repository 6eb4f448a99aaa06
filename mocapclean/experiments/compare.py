"""Compare methods on the user's own takes: gaps of natural lengths (``simulate.occlude``), errors in mm by gap length.

This experiment is from no paper. Errors of gaps at the ends of a take are reported separately, because some methods
leave these gaps and others extrapolate.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, column_runs
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.evaluation import metrics
from mocapclean.experiments.cases import CLASSES
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number
from mocapclean.experiments.trials import Capture, Entry, Request, Trial, TrialResult, grid, solve
from mocapclean.simulate import occlude
from mocapclean.take import Take

GROUPS = ("inside", *CLASSES, "at ends")
MEASURES = (*(f"rmse {name}" for name in GROUPS), "rmse_3d", "largest", "left", "share", "seconds")
QUICK_FRAMES = 600
"""First frames of a take that --quick keeps; chosen by hand."""

ENTRIES = (Entry(method="linear"), Entry(method="spline"), Entry(method=DEFAULT_METHOD))


@dataclass(frozen=True, kw_only=True)
class Occlusion:
    """A share of the samples, hidden in gaps of natural lengths."""

    share: float = 0.05

    @property
    def cell(self) -> dict[str, str]:
        """Return the kind and the share of the loss."""
        return {"loss": "occlusion", "share": f"{self.share:g}"}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, round(1000 * self.share)])
        return occlude(take, rng, self.share) & take.trusted


def trials(request: Request) -> list[Trial]:
    """Return a trial for every method on every take."""
    return grid(request.shortened(QUICK_FRAMES), request.entries(ENTRIES), [Occlusion()], run)


def run(capture: Capture, entry: Entry, loss: Occlusion, seed: int) -> TrialResult:
    """Return the errors of the hidden samples: inside the take, in all and by gap length, and at its ends."""
    truth = capture.take
    hidden = loss.hidden(truth, seed)
    solution, seconds = solve(truth, hidden, entry)
    filled = hidden & solution.filled
    measures: dict[str, float | int] = {
        "left": int((hidden & ~filled).sum()),
        "share": float(hidden.mean()),
        "seconds": seconds,
    }
    for name, where in _classes(~truth.trusted | hidden):
        error = metrics.error(truth.positions, solution.positions, where & filled)
        if error:
            measures[f"rmse {name}"] = error.rmse
        if error and name == "inside":
            measures |= {"rmse_3d": error.rmse_3d, "largest": error.largest}
    return measures, {}


def _classes(untrusted: Bools) -> list[tuple[str, Bools]]:
    """Return named groups of samples (F, M): gaps at the ends, gaps inside the take, and the latter by length."""
    gaps = list(column_runs(untrusted))
    inside = [(k, start, stop) for k, start, stop in gaps if start > 0 and stop < len(untrusted)]
    within = _samples(untrusted, inside)
    by_length = metrics.by_length([stop - start for _, start, stop in inside]) if inside else []
    lengths = [(name, _samples(untrusted, [inside[k] for k in members])) for name, members in by_length]
    return [("at ends", untrusted & ~within), ("inside", within), *lengths]


def _samples(untrusted: Bools, gaps: Sequence[tuple[int, int, int]]) -> Bools:
    """Return the samples (F, M) of some gaps, given as (marker, start, stop)."""
    where = np.zeros_like(untrusted)
    for marker, start, stop in gaps:
        where[start:stop, marker] = True
    return where


def tables(results: Results) -> list[Table]:
    """Return the table of errors of each take and method, in all and by gap length."""
    columns = (*(f"rmse {name}" for name in GROUPS), "rmse_3d", "largest", "left", "seconds")
    rows = [
        (take, label, *(number(results.where(take=take, label=label).mean(column)) for column in columns))
        for take in results.takes
        for label in results.where(take=take).labels
    ]
    return [
        Table(
            title="Hidden samples, mm: RMSE inside the take, by gap length, and at its ends; 3D, largest: inside",
            header=("take", "method", *GROUPS, "3D", "largest", "left", "seconds"),
            rows=tuple(rows),
        )
    ]


def figures(results: Results) -> list[Figure]:
    """Return a figure of the error over the gap length, with a panel for each take."""
    panels = []
    for take in results.takes:
        curves = []
        for label in results.where(take=take).labels:
            subset = results.where(take=take, label=label)
            points = [(k, subset.mean(f"rmse {name}")) for k, name in enumerate(CLASSES)]
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


EXPERIMENT = Experiment(
    reference="natural-looking gaps, mocapclean.simulate.occlude",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
)
