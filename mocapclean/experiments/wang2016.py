"""Ten to thirty percent of the markers out: llc with a trained dictionary, srmmp, dynammo and svt.

Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016: random loss and blocks of
60 frames; per-frame RMSE (8) in cm, the root of the mean squared distance over the missing markers of a frame, √3 times
the RMSE of a coordinate.

Training: the other takes of the same subject (the file name up to the first ``_``) among the captures and the folder,
without those that are tested too where that leaves one; where there are none, all takes of other subjects. The take
under test is never among them.

The competitors are tuned as in the paper, by cross-validation on training takes: of three values of its main parameter
a method gets the one with the least error on the first 600 frames of up to two of them, a fifth of the markers out in
blocks of 60 frames; srmmp then learns from the others, and has its default where there is no other.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.body_parts import known_parts
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.dictionaries.training import Params, train
from mocapclean.errors import UsageError
from mocapclean.experiments.jobs import LEARNERS, Capture, Choice, Entry, Found, Job, Loss, grid, solve
from mocapclean.experiments.losses import curves
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number

MEASURES = ("rmse_cm", "seconds", "iterations", "converged", "left", "share", "tuned")
RATIOS = (0.1, 0.2, 0.3)
LENGTH = 60
QUICK_FRAMES = 240
QUICK_TRAINING = Params(atoms=128, windows=1024, sweeps=2, hole_passes=1)
ENTRIES = (Entry(method="dynammo"), Entry(method="srmmp"), Entry(method="svt"), Entry(method="llc"))
TUNED: dict[str, tuple[str, tuple[float, ...]]] = {
    "dynammo": ("states", (8, 16, 32)),
    "srmmp": ("sparsity_weight", (1e-4, 1e-3, 1e-2)),
    "svt": ("threshold", (150.0, 450.0, 1350.0)),
}
"""The parameter of a competitor that is tuned, and the values that it is tried with."""
N_FOLDS, FOLD_FRAMES, FOLD_SHARE = 2, 600, 0.2


def jobs(choice: Choice) -> list[Job]:
    """Every method with both losses; a method that learns is trained for each take when it is first needed."""
    entries = choice.entries(ENTRIES, trained=True)
    params = QUICK_TRAINING if choice.quick else Params()
    found = []
    for capture in choice.captures:
        n_markers = len(capture.take.markers)
        ratios = RATIOS[::2] if choice.quick else RATIOS
        blocks = [Loss(length=LENGTH, out=max(1, round(ratio * n_markers))) for ratio in ratios]
        chosen = [*(Loss(ratio=ratio) for ratio in ratios), *blocks]
        split = split_of(capture, choice) if any(map(_learns, entries)) else []
        lesson = Lesson(split, params, QUICK_FRAMES if choice.quick else FOLD_FRAMES)
        found += _jobs(replace(choice, captures=(capture,)), entries, chosen, lesson)
    return found


def _tunable(entry: Entry) -> bool:
    return entry.method in TUNED and entry.learned is None and TUNED[entry.method][0] not in entry.changes


def _learns(entry: Entry) -> bool:
    return _tunable(entry) or (entry.method in LEARNERS and entry.learned is None)


class Lesson:
    """What is learnt from the training takes of one capture, when it is first needed."""

    def __init__(self, split: list[Capture], params: Params, n_frames: int) -> None:
        self.split, self.params, self.n_frames = split, params, n_frames
        self.dictionary, self.tuned = cache(self._train), cache(self._tune)

    def prepared(self, entry: Entry) -> Entry:
        """The entry as it is run: tuned, and with the dictionary that it needs."""
        if _tunable(entry):
            entry = replace(entry, changes={**entry.changes, **self.tuned(entry.method)})
        if entry.method in LEARNERS and entry.learned is None:
            entry = replace(entry, learned=self.dictionary())
        return entry

    def _train(self) -> Dictionary:
        return _learnt(self.split, self.params)

    def _tune(self, method: str) -> dict[str, float]:
        """The tuned parameter; none where there are too few takes."""
        name, values = TUNED[method]
        folds = self.split[:N_FOLDS]
        if method in LEARNERS and len(self.split) == 1:
            return {}
        errors = [
            sum(self._miss(Entry(method=method, changes={name: value}), fold) for fold in folds) for value in values
        ]
        return {name: values[int(np.argmin(errors))]}

    def _miss(self, entry: Entry, fold: Capture) -> float:
        """The error on a training take of an entry that has not learnt from it."""
        short = replace(fold, n_frames=self.n_frames)
        loss = Loss(length=LENGTH, out=max(1, round(FOLD_SHARE * len(fold.take.markers))))
        others = [capture for capture in self.split if capture is not fold]
        learned = _learnt(others, QUICK_TRAINING) if entry.method in LEARNERS else None
        return float(run(short, replace(entry, learned=learned), loss, 0)[0]["rmse_cm"])


def _learnt(captures: list[Capture], params: Params) -> Dictionary:
    takes = [capture.take for capture in captures]
    return train(takes, known_parts(takes[0].markers), params)


def _jobs(choice: Choice, entries: list[Entry], losses: list[Loss], lesson: Lesson) -> list[Job]:
    """The jobs of one capture; what a method has learnt from is part of its key."""

    def run_prepared(capture: Capture, entry: Entry, loss: Loss, seed: int) -> Found:
        ready = lesson.prepared(entry)
        measures, series = run(capture, ready, loss, seed)
        found = ready.changes.get(TUNED[entry.method][0], 0.0) if _tunable(entry) else 0.0
        return {**measures, "tuned": float(found)}, series

    learnt = hashlib.sha256(repr([lesson.params, *(c.digest for c in lesson.split)]).encode()).hexdigest()[:8]
    made = grid(choice.shortened(QUICK_FRAMES), entries, losses, run_prepared)
    return [replace(j, source=f"{j.source}<{learnt}") if _learns(j.entry) else j for j in made]


def split_of(capture: Capture, choice: Choice) -> list[Capture]:
    """The captures to learn from; UsageError where there is none but the take itself."""
    known = {other.digest: other for other in (*choice.folder, *choice.captures)}
    others = [other for digest, other in known.items() if digest != capture.digest and other.name != capture.name]
    same = [other for other in others if _subject(other) == _subject(capture)]
    tested = {other.name for other in choice.captures}
    same = [other for other in same if other.name not in tested] or same
    if not others:
        raise UsageError(f"{capture.path}: other takes must be there to learn from. Name more, or give a --folder.")
    return sorted(same or others, key=lambda other: other.name)


def _subject(capture: Capture) -> str:
    return capture.name.split("_")[0]


def notes(choice: Choice) -> list[str]:
    """The training split."""
    if not any(map(_learns, choice.entries(ENTRIES, trained=True))):
        return []
    return [f"{c.name} is tested, learnt from: {_names(split_of(c, choice))}." for c in choice.captures]


def _names(captures: Iterable[Capture]) -> str:
    return ", ".join(capture.name for capture in captures)


def run(capture: Capture, entry: Entry, loss: Loss, seed: int) -> Found:
    """The mean over frames of the per-frame RMSE (8) in cm, and its series for the longest blocks."""
    truth = capture.take
    missing = loss.missing(truth, seed)
    solution, seconds = solve(truth, missing, entry)
    filled = missing & solution.filled
    per_frame = frame_rmse(truth.positions, solution.positions, filled)
    hit = filled.any(axis=1)
    measures = {
        "rmse_cm": float(per_frame[hit].mean()) if hit.any() else 0.0,
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
        "left": int((missing & ~filled).sum()),
        "share": float(missing.mean()),
        "tuned": 0.0,
    }
    kept = not seed and loss.out == max(1, round(RATIOS[-1] * len(truth.markers)))
    return measures, {"seconds": np.arange(len(per_frame)) / truth.rate, "rmse_cm": per_frame} if kept else {}


def frame_rmse(truth: Floats, positions: Floats, where: Bools) -> Floats:
    """(8): for each frame the root of the mean squared distance over the markers ``where`` (F, M), cm; 0 without."""
    squared = np.where(where, ((positions - truth) ** 2).sum(axis=2), 0.0).sum(axis=1)
    return np.asarray(np.sqrt(squared / np.maximum(where.sum(axis=1), 1)) / 10.0)


def tables(results: Results) -> list[Table]:
    """Errors and seconds for each take."""
    return [
        _table(results, "rmse_cm", "Per-frame RMSE (8), cm, mean over frames"),
        _table(results, "seconds", "Seconds"),
        _tuned(results),
    ]


def _tuned(results: Results) -> Table:
    """What the competitors were tuned to."""
    rows = []
    for take in results.takes:
        for method in TUNED:
            value = results.where(take=take, label=method).mean("tuned")
            if value:
                rows.append((take, method, TUNED[method][0], number(value)))
    return Table(title="Tuned by cross-validation", header=("take", "method", "parameter", "value"), rows=tuple(rows))


def _table(results: Results, measure: str, title: str) -> Table:
    ratios, outs = results.cells("ratio"), results.cells("out")
    rows = []
    for take in results.takes:
        for label in results.where(take=take).labels:
            mine = results.where(take=take, label=label)
            cells = [*(mine.where(ratio=r) for (r,) in ratios), *(mine.where(out=out) for (out,) in outs)]
            rows.append((take, label, *(number(cell.mean(measure)) for cell in cells)))
    heads = [*(f"random {100 * float(r):.0f} %" for (r,) in ratios), *(f"{out} out, {LENGTH} fr" for (out,) in outs)]
    return Table(title=title, header=("take", "method", *heads), rows=tuple(rows))


def figures(results: Results) -> list[Figure]:
    """For each take the error over the loss, and frame by frame with the most markers out in blocks."""
    found = []
    for take in results.takes:
        mine = results.where(take=take)
        shown = [(row.label, row.series()) for row in mine.rows if "out" in row.cell]
        over_time = tuple(Curve(label=name, x=s["seconds"], y=s["rmse_cm"]) for name, s in shown if s)
        panels = (
            Panel(
                title="random loss", x_label="share out", y_label="RMSE, cm", curves=curves(mine, "ratio", "rmse_cm")
            ),
            Panel(
                title=f"blocks of {LENGTH} frames",
                x_label="markers out",
                y_label="RMSE, cm",
                curves=curves(mine, "out", "rmse_cm"),
            ),
            Panel(title="frame by frame, blocks", x_label="s", y_label="RMSE of a frame, cm", curves=over_time),
        )
        found.append(Figure(name=f"wang2016_{take}", title=f"{take}: error of the missing markers", panels=panels))
    return found
