"""The experiments of Imamura & Okuda 2018: random and continuous loss; trnn2, trnn and tnnr.

R. Imamura, M. Okuda, 2018. As tables of numbers it reproduces the paper's plots: the RMSE over the missing entries, eq.
(23), in standard deviations of the take; and the singular values of the second differences D₂X of the complete take, of
the take with gaps, and of the repaired takes.
"""

from dataclasses import replace

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.experiments import losses
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table
from mocapclean.experiments.trials import Capture, Entry, Loss, Request, Trial, TrialResult, grid, rms, solve
from mocapclean.numerics.low_rank.differences import difference

MEASURES = ("rmse", "rmse_mm", "seconds", "iterations", "converged", "left")
QUICK_FRAMES = 240
"""First frames of a take that --quick keeps; chosen by hand."""

ENTRIES = (Entry(method="tnnr"), Entry(method="trnn"), Entry(method="trnn2"))
SHOWN_LOSS = Loss(length=60, out=losses.OUT)
"""The loss for which singular values are plotted."""


def trials(request: Request) -> list[Trial]:
    """Return a trial for every method and every loss."""
    entries = request.entries(ENTRIES)
    return grid(request.shortened(QUICK_FRAMES), entries, losses.losses(request.quick), run)


def run(capture: Capture, entry: Entry, loss: Loss, seed: int) -> TrialResult:
    """Return the error and, for ``SHOWN_LOSS``, the singular values of D₂X, in standard deviations of the take."""
    truth = capture.take
    hidden = loss.hidden(truth, seed)
    solution, seconds = solve(truth, hidden, entry)
    filled = hidden & solution.filled
    error = rms(solution.positions[filled] - truth.positions[filled])
    spread = float(truth.positions[truth.trusted].std()) or 1.0
    measures = {
        "rmse": error / spread,
        "rmse_mm": error,
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
        "left": int((hidden & ~filled).sum()),
    }
    if loss != SHOWN_LOSS or seed or not truth.trusted.all():
        return measures, {}
    mean = truth.positions[~hidden].mean()
    repaired = np.where(filled[..., None], solution.positions, truth.positions)
    with_gaps = np.where(hidden[..., None], mean, truth.positions)
    stages = {"complete": truth.positions, "broken": with_gaps, "repaired": repaired}
    return measures, {name: _spectrum(positions) / spread for name, positions in stages.items()}


def _spectrum(positions: Floats) -> Floats:
    """Return the singular values of D₂X in descending order."""
    matrix = positions.reshape(len(positions), -1)
    return np.asarray(np.linalg.svd(difference(difference(matrix)), compute_uv=False), dtype=np.float64)


def tables(results: Results) -> list[Table]:
    """Return tables of errors over the losses, for each take and for their mean, and of seconds."""
    made = [losses.over_losses(results, "rmse", "RMSE over the missing entries, standard deviations of the take")]
    if len(results.takes) > 1:
        made.append(losses.over_losses(_together(results), "rmse", "RMSE, mean over takes"))
    return [*made, losses.over_losses(results, "seconds", "Seconds")]


def _together(results: Results) -> Results:
    """Return the rows of all takes under one name."""
    return Results(tuple(replace(row, take="all takes") for row in results.rows))


def figures(results: Results) -> list[Figure]:
    """Return figures of the mean error over takes and seeds, and of the singular values of D₂X of each take."""
    made = [
        Figure(
            name="imamura2018_rmse",
            title="RMSE of the missing entries, mean over takes",
            panels=losses.panels(results, "rmse", "RMSE, standard deviations"),
        )
    ]
    for take in results.takes:
        panel = _spectra(results.where(take=take, length=SHOWN_LOSS.length))
        if panel.curves:
            title = f"{take}: singular values of the second differences"
            made.append(Figure(name=f"imamura2018_{take}_spectrum", title=title, panels=(panel,)))
    return made


def _spectra(results: Results) -> Panel:
    """Return a panel of the singular values: the complete take, the take with gaps, and each method's repair."""
    curves: list[Curve] = []
    for row in results.rows:
        series = row.series()
        for name in ("complete", "broken"):
            if series and len(curves) < 2:
                curves.append(_curve(name, series[name], dashed=True))
        if series:
            curves.append(_curve(row.label, series["repaired"]))
    title = f"{SHOWN_LOSS.out} markers hidden in blocks of {SHOWN_LOSS.length} frames"
    return Panel(title=title, x_label="index", y_label="singular value of D2 X", curves=tuple(curves), log_y=True)


def _curve(label: str, values: Floats, *, dashed: bool = False) -> Curve:
    return Curve(label=label, x=np.arange(1.0, len(values) + 1.0), y=values, dashed=dashed)


EXPERIMENT = Experiment(
    reference="R. Imamura, M. Okuda, 2018",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
    sequences=("13_13", "10_01", "13_17"),
)
