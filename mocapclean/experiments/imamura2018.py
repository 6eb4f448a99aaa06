"""Random and continuous loss on normalised data: trnn2 against trnn and tnnr.

R. Imamura, M. Okuda, 2018: RMSE over the missing entries (23) in units of the take's one standard deviation, and the
singular values of the second differences D₂X of the complete take, the broken one and the repaired ones.
"""

from dataclasses import replace

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.experiments import losses
from mocapclean.experiments.jobs import Capture, Choice, Entry, Found, Job, Loss, grid, rms, solve
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table
from mocapclean.numerics.low_rank.differences import difference

MEASURES = ("rmse", "rmse_mm", "seconds", "iterations", "converged", "left")
QUICK_FRAMES = 240
ENTRIES = (Entry(method="tnnr"), Entry(method="trnn"), Entry(method="trnn2"))
SHOWN = Loss(length=60, out=losses.OUT)
"""The loss whose singular values are shown."""


def jobs(choice: Choice) -> list[Job]:
    """Every method with every loss."""
    entries = choice.entries(ENTRIES)
    return grid(choice.shortened(QUICK_FRAMES), entries, losses.losses(choice.quick), run)


def run(capture: Capture, entry: Entry, loss: Loss, seed: int) -> Found:
    """The error, and for the shown loss the singular values of D₂X, all in standard deviations of the take."""
    truth = capture.take
    missing = loss.missing(truth, seed)
    solution, seconds = solve(truth, missing, entry)
    filled = missing & solution.filled
    error = rms(solution.positions[filled] - truth.positions[filled])
    spread = float(truth.positions[truth.trusted].std()) or 1.0
    measures = {
        "rmse": error / spread,
        "rmse_mm": error,
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
        "left": int((missing & ~filled).sum()),
    }
    if loss != SHOWN or seed or not truth.trusted.all():
        return measures, {}
    mean = truth.positions[~missing].mean()
    repaired = np.where(filled[..., None], solution.positions, truth.positions)
    broken = np.where(missing[..., None], mean, truth.positions)
    stages = {"complete": truth.positions, "broken": broken, "repaired": repaired}
    return measures, {name: _spectrum(positions) / spread for name, positions in stages.items()}


def _spectrum(positions: Floats) -> Floats:
    """The singular values of D₂X in descending order."""
    matrix = positions.reshape(len(positions), -1)
    return np.asarray(np.linalg.svd(difference(difference(matrix)), compute_uv=False), dtype=np.float64)


def tables(results: Results) -> list[Table]:
    """Errors over the losses, for each take and for their mean; seconds."""
    found = [losses.over_losses(results, "rmse", "RMSE over the missing entries, standard deviations of the take")]
    if len(results.takes) > 1:
        found.append(losses.over_losses(_together(results), "rmse", "RMSE, mean over takes"))
    return [*found, losses.over_losses(results, "seconds", "Seconds")]


def _together(results: Results) -> Results:
    return Results(tuple(replace(row, take="all takes") for row in results.rows))


def figures(results: Results) -> list[Figure]:
    """The mean error over takes and seeds; for each take the singular values of D₂X."""
    found = [
        Figure(
            name="imamura2018_rmse",
            title="RMSE of the missing entries, mean over takes",
            panels=losses.panels(results, "rmse", "RMSE, standard deviations"),
        )
    ]
    for take in results.takes:
        panel = _spectra(results.where(take=take, length=SHOWN.length))
        if panel.curves:
            title = f"{take}: singular values of the second differences"
            found.append(Figure(name=f"imamura2018_{take}_spectrum", title=title, panels=(panel,)))
    return found


def _spectra(results: Results) -> Panel:
    curves: list[Curve] = []
    for row in results.rows:
        series = row.series()
        for name in ("complete", "broken"):
            if series and len(curves) < 2:
                curves.append(_curve(name, series[name], dashed=True))
        if series:
            curves.append(_curve(row.label, series["repaired"]))
    title = f"{SHOWN.out} markers out in blocks of {SHOWN.length} frames"
    return Panel(title=title, x_label="index", y_label="singular value of D2 X", curves=tuple(curves), log_y=True)


def _curve(label: str, values: Floats, *, dashed: bool = False) -> Curve:
    return Curve(label=label, x=np.arange(1.0, len(values) + 1.0), y=values, dashed=dashed)
