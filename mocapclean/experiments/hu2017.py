"""The experiments of Hu et al. 2017: random and continuous loss, and synthetic matrices; trnn, tsmc, psvt and ialm.

W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, Motion capture data completion via truncated nuclear norm
regularization, IEEE Signal Process. Lett. The paper's table of seconds is reproduced beside the printed values. As
tables of numbers it reproduces the paper's plots: RMSE over the missing entries, taken to be in units of 56.444 mm; the
rank that trnn estimates; the RMSE over r; and for synthetic matrices NRE = ‖X − X*‖_F / ‖X*‖_F. These are
1000 × 200 products of Gaussian factors with errors from U[-10, 10] in a share of the entries.
"""

from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.experiments import losses
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.published import published
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number, with_printed
from mocapclean.experiments.trials import (
    CMU_UNIT,
    Capture,
    Entry,
    Loss,
    LossPattern,
    Request,
    Trial,
    TrialResult,
    grid,
    rms,
    solve,
)
from mocapclean.numerics.low_rank.robust_pca import robust_pca
from mocapclean.solvers import trnn

MEASURES = ("rmse", "seconds", "iterations", "converged", "rank", "left", "frames", "nre")
QUICK_FRAMES = 240
"""First frames of a take that --quick keeps; chosen by hand."""

ENTRIES = (Entry(method="trnn"), Entry(method="tsmc"))
RANKS = (0, 5, 10, 15, 20, 25, 30)
"""Values of r in the study of r."""

RANK_LOSSES = (Loss(ratio=0.4), Loss(length=40, out=losses.OUT))
"""Losses in the study of r."""

SHAPE = (1000, 200)
"""Rows and columns of a synthetic matrix."""

SYNTHETIC = ("trnn", "psvt", "ialm")
"""Methods that separate synthetic matrices."""

SYNTHETIC_RANKS = (10, 20, 30, 40, 50, 60)
"""Ranks of the synthetic matrices, as in Hu et al. 2017."""
CORRUPTIONS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3)
"""Shares of the entries of a synthetic matrix that have errors."""


def trials(request: Request) -> list[Trial]:
    """Return the trials of both losses, of the study of r, and of the synthetic matrices."""
    short = request.shortened(QUICK_FRAMES)
    entries = request.entries(ENTRIES)
    return [
        *grid(short, entries, losses.losses(request.quick), run),
        *_rank_trials(short, entries),
        *_synthetic_trials(request),
    ]


def run(capture: Capture, entry: Entry, loss: LossPattern, seed: int) -> TrialResult:
    """Return the error over the missing entries, in units of 56.444 mm, and the rank."""
    truth = capture.take
    hidden = loss.hidden(truth, seed)
    solution, seconds = solve(truth, hidden, entry)
    filled = hidden & solution.filled
    measures: dict[str, float | int] = {
        "rmse": rms(solution.positions[filled] - truth.positions[filled]) / CMU_UNIT,
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
        "left": int((hidden & ~filled).sum()),
        "frames": len(truth.trusted),
    }
    if isinstance(solution.facts.get("rank"), int):
        measures["rank"] = int(solution.facts["rank"])
    return measures, {}


def _rank_trials(request: Request, entries: list[Entry]) -> list[Trial]:
    """Return the study of r, with the first seed, unless the user has set r."""
    return [
        Trial(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell={"study": "rank", "of": "random 40%" if loss.ratio else "blocks of 40", "r": str(rank)},
            seed=0,
            run=partial(run, capture, replace(entry, changes={**entry.changes, "rank": rank}), loss, 0),
        )
        for capture in request.captures
        for entry in entries
        if entry.method == "trnn" and "rank" not in entry.changes
        for loss in (RANK_LOSSES[1:] if request.quick else RANK_LOSSES)
        for rank in (RANKS[::3] if request.quick else RANKS)
    ]


def _synthetic_trials(request: Request) -> list[Trial]:
    """Return the trials with synthetic matrices."""
    ranks, shares = (SYNTHETIC_RANKS[::2], CORRUPTIONS[1::2]) if request.quick else (SYNTHETIC_RANKS, CORRUPTIONS)
    return [
        Trial(
            take="synthetic",
            source="",
            entry=Entry(method=name),
            cell={"rank": str(rank), "corruption": f"{share:g}"},
            seed=seed,
            run=partial(_separate, name, rank, share, seed),
        )
        for seed in range(request.n_seeds)
        for rank in ranks
        for share in shares
        for name in SYNTHETIC
        if not request.methods or name in request.methods
    ]


def synthetic(rank: int, share: float, seed: int) -> tuple[Floats, Floats]:
    """Return a matrix (1000, 200) of this rank, and the same matrix with errors in a share of its entries."""
    rng = np.random.default_rng([seed, rank, round(1000 * share)])
    low = rng.standard_normal((SHAPE[0], rank)) @ rng.standard_normal((rank, SHAPE[1]))
    errors = np.where(rng.random(SHAPE) < share, rng.uniform(-10.0, 10.0, SHAPE), 0.0)
    return low, low + errors


def _separate(method: str, rank: int, share: float, seed: int) -> TrialResult:
    """Return the NRE and the seconds of a method that separates a synthetic matrix."""
    low, matrix = synthetic(rank, share, seed)
    weight = 1.0 / max(SHAPE) ** 0.5  # of the sparse part, as in robust PCA (Candès et al. 2011)
    begin = perf_counter()
    if method == "trnn":
        estimate, _, iterations = trnn.separate(matrix, rank)
    else:
        parts = robust_pca(matrix, weight, keep=rank if method == "psvt" else 0)
        estimate, iterations = parts.low, len(parts.trace)
    seconds = perf_counter() - begin
    nre = float(np.linalg.norm(estimate - low) / np.linalg.norm(low))
    return {"nre": nre, "seconds": seconds, "iterations": iterations}, {}


def tables(results: Results) -> list[Table]:
    """Return tables of errors, ranks and seconds over the losses, of the study of r, and of the synthetic matrices."""
    captures = Results(tuple(row for row in results.rows if "loss" in row.cell))
    made = []
    if captures.rows:
        made = [
            losses.over_losses(captures, "rmse", "RMSE over the missing entries, units of 56.444 mm"),
            losses.over_losses(captures, "rank", "Rank: estimated by trnn, or set"),
            losses.over_losses(captures, "seconds", "Seconds"),
            _seconds_table(captures),
        ]
    for make in (_rank_table, _synthetic_table):
        table = make(results)
        if table.rows:
            made.append(table)
    return made


def _seconds_table(results: Results) -> Table:
    """Return the seconds of each method beside the printed ones."""
    printed = {
        (row["take"], row["method"], int(row["frames"])): float(row["seconds"]) for row in published("hu2017_seconds")
    }
    rows = []
    for take in results.takes:
        for label in results.where(take=take).labels:
            subset = results.where(take=take, label=label)
            frames = round(subset.mean("frames") or 0)
            (ours,), (theirs,), ratio = with_printed([subset.mean("seconds")], [printed.get((take, label, frames))])
            rows.append((take, label, str(frames), ours, theirs, ratio))
    return Table(
        title="Seconds, mean over all losses (printed: MATLAB, Intel i5 2.4 GHz; whole takes)",
        header=("take", "method", "frames", "ours", "printed", "ratio"),
        rows=tuple(rows),
    )


def _rank_table(results: Results) -> Table:
    """Return the errors in the study of r."""
    study = results.where(study="rank")
    ranks = study.cells("r")
    rows = [
        (take, label, of, *(number(study.where(take=take, label=label, of=of, r=r).mean("rmse")) for (r,) in ranks))
        for take in study.takes
        for label in study.where(take=take).labels
        for (of,) in study.where(take=take, label=label).cells("of")
    ]
    return Table(
        title="RMSE over the missing entries when r is set, units of 56.444 mm",
        header=("take", "method", "loss", *(f"r={r}" for (r,) in ranks)),
        rows=tuple(rows),
    )


def _synthetic_table(results: Results) -> Table:
    """Return the NRE of the synthetic matrices."""
    subset = results.where(take="synthetic")
    shares = subset.cells("corruption")
    rows = []
    for (rank,) in subset.cells("rank"):
        for label in subset.labels:
            cells = [subset.where(label=label, rank=rank, corruption=share) for (share,) in shares]
            rows.append((rank, label, *(_with_exponent(c.mean("nre")) for c in cells), number(_mean_seconds(cells))))
    return Table(
        title="Synthetic 1000 x 200: NRE over rank and share of corrupted entries; mean seconds",
        header=("rank", "method", *(f"{100 * float(share):.0f} %" for (share,) in shares), "seconds"),
        rows=tuple(rows),
    )


def _mean_seconds(cells: list[Results]) -> float | None:
    return Results(tuple(row for cell in cells for row in cell.rows)).mean("seconds")


def _with_exponent(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def figures(results: Results) -> list[Figure]:
    """Return figures of errors, ranks and seconds for each take, and the diagrams of the synthetic matrices."""
    made = []
    for take in (name for name in results.takes if name != "synthetic"):
        subset = results.where(take=take)
        study = subset.where(study="rank")
        over_r = tuple(
            Curve(
                label=of,
                x=[float(row.cell["r"]) for row in study.where(of=of).rows],
                y=[row.values["rmse"] for row in study.where(of=of).rows],
            )
            for (of,) in study.cells("of")
        )
        panels = [*losses.panels(subset, "rmse", "RMSE, 56.444 mm")]
        if over_r:
            panels.append(Panel(title="trnn, r set", x_label="r", y_label="RMSE, 56.444 mm", curves=over_r))
        made.append(
            Figure(name=f"hu2017_{take}_rmse", title=f"{take}: error of the missing entries", panels=tuple(panels))
        )
        others = [*losses.panels(subset, "rank", "estimated rank"), *losses.panels(subset, "seconds", "s")]
        made.append(Figure(name=f"hu2017_{take}_rank_seconds", title=f"{take}: rank and time", panels=tuple(others)))
    diagrams = [_diagram(results, measure) for measure in ("nre", "seconds")]
    return [*made, *(diagram for diagram in diagrams if diagram.panels)]


def _diagram(results: Results, measure: str) -> Figure:
    """Return the diagram of a measure over rank and corruption, with a panel for each method."""
    subset = results.where(take="synthetic")
    ranks, shares = subset.cells("rank"), subset.cells("corruption")
    panels = []
    for label in subset.labels:
        values = [
            [subset.where(label=label, rank=r, corruption=c).mean(measure) or np.nan for (c,) in shares]
            for (r,) in ranks
        ]
        picture = np.array(values, dtype=np.float64)
        panels.append(
            Panel(
                title=label,
                x_label="share of corrupted entries",
                y_label="rank",
                picture=np.log10(picture) if measure == "nre" else picture,
                extent=(*_ends([float(c) for (c,) in shares]), -0.5, len(ranks) - 0.5),
                ticks=tuple(r for (r,) in ranks),
            )
        )
    title = "log10 of the NRE" if measure == "nre" else "seconds"
    return Figure(name=f"hu2017_synthetic_{measure}", title=f"1000 x 200 matrices: {title}", panels=tuple(panels))


def _ends(values: list[float]) -> tuple[float, float]:
    """Return the left and right edge of a picture whose columns are centred at evenly spaced values."""
    half = (values[-1] - values[0]) / max(2 * (len(values) - 1), 1) or 0.5 * values[0]
    return values[0] - half, values[-1] + half


EXPERIMENT = Experiment(
    reference="W. Hu, Z. Wang, S. Liu, X. Yang, G. Yu, J. J. Zhang, 2017, IEEE Signal Process. Lett.",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
    sequences=("05_13", "12_02", "49_02", "13_13", "10_01", "13_17"),
    needs_captures=False,
)
