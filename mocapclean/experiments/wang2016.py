"""The experiments of Wang et al. 2016: 10 to 30 % of the markers hidden; llc, srmmp, dynammo and svt.

Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016. As tables of numbers it reproduces the paper's plots of
the per-frame RMSE, eq. (8), in cm, for random loss and for blocks of 60 frames. The per-frame RMSE is the root of the
mean squared distance over the missing markers of a frame, √3 times the RMSE per coordinate.

Training takes: the other takes of the same subject (the file name up to the first ``_``) among the captures and the
folder. Takes under test are left out if that leaves at least one. A subject without other takes is trained on all takes
of other subjects. A method never learns from the take under test.

Tuning: as in the paper, competitors are tuned by cross-validation on training takes. Three values of the main parameter
are tried on the first 600 frames of up to two training takes. A fifth of the markers is hidden in blocks of 60 frames.
The value with the least error is used. srmmp learns from the remaining training takes, and keeps its default if there
are none.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.body_parts import known_parts
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.dictionaries.training import train
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.errors import UsageError
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.losses import curves
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number
from mocapclean.experiments.trials import Capture, Entry, Loss, Request, Trial, TrialResult, grid, solve
from mocapclean.solvers.names import needs_dictionary

MEASURES = ("rmse_cm", "seconds", "iterations", "converged", "left", "share", "tuned")
RATIOS = (0.1, 0.2, 0.3)
"""Shares of the markers that are hidden; from the paper."""

LENGTH = 60
"""Frames of a block; from the paper."""

QUICK_FRAMES = 240
"""First frames of a take that --quick keeps; chosen by hand."""

QUICK_TRAINING = Params(atoms=128, windows=1024, sweeps=2, hole_passes=1)
"""Training with --quick: an eighth of the atoms and windows; chosen by hand for speed."""
ENTRIES = (Entry(method="dynammo"), Entry(method="srmmp"), Entry(method="svt"), Entry(method="llc"))
TUNED: dict[str, tuple[str, tuple[float, ...]]] = {
    "dynammo": ("states", (8, 16, 32)),
    "srmmp": ("sparsity_weight", (1e-4, 1e-3, 1e-2)),
    "svt": ("threshold", (150.0, 450.0, 1350.0)),
}
"""The tuned parameter of each competitor and its candidate values around the default; chosen by hand."""

N_FOLDS = 2
"""Most training takes in the cross-validation; chosen by hand."""

FOLD_FRAMES = 600
"""First frames of these takes; chosen by hand."""

FOLD_SHARE = 0.2
"""Share of their markers that is hidden, the middle of ``RATIOS``."""


def trials(request: Request) -> list[Trial]:
    """Return a trial for every method and loss; methods are trained for each take on first use."""
    entries = request.entries(ENTRIES, trained=True)
    params = QUICK_TRAINING if request.quick else Params()
    made = []
    for capture in request.captures:
        n_markers = len(capture.take.markers)
        ratios = RATIOS[::2] if request.quick else RATIOS
        blocks = [Loss(length=LENGTH, out=max(1, round(ratio * n_markers))) for ratio in ratios]
        patterns = [*(Loss(ratio=ratio) for ratio in ratios), *blocks]
        takes = training_captures(capture, request) if any(map(_needs_training, entries)) else []
        training = Training(takes, params, QUICK_FRAMES if request.quick else FOLD_FRAMES)
        made += _trials(replace(request, captures=(capture,)), entries, patterns, training)
    return made


def _tunable(entry: Entry) -> bool:
    """Whether the main parameter of an entry is tuned: the user has not set it."""
    return entry.method in TUNED and entry.learned is None and TUNED[entry.method][0] not in entry.changes


def _needs_training(entry: Entry) -> bool:
    """Whether an entry needs training takes."""
    return _tunable(entry) or (needs_dictionary(entry.method) and entry.learned is None)


class Training:
    """The dictionary and the tuned parameters from the training takes of one capture, computed on first use."""

    def __init__(self, takes: list[Capture], params: Params, n_frames: int) -> None:
        self.takes, self.params, self.n_frames = takes, params, n_frames
        self.dictionary, self.tuned = cache(self._train), cache(self._tune)

    def prepared(self, entry: Entry) -> Entry:
        """Return the entry with its tuned parameter and its dictionary."""
        if _tunable(entry):
            entry = replace(entry, changes={**entry.changes, **self.tuned(entry.method)})
        if needs_dictionary(entry.method) and entry.learned is None:
            entry = replace(entry, learned=self.dictionary())
        return entry

    def _train(self) -> Dictionary:
        """Return the dictionary of all training takes."""
        return _trained(self.takes, self.params)

    def _tune(self, method: str) -> dict[str, float]:
        """Return the tuned parameter of a method by name; empty if there are too few training takes."""
        name, values = TUNED[method]
        folds = self.takes[:N_FOLDS]
        if needs_dictionary(method) and len(self.takes) == 1:
            return {}
        errors = [
            sum(self._fold_error(Entry(method=method, changes={name: value}), fold) for fold in folds)
            for value in values
        ]
        return {name: values[int(np.argmin(errors))]}

    def _fold_error(self, entry: Entry, fold: Capture) -> float:
        """Return the error of an entry on a training take, with a dictionary learned from the other training takes."""
        short = replace(fold, n_frames=self.n_frames)
        loss = Loss(length=LENGTH, out=max(1, round(FOLD_SHARE * len(fold.take.markers))))
        others = [capture for capture in self.takes if capture is not fold]
        learned = _trained(others, QUICK_TRAINING) if needs_dictionary(entry.method) else None
        return float(run(short, replace(entry, learned=learned), loss, 0)[0]["rmse_cm"])


def _trained(captures: list[Capture], params: Params) -> Dictionary:
    """Return the dictionary learned from some captures."""
    takes = [capture.take for capture in captures]
    return train(takes, known_parts(takes[0].markers), params)


def _trials(request: Request, entries: list[Entry], losses: list[Loss], training: Training) -> list[Trial]:
    """Return the trials of one capture; a hash of the training takes is part of their keys."""

    def run_prepared(capture: Capture, entry: Entry, loss: Loss, seed: int) -> TrialResult:
        ready = training.prepared(entry)
        measures, series = run(capture, ready, loss, seed)
        tuned = ready.changes.get(TUNED[entry.method][0], 0.0) if _tunable(entry) else 0.0
        return {**measures, "tuned": float(tuned)}, series

    training_hash = hashlib.sha256(repr([training.params, *(c.digest for c in training.takes)]).encode()).hexdigest()[
        :8
    ]
    made = grid(request.shortened(QUICK_FRAMES), entries, losses, run_prepared)
    return [replace(j, source=f"{j.source}<{training_hash}") if _needs_training(j.entry) else j for j in made]


def training_captures(capture: Capture, request: Request) -> list[Capture]:
    """Return the training takes of a capture, sorted by name; raise UsageError if there is no other take."""
    known = {other.digest: other for other in (*request.folder, *request.captures)}
    others = [other for digest, other in known.items() if digest != capture.digest and other.name != capture.name]
    same = [other for other in others if _subject(other) == _subject(capture)]
    tested = {other.name for other in request.captures}
    same = [other for other in same if other.name not in tested] or same
    if not others:
        raise UsageError(
            f"{capture.path}: at least one other take is needed for training. Name more takes, or give a --folder."
        )
    return sorted(same or others, key=lambda other: other.name)


def _subject(capture: Capture) -> str:
    """Return the subject of a CMU take: its name up to the first underscore."""
    return capture.name.split("_")[0]


def notes(request: Request) -> list[str]:
    """Return a line for each capture with its training takes."""
    if not any(map(_needs_training, request.entries(ENTRIES, trained=True))):
        return []
    return [f"{c.name} is tested; trained on: {_names(training_captures(c, request))}." for c in request.captures]


def _names(captures: Iterable[Capture]) -> str:
    return ", ".join(capture.name for capture in captures)


def run(capture: Capture, entry: Entry, loss: Loss, seed: int) -> TrialResult:
    """Return the mean of the per-frame RMSE (8) in cm, and its series for the largest block loss."""
    truth = capture.take
    hidden = loss.hidden(truth, seed)
    solution, seconds = solve(truth, hidden, entry)
    filled = hidden & solution.filled
    per_frame = frame_rmse(truth.positions, solution.positions, filled)
    has_filled = filled.any(axis=1)
    measures = {
        "rmse_cm": float(per_frame[has_filled].mean()) if has_filled.any() else 0.0,
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
        "left": int((hidden & ~filled).sum()),
        "share": float(hidden.mean()),
        "tuned": 0.0,
    }
    has_series = not seed and loss.out == max(1, round(RATIOS[-1] * len(truth.markers)))
    return measures, {"seconds": np.arange(len(per_frame)) / truth.rate, "rmse_cm": per_frame} if has_series else {}


def frame_rmse(truth: Floats, positions: Floats, where: Bools) -> Floats:
    """Return the per-frame RMSE (F,), eq. (8), in cm.

    It is the root of the mean squared distance over the samples ``where`` (F, M) of a frame; 0 in frames without any.
    """
    squared = np.where(where, ((positions - truth) ** 2).sum(axis=2), 0.0).sum(axis=1)
    return np.asarray(np.sqrt(squared / np.maximum(where.sum(axis=1), 1)) / 10.0)


def tables(results: Results) -> list[Table]:
    """Return tables of errors, seconds and tuned parameters for each take."""
    return [
        _table(results, "rmse_cm", "Per-frame RMSE (8), cm, mean over frames"),
        _table(results, "seconds", "Seconds"),
        _tuned(results),
    ]


def _tuned(results: Results) -> Table:
    """Return the table of tuned parameters."""
    rows = []
    for take in results.takes:
        for method in TUNED:
            value = results.where(take=take, label=method).mean("tuned")
            if value:
                rows.append((take, method, TUNED[method][0], number(value)))
    return Table(title="Tuned by cross-validation", header=("take", "method", "parameter", "value"), rows=tuple(rows))


def _table(results: Results, measure: str, title: str) -> Table:
    """Return a table of a measure over the losses."""
    ratios, outs = results.cells("ratio"), results.cells("out")
    rows = []
    for take in results.takes:
        for label in results.where(take=take).labels:
            subset = results.where(take=take, label=label)
            cells = [*(subset.where(ratio=r) for (r,) in ratios), *(subset.where(out=out) for (out,) in outs)]
            rows.append((take, label, *(number(cell.mean(measure)) for cell in cells)))
    heads = [*(f"random {100 * float(r):.0f} %" for (r,) in ratios), *(f"{out} out, {LENGTH} fr" for (out,) in outs)]
    return Table(title=title, header=("take", "method", *heads), rows=tuple(rows))


def figures(results: Results) -> list[Figure]:
    """Return a figure for each take: the error over the loss, and per frame for the largest block loss."""
    made = []
    for take in results.takes:
        subset = results.where(take=take)
        shown = [(row.label, row.series()) for row in subset.rows if "out" in row.cell]
        over_time = tuple(Curve(label=name, x=s["seconds"], y=s["rmse_cm"]) for name, s in shown if s)
        panels = (
            Panel(
                title="random loss",
                x_label="share hidden",
                y_label="RMSE, cm",
                curves=curves(subset, "ratio", "rmse_cm"),
            ),
            Panel(
                title=f"blocks of {LENGTH} frames",
                x_label="markers hidden",
                y_label="RMSE, cm",
                curves=curves(subset, "out", "rmse_cm"),
            ),
            Panel(title="frame by frame, blocks", x_label="s", y_label="RMSE of a frame, cm", curves=over_time),
        )
        made.append(Figure(name=f"wang2016_{take}", title=f"{take}: error of the missing markers", panels=panels))
    return made


EXPERIMENT = Experiment(
    reference="Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
    notes=notes,
)
