"""The experiments of Tan et al. 2015: joints lost in intervals, at 60 Hz; svt, scsvt and bolero.

C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5. Reproduces Table I (RMSE) and Table II (seconds)
beside the printed values. As in the paper, every second frame is used, cut to a multiple of l, and 3 or 6 joints are
lost in each interval of l = 15 to 120 frames. RMSE (24) is of the raw iterate over all entries, in units of 56.444 mm,
with positions as in the file.

``svt`` and ``scsvt`` are our accelerated iterations of the same problems and end at the printed tolerance. The variants
"step ..." are the printed iterations, for Table II, which has 3 lost joints only.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.errors import SolverError
from mocapclean.evaluation import metrics
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.published import published
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Table, number, with_printed
from mocapclean.experiments.trials import CMU_UNIT, Capture, Entry, Loss, Request, Trial, TrialResult, grid, rms, solve
from mocapclean.take import Take
from mocapclean.take.bones import bones_of

MEASURES = ("rmse", "rmse_restored", "rmse_missing", "skeleton_rmse", "left", "seconds", "iterations", "converged")
LENGTHS = (15, 30, 60, 90, 120)
"""Frames of an interval, l; Table I."""

SHOWN_LOSS = Loss(length=60, out=3)
"""The loss whose errors are plotted over time and over the seconds of computing."""

ENTRIES = (
    Entry(method="svt", changes={"origin": "file"}),
    Entry(method="scsvt", changes={"origin": "file"}),
    Entry(method="bolero"),
)
PRINTED_STEPS = (  # the printed iteration with the step sizes of Tan et al. 2015, Table II
    Entry(method="svt", variant="step 1.5", changes={"origin": "file", "iteration": "paper", "step": 1.5}),
    Entry(method="svt", variant="step 0.75", changes={"origin": "file", "iteration": "paper", "step": 0.75}),
    Entry(method="scsvt", variant="step 0.75", changes={"origin": "file", "iteration": "paper", "step": 0.75}),
)
WITHOUT_BONES = "without bones"
"""The variant of the default method, if requested, that gets no skeleton."""

PRINTED_AS = {"svt": "svt step 1.5", "scsvt": "scsvt step 0.75"}
"""The printed iteration in Table II that our accelerated iteration is compared with."""

ALSO_RESTORED = ("bolero",)
"""Methods that change trusted entries; Table I also has their error with the trusted entries restored."""

ITERATION_LIMITS = (10, 20, 40, 80, 160, 320, 640, 1280)
"""Iterations after which the error is measured, each twice the one before; chosen by hand."""


def trials(request: Request) -> list[Trial]:
    """Return the trials of Tables I and II, then those of the error after fewer iterations."""
    own = ENTRIES[:2] if request.quick and not request.methods else ENTRIES
    steps = () if request.quick else PRINTED_STEPS
    chosen = request.entries((*own, *steps))
    timed = {(step.method, step.variant) for step in steps}
    lengths = (15, 60, 120) if request.quick else LENGTHS
    losses = [Loss(length=length, out=out) for out in ((3,) if request.quick else (3, 6)) for length in lengths]
    three = [loss for loss in losses if loss.out == 3]
    main = [entry for entry in chosen if (entry.method, entry.variant) not in timed]
    main += [replace(entry, variant=WITHOUT_BONES) for entry in main if entry.method == DEFAULT_METHOD]
    printed = [entry for entry in chosen if (entry.method, entry.variant) in timed]
    return [*grid(request, main, losses, run), *grid(request, printed, three, run), *_limited_trials(request, main)]


def _limited_trials(request: Request, entries: list[Entry]) -> list[Trial]:
    """Return trials of ``SHOWN_LOSS`` with the first seed and increasing limits on the iterations."""
    limits = ITERATION_LIMITS[1::2] if request.quick else ITERATION_LIMITS
    return [
        Trial(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell={"study": "seconds", "limit": str(limit)},
            seed=0,
            run=partial(_run_limited, capture, entry, limit),
        )
        for capture in request.captures
        for entry in entries
        if entry.method in ("svt", "scsvt", "bolero")
        for limit in limits
    ]


def _run_limited(capture: Capture, entry: Entry, limit: int) -> TrialResult:
    """Return the errors for ``SHOWN_LOSS`` after at most ``limit`` iterations."""
    limited = replace(entry, changes={**entry.changes, "max_iterations": limit})
    return run(capture, limited, SHOWN_LOSS, 0)[0], {}


def every_second_frame(take: Take, length: int) -> Take:
    """Return every second frame, cut to a multiple of ``length``; raise SolverError for a take that is too short."""
    n_frames = (len(take.trusted) + 1) // 2 // length * length
    if not n_frames:
        raise SolverError(f"a take must have {2 * length} frames for intervals of {length}. Got {len(take.trusted)}.")
    return take.crop(0, 2 * n_frames, 2)


def run(capture: Capture, entry: Entry, loss: Loss, seed: int) -> TrialResult:
    """Return errors (24) and (25) and, for ``SHOWN_LOSS``, the joint errors (26) as series with a column per joint."""
    truth = every_second_frame(capture.take, loss.length)
    hidden = loss.hidden(truth, seed)
    given = replace(truth, skeleton=None) if entry.variant == WITHOUT_BONES else truth
    solution, seconds = solve(given, hidden, entry)
    compared = truth.trusted & (solution.filled | ~hidden)
    differences = (solution.positions - truth.positions) / CMU_UNIT
    measures = {
        "rmse": rms(differences[compared]),
        "rmse_restored": rms(np.where(hidden[..., None], differences, 0.0)[compared]),
        "rmse_missing": rms(differences[compared & hidden]),
        "left": int((hidden & ~solution.filled).sum()),
        "seconds": seconds,
        "iterations": solution.iterations,
        "converged": int(solution.converged),
    }
    skeleton = _skeleton_rmse(truth, solution.positions, compared)
    if skeleton is not None:
        measures["skeleton_rmse"] = skeleton / CMU_UNIT
    if loss != SHOWN_LOSS or seed:
        return measures, {}
    distances = np.where(compared, np.linalg.norm(differences, axis=2), 0.0)
    per_frame = np.sqrt((distances**2).sum(axis=1) / (3 * np.maximum(compared.sum(axis=1), 1)))
    time = np.arange(len(distances)) / truth.rate
    joints = {name: distances[:, k] for k, name in enumerate(truth.markers)}
    return measures, {"seconds": time, "rmse": per_frame, **joints}


def _skeleton_rmse(truth: Take, positions: Floats, compared: Bools) -> float | None:
    """Return the skeleton RMSE (25), mm, from the lengths of the skeleton or of the complete take's rigid pairs."""
    _, bones = bones_of(truth)
    column = {marker: k for k, marker in enumerate(truth.markers)}
    ends = np.array([(column[bone.start], column[bone.end]) for bone in bones], dtype=np.intp).reshape(-1, 2)
    return metrics.skeleton_rmse(positions, compared, ends, np.array([bone.length for bone in bones]))


def tables(results: Results) -> list[Table]:
    """Return Table I and Table II with the printed values, and the table of the skeleton RMSE."""
    return [_table1(results), _table2(results), _skeleton_table(results)]


def _table1(results: Results) -> Table:
    """Return Table I: our RMSE above the printed RMSE of each take and method."""
    printed = {
        (row["take"], row["method"], row["out"], row["length"]): float(row["rmse"])
        for row in published("tan2015_table1")
    }
    cells = results.cells("out", "length")
    rows = []
    for take in results.takes:
        for label in results.where(take=take).labels:
            subset = results.where(take=take, label=label)
            theirs = [printed.get((take, label.split()[0], out, length)) for out, length in cells]
            for measure, name in (("rmse", "ours"), ("rmse_restored", "restored")):
                if measure == "rmse" or label in ALSO_RESTORED:
                    ours = [subset.where(out=out, length=length).mean(measure) for out, length in cells]
                    above, _, ratio = with_printed(ours, theirs)
                    rows.append((take, label, name, *above, ratio))
            if any(theirs):
                rows.append((take, label, "printed", *(number(value) for value in theirs), ""))
    heads = [f"{out}/{length}" for out, length in cells]
    return Table(
        title="Table I: RMSE over all entries, units of 56.444 mm, joints lost / frames; ratio: geometric mean",
        header=("take", "method", "", *heads, "ratio"),
        rows=tuple(rows),
    )


def _table2(results: Results) -> Table:
    """Return Table II: our seconds beside the printed seconds."""
    printed = {
        (row["take"], f"{row['method']} {row['variant']}".rstrip()): float(row["seconds"])
        for row in published("tan2015_table2")
    }
    rows = []
    for take in results.takes:
        subset = results.where(take=take, out=3)
        for label in subset.labels:
            seconds = subset.where(label=label).mean("seconds")
            iterations = subset.where(label=label).mean("iterations")
            (ours,), (theirs,), ratio = with_printed([seconds], [printed.get((take, PRINTED_AS.get(label, label)))])
            rows.append((take, label, number(iterations), ours, theirs, ratio))
    return Table(
        title="Table II: seconds, 3 joints lost, mean over the lengths (printed: MATLAB, Intel i7-3770)",
        header=("take", "method", "iterations", "ours", "printed", "ratio"),
        rows=tuple(rows),
    )


def _skeleton_table(results: Results) -> Table:
    """Return the table of the skeleton RMSE (25), which the paper plots."""
    cells = results.cells("out", "length")
    rows = [
        (take, label, *(number(subset.where(out=o, length=n).mean("skeleton_rmse")) for o, n in cells))
        for take in results.takes
        for label in results.where(take=take).labels
        for subset in [results.where(take=take, label=label)]
    ]
    return Table(
        title="Skeleton RMSE (25), units of 56.444 mm, joints lost / frames",
        header=("take", "method", *(f"{out}/{length}" for out, length in cells)),
        rows=tuple(rows),
    )


def figures(results: Results) -> list[Figure]:
    """Return figures for each take: errors over l, joint errors over time, and errors over time and over seconds."""
    made = []
    for take in results.takes:
        subset = results.where(take=take)
        outs = [out for (out,) in subset.cells("out")]
        made.append(
            Figure(
                name=f"tan2015_{take}_lengths",
                title=f"{take}: error over the length of intervals (dashed: printed)",
                panels=(
                    *(_over_lengths(subset, take, out, "rmse", "RMSE, 56.444 mm") for out in outs),
                    *(_over_lengths(subset, "", out, "skeleton_rmse", "skeleton RMSE, 56.444 mm") for out in outs),
                ),
            )
        )
        made += _over_time(subset, take)
    return made


def _over_lengths(results: Results, take: str, out: str, measure: str, label: str) -> Panel:
    """Return a panel of a measure over l, with the printed values of the take as dashed curves."""
    curves = []
    for method in results.labels:
        subset = results.where(label=method, out=out)
        points = [(float(n), subset.where(length=n).mean(measure)) for (n,) in subset.cells("length")]
        known = [(x, y) for x, y in points if y is not None]
        curves.append(Curve(label=method, x=[x for x, _ in known], y=[y for _, y in known]))
        theirs = [
            (float(row["length"]), float(row["rmse"]))
            for row in published("tan2015_table1")
            if (row["take"], row["method"], row["out"]) == (take, method, out)
        ]
        if theirs:
            curves.append(Curve(label=method, x=[x for x, _ in theirs], y=[y for _, y in theirs], dashed=True))
    return Panel(title=f"{out} joints lost", x_label="frames at 60 Hz", y_label=label, curves=tuple(curves))


def _over_time(results: Results, take: str) -> list[Figure]:
    """Return the figures of ``SHOWN_LOSS``: joint errors over time; errors over time and over seconds of computing."""
    shown = [(row.label, row.series()) for row in results.where(out=SHOWN_LOSS.out, length=SHOWN_LOSS.length).rows]
    with_series = [(label, dict(series)) for label, series in shown if series]
    if not with_series:
        return []
    pictures, curves = [], []
    for label, series in with_series:
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
    loss = f"{SHOWN_LOSS.out} joints lost in intervals of {SHOWN_LOSS.length} frames"
    panels = [Panel(title="over the take", x_label="s", y_label="RMSE of a frame, 56.444 mm", curves=tuple(curves))]
    timed = results.where(study="seconds")
    spent = []
    for label in timed.labels:
        rows = timed.where(label=label).rows
        spent.append(Curve(label=label, x=[r.values["seconds"] for r in rows], y=[r.values["rmse"] for r in rows]))
    if spent:
        panels.append(
            Panel(
                title="over the time of computing",
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


EXPERIMENT = Experiment(
    reference="C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    sequences=("14_01", "85_02", "143_04", "49_02", "135_02", "135_11", "61_05", "88_04"),
)
