"""Intervals of lost joints at 60 Hz: svt, scsvt and bolero.

C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5: every second frame, cut to a multiple of l; 3 or 6
joints out in each interval of l = 15 to 120 frames. RMSE (24) of the raw iterate over all entries, in units of
56.444 mm, positions as they are in the file.

``svt`` and ``scsvt`` stand for our accelerated iterations of the same problems, which end at the printed tolerance; the
variants "step ..." are the printed iterations, for the seconds of Table II (3 joints only, as there).
"""

from dataclasses import replace
from functools import partial

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.errors import SolverError
from mocapclean.evaluation import metrics
from mocapclean.experiments.jobs import CMU_UNIT, Capture, Choice, Entry, Found, Job, Loss, grid, rms, solve
from mocapclean.experiments.published import published
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, beside, number
from mocapclean.take import Take
from mocapclean.take.bones import bones_of

MEASURES = ("rmse", "rmse_restored", "rmse_missing", "skeleton_rmse", "left", "seconds", "iterations", "converged")
LENGTHS = (15, 30, 60, 90, 120)
SHOWN = Loss(length=60, out=3)
"""The loss whose errors are shown over time, and against the seconds spent."""

ENTRIES = (
    Entry(method="svt", changes={"origin": "file"}),
    Entry(method="scsvt", changes={"origin": "file"}),
    Entry(method="bolero"),
)
PRINTED_STEPS = (
    Entry(method="svt", variant="step 1.5", changes={"origin": "file", "iteration": "paper", "step": 1.5}),
    Entry(method="svt", variant="step 0.75", changes={"origin": "file", "iteration": "paper", "step": 0.75}),
    Entry(method="scsvt", variant="step 0.75", changes={"origin": "file", "iteration": "paper", "step": 0.75}),
)
BARE = "without bones"
"""The variant of the default method, where it is asked for, that is not told the skeleton."""
PRINTED_AS = {"svt": "svt step 1.5", "scsvt": "scsvt step 0.75"}
"""Which printed seconds stand beside our own iterations."""

RESTORED = ("bolero",)
"""Methods whose estimate of the trusted entries is a model's; with these restored, too, in Table I."""

LIMITS = (10, 20, 40, 80, 160, 320, 640, 1280)


def jobs(choice: Choice) -> list[Job]:
    """Every cell of Tables I and II, then the error after fewer iterations."""
    own = ENTRIES[:2] if choice.quick and not choice.methods else ENTRIES
    steps = () if choice.quick else PRINTED_STEPS
    chosen = choice.entries((*own, *steps))
    timed = {(step.method, step.variant) for step in steps}
    lengths = (15, 60, 120) if choice.quick else LENGTHS
    losses = [Loss(length=length, out=out) for out in ((3,) if choice.quick else (3, 6)) for length in lengths]
    three = [loss for loss in losses if loss.out == 3]
    main = [entry for entry in chosen if (entry.method, entry.variant) not in timed]
    main += [replace(entry, variant=BARE) for entry in main if entry.method == DEFAULT_METHOD]
    printed = [entry for entry in chosen if (entry.method, entry.variant) in timed]
    return [*grid(choice, main, losses, run), *grid(choice, printed, three, run), *_limited(choice, main)]


def _limited(choice: Choice, entries: list[Entry]) -> list[Job]:
    """The shown loss with the first seed and ever more iterations."""
    limits = LIMITS[1::2] if choice.quick else LIMITS
    return [
        Job(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell={"study": "seconds", "limit": str(limit)},
            seed=0,
            run=partial(_measured, capture, entry, limit),
        )
        for capture in choice.captures
        for entry in entries
        if entry.method in ("svt", "scsvt", "bolero")
        for limit in limits
    ]


def _measured(capture: Capture, entry: Entry, limit: int) -> Found:
    limited = replace(entry, changes={**entry.changes, "max_iterations": limit})
    return run(capture, limited, SHOWN, 0)[0], {}


def halved(take: Take, length: int) -> Take:
    """Every second frame, cut to a multiple of ``length``; SolverError for a take that is too short."""
    n_frames = (len(take.trusted) + 1) // 2 // length * length
    if not n_frames:
        raise SolverError(f"a take must have {2 * length} frames for intervals of {length}. Got {len(take.trusted)}.")
    return take.crop(0, 2 * n_frames, 2)


def run(capture: Capture, entry: Entry, loss: Loss, seed: int) -> Found:
    """Errors (24), (25) and (26); the series of the shown loss has one column per joint."""
    truth = halved(capture.take, loss.length)
    missing = loss.missing(truth, seed)
    known = replace(truth, skeleton=None) if entry.variant == BARE else truth
    solution, seconds = solve(known, missing, entry)
    judged = truth.trusted & (solution.filled | ~missing)
    differences = (solution.positions - truth.positions) / CMU_UNIT
    measures = {
        "rmse": rms(differences[judged]),
        "rmse_restored": rms(np.where(missing[..., None], differences, 0.0)[judged]),
        "rmse_missing": rms(differences[judged & missing]),
        "left": int((missing & ~solution.filled).sum()),
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
    }
    skeleton = _skeleton_rmse(truth, solution.positions, judged)
    if skeleton is not None:
        measures["skeleton_rmse"] = skeleton / CMU_UNIT
    if loss != SHOWN or seed:
        return measures, {}
    distances = np.where(judged, np.linalg.norm(differences, axis=2), 0.0)
    per_frame = np.sqrt((distances**2).sum(axis=1) / (3 * np.maximum(judged.sum(axis=1), 1)))
    time = np.arange(len(distances)) / truth.rate
    joints = {name: distances[:, k] for k, name in enumerate(truth.markers)}
    return measures, {"seconds": time, "rmse": per_frame, **joints}


def _skeleton_rmse(truth: Take, positions: Floats, judged: Bools) -> float | None:
    """(25), mm: against the skeleton's lengths, or those of the rigid pairs of the complete take."""
    _, bones = bones_of(truth)
    column = {marker: k for k, marker in enumerate(truth.markers)}
    ends = np.array([(column[bone.start], column[bone.end]) for bone in bones], dtype=np.intp).reshape(-1, 2)
    return metrics.skeleton_rmse(positions, judged, ends, np.array([bone.length for bone in bones]))


def tables(results: Results) -> list[Table]:
    """Table I and Table II, ours above the printed values; then the skeleton RMSE."""
    return [_table1(results), _table2(results), _skeleton_table(results)]


def _table1(results: Results) -> Table:
    printed = {
        (row["take"], row["method"], row["out"], row["length"]): float(row["rmse"])
        for row in published("tan2015_table1")
    }
    cells = results.cells("out", "length")
    rows = []
    for take in results.takes:
        for label in results.where(take=take).labels:
            mine = results.where(take=take, label=label)
            theirs = [printed.get((take, label.split()[0], out, length)) for out, length in cells]
            for measure, name in (("rmse", "ours"), ("rmse_restored", "restored")):
                if measure == "rmse" or label in RESTORED:
                    ours = [mine.where(out=out, length=length).mean(measure) for out, length in cells]
                    above, _, ratio = beside(ours, theirs)
                    rows.append((take, label, name, *above, ratio))
            if any(theirs):
                rows.append((take, label, "printed", *(number(value) for value in theirs), ""))
    heads = [f"{out}/{length}" for out, length in cells]
    return Table(
        title="Table I: RMSE over all entries, units of 56.444 mm, joints out / frames; ratio: geometric mean",
        header=("take", "method", "", *heads, "ratio"),
        rows=tuple(rows),
    )


def _table2(results: Results) -> Table:
    printed = {
        (row["take"], f"{row['method']} {row['variant']}".rstrip()): float(row["seconds"])
        for row in published("tan2015_table2")
    }
    rows = []
    for take in results.takes:
        mine = results.where(take=take, out=3)
        for label in mine.labels:
            seconds = mine.where(label=label).mean("seconds")
            iterations = mine.where(label=label).mean("iterations")
            (ours,), (theirs,), ratio = beside([seconds], [printed.get((take, PRINTED_AS.get(label, label)))])
            rows.append((take, label, number(iterations), ours, theirs, ratio))
    return Table(
        title="Table II: seconds, 3 joints out, mean over the lengths (theirs: MATLAB, Intel i7-3770)",
        header=("take", "method", "iterations", "ours", "printed", "ratio"),
        rows=tuple(rows),
    )


def _skeleton_table(results: Results) -> Table:
    cells = results.cells("out", "length")
    rows = [
        (take, label, *(number(mine.where(out=o, length=n).mean("skeleton_rmse")) for o, n in cells))
        for take in results.takes
        for label in results.where(take=take).labels
        for mine in [results.where(take=take, label=label)]
    ]
    return Table(
        title="Skeleton RMSE (25), units of 56.444 mm, joints out / frames",
        header=("take", "method", *(f"{out}/{length}" for out, length in cells)),
        rows=tuple(rows),
    )


def figures(results: Results) -> list[Figure]:
    """For each take: errors over l; the joints' errors over time; the error over time, and against seconds."""
    found = []
    for take in results.takes:
        mine = results.where(take=take)
        outs = [out for (out,) in mine.cells("out")]
        found.append(
            Figure(
                name=f"tan2015_{take}_lengths",
                title=f"{take}: error over the length of intervals (dashed: printed)",
                panels=(
                    *(_over_lengths(mine, take, out, "rmse", "RMSE, 56.444 mm") for out in outs),
                    *(_over_lengths(mine, "", out, "skeleton_rmse", "skeleton RMSE, 56.444 mm") for out in outs),
                ),
            )
        )
        found += _over_time(mine, take)
    return found


def _over_lengths(results: Results, take: str, out: str, measure: str, label: str) -> Panel:
    curves = []
    for method in results.labels:
        mine = results.where(label=method, out=out)
        points = [(float(n), mine.where(length=n).mean(measure)) for (n,) in mine.cells("length")]
        known = [(x, y) for x, y in points if y is not None]
        curves.append(Curve(label=method, x=[x for x, _ in known], y=[y for _, y in known]))
        theirs = [
            (float(row["length"]), float(row["rmse"]))
            for row in published("tan2015_table1")
            if (row["take"], row["method"], row["out"]) == (take, method, out)
        ]
        if theirs:
            curves.append(Curve(label=method, x=[x for x, _ in theirs], y=[y for _, y in theirs], dashed=True))
    return Panel(title=f"{out} joints out", x_label="frames at 60 Hz", y_label=label, curves=tuple(curves))


def _over_time(results: Results, take: str) -> list[Figure]:
    shown = [(row.label, row.series()) for row in results.where(out=SHOWN.out, length=SHOWN.length).rows]
    kept = [(label, dict(series)) for label, series in shown if series]
    if not kept:
        return []
    pictures, curves = [], []
    for label, series in kept:
        seconds, rmse = series.pop("seconds"), series.pop("rmse")
        curves.append(Curve(label=label, x=seconds, y=rmse))
        pictures.append(
            Panel(
                title=label,
                x_label="s",
                y_label="joint",
                picture=np.array(list(series.values())),
                extent=(0.0, float(seconds[-1]), -0.5, len(series) - 0.5),
                ticks=tuple(series),
            )
        )
    loss = f"{SHOWN.out} joints out in intervals of {SHOWN.length} frames"
    panels = [Panel(title="over the take", x_label="s", y_label="RMSE of a frame, 56.444 mm", curves=tuple(curves))]
    timed = results.where(study="seconds")
    spent = []
    for label in timed.labels:
        rows = timed.where(label=label).rows
        spent.append(Curve(label=label, x=[r.values["seconds"] for r in rows], y=[r.values["rmse"] for r in rows]))
    if spent:
        panels.append(
            Panel(
                title="against the time spent",
                x_label="s of computing",
                y_label="RMSE, 56.444 mm",
                curves=tuple(spent),
                log_x=True,
                log_y=True,
            )
        )
    return [
        Figure(
            name=f"tan2015_{take}_joints", title=f"{take}: joint error (26), 56.444 mm; {loss}", panels=tuple(pictures)
        ),
        Figure(name=f"tan2015_{take}_time", title=f"{take}: {loss}", panels=tuple(panels)),
    ]
