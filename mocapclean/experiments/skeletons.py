"""Takes with poses (BVH, AMC): damage of known place, found by the rules and filled by the default method.

This experiment is from no paper. Copies of a take get several events of one kind (``joint_damage``); ``detect`` runs
with its defaults, and the default method fills what is not known. An event of a kind that the rules must find is found
if no channel of it is known any more, and attributed if in its frames no channel of another joint is distrusted that is
known in the undamaged take. Errors are over events that are filled. The straight turn (slerp) and, for the root, the
straight line run between the same known frames. Ratios are geometric means over the events of the RMS errors, with a
floor of 0.01 degrees and 0.1 mm on both. Millimetres are those of all joints that hang on the damaged one. Takes run at
their own rate, and with every n-th frame at about 60 and 30 Hz.
"""

from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial
from time import perf_counter

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.detection import detect
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.joint_damage import DAMAGES, DETECTED, Damaged, Event, below, damaged
from mocapclean.experiments.markers import halves, notes_on
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Row, Table, geometric_mean, number
from mocapclean.experiments.trials import Capture, Entry, Request, Trial, TrialResult, parameters
from mocapclean.geometry.euler import rotations_of
from mocapclean.geometry.joint_motion import (
    angles_between,
    conjugate,
    joint_motion,
    rotation_vectors,
    times,
    with_motion,
)
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.pipeline.joints import fill_poses, merge_poses
from mocapclean.take import Solution, Take
from mocapclean.take.posed import joint_positions, known_poses

MOST_FRAMES = 2000
"""First frames of a take that are used; chosen for speed."""

QUICK_FRAMES = 600
"""First frames of a take that --quick keeps; chosen by hand."""

RATES = (60, 30)
"""Hz of the copies with every n-th frame, about; of takes that are faster by half or more."""

GROUPS = ("100+", "60", "24-30")
"""Names of the groups of rates, from the fastest."""

MIN_FRAMES = 60  # of a take, or of every n-th frame, that is run; by hand
UNCHANGED = "as it is"
MEASURES = (
    *(
        "rate",
        "samples",
        "replaced",
        "distrusted",
        "events",
        "found",
        "partly",
        "attributed",
        "left",
        "steps",
        "stepped",
    ),
    *("coordinates", "covered", "kept", "changed", "seconds"),
)
_LEAST_DEGREES, _LEAST_MM = 0.01, 0.1  # floors of both errors of a ratio
_STEP_FACTOR, _STEP_DEGREES = 1.5, 1.0  # times the truth's step, plus degrees, above which a step counts
_GROUP_LIMITS = 80.0, 40.0  # Hz between the groups of rates
_PER = 1e5  # joint-frames to which the counts of the tables refer
_FASTER = 1.5  # times a rate of RATES, from which a take has copies at it
_BALL = 3  # rotation channels of joints whose error bars are checked: all coordinates of their errors are free


# Captures


def selected(request: Request) -> tuple[list[Capture], list[str]]:
    """Return the captures to run, cropped, and the others with the reason."""
    return request.cropped(QUICK_FRAMES if request.quick else MOST_FRAMES, _reason_to_skip)


@cache
def _reason_to_skip(capture: Capture) -> str:
    """Return why a capture is not run; empty if it is run."""
    if formats.declaration(capture.path).columns == "markers":
        return "no skeleton"
    try:
        take = capture.posed
    except MocapcleanError:
        return "cannot be read"
    if take.poses is None:
        return "no skeleton"
    return f"{len(take.trusted)} frames" if len(take.trusted) < MIN_FRAMES else ""


def notes(request: Request) -> list[str]:
    """Return lines with the takes of both halves, and with the takes left out and why."""
    return notes_on(*selected(request), MOST_FRAMES)


def decimations(take: Take) -> dict[str, int]:
    """Return the whole steps between frames by the name of the rate: its own, and about 60 and 30 Hz."""
    steps = {"own": 1}
    for rate in RATES:
        step = round(take.rate / rate)
        if take.rate >= _FASTER * rate and len(take.trusted) >= MIN_FRAMES * step:
            steps[str(rate)] = step
    return steps


def group(rate: float) -> str:
    """Return the name of the group that a rate, Hz, belongs to."""
    return GROUPS[sum(rate < limit for limit in _GROUP_LIMITS)]


def trials(request: Request) -> list[Trial]:
    """Return a trial for every take, rate, damage and seed."""
    entries = request.entries([Entry(method=DEFAULT_METHOD)])
    captures, _ = selected(request)
    cases: list[tuple[dict[str, str], Callable[[Capture, int, Entry, int], TrialResult]]] = [
        ({"damage": UNCHANGED}, run_unchanged),
        *(({"damage": kind, "size": str(size)}, partial(run, kind, size)) for kind, size in DAMAGES),
    ]
    return [
        Trial(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell={"format": capture.path.suffix.lower().lstrip("."), "rate": name, **cell},
            seed=seed,
            run=partial(case, capture, step, entry, seed),
        )
        for capture in captures
        for name, step in decimations(capture.posed).items()
        for cell, case in cases
        for seed in range(1 if cell["damage"] == UNCHANGED else request.n_seeds)
        for entry in entries
    ]


@lru_cache(maxsize=2)
def _judged(capture: Capture, step: int) -> tuple[Take, Take]:
    """Return the take with every n-th frame, and the same after detection."""
    take = capture.posed
    take = take if step == 1 else take.crop(0, len(take.trusted), step)
    return take, detect(take)


def _solution(entry: Entry, judged: Take) -> Solution:
    """Return the answer of the method for all joints that are not trusted."""
    return fill_poses(entry.method, judged, parameters(entry), ~judged.trusted, entry.learned)


# Trials


def run_unchanged(capture: Capture, step: int, entry: Entry, seed: int) -> TrialResult:
    """Return the joint-frames of the take as it is that are distrusted, and replaced."""
    truth, judged = _judged(capture, step)
    distrusted = truth.trusted & ~judged.trusted
    replaced = distrusted & _solution(entry, judged).filled if distrusted.any() else distrusted
    return {
        "rate": truth.rate,
        "samples": int(truth.trusted.sum()),
        "distrusted": int(distrusted.sum()),
        "replaced": int(replaced.sum()),
    }, {}


def run(kind: str, size: int, capture: Capture, step: int, entry: Entry, seed: int) -> TrialResult:
    """Return what becomes of the events of one kind of damage; nothing where the take has no place for it.

    The series have a row for each event: its errors and the straight turn's; NaN where it is not filled.
    """
    truth, natural = _judged(capture, step)
    assert natural.known is not None
    copy = damaged(truth, kind, size, seed, natural.known)
    if copy is None:
        return {"rate": truth.rate, "events": 0}, {}
    begin = perf_counter()
    judged = detect(copy.take)
    solution = _solution(entry, judged)
    merged = merge_poses(judged, solution, ~judged.trusted)
    seconds = perf_counter() - begin
    measures, series = _measured(copy, truth, natural.known, judged, solution, merged)
    if kind not in DETECTED:
        measures = {name: value for name, value in measures.items() if name not in ("found", "partly", "attributed")}
    return {"rate": truth.rate, **measures, "seconds": seconds}, series


def _measured(
    copy: Damaged, truth: Take, right: Bools, judged: Take, solution: Solution, merged: Take
) -> tuple[dict[str, float | int], dict[str, Floats]]:
    """Return the measures of all events of a copy, and the errors of each."""
    skeleton, poses, known = known_poses(judged)
    true_poses = known_poses(truth)[1]
    assert merged.poses is not None
    doubted = right & ~known & ~copy.mask
    found = [not known[e.start : e.stop, list(e.channels)].any() for e in copy.events]
    partly = [not known[e.start : e.stop, list(e.channels)].all() for e in copy.events]
    alone = [
        not doubted[e.start : e.stop][:, [owner not in _joints(skeleton, e) for owner in truth.owners]].any()
        for e in copy.events
    ]
    # The truth with the damaged channels as the fill has them, and as a straight turn has them.
    straight = joint_motion(skeleton, poses, known)
    mask = copy.mask & ~known
    by_line = with_motion(skeleton, np.where(known, poses, np.nan), ~known, straight.rotations, straight.translations)
    answers = [np.where(mask, each, true_poses) for each in (merged.poses, by_line)]
    rotations = joint_motion(skeleton, true_poses, np.isfinite(true_poses)).rotations
    after = joint_motion(skeleton, merged.poses, np.isfinite(merged.poses)).rotations
    errors = rotation_vectors(times(conjugate(rotations), after))
    straight_errors = angles_between(rotations, straight.rotations)
    balls = np.array([len(channels) == _BALL for channels in rotations_of(skeleton)])
    left, steps, stepped, coordinates, covered = 0, 0, 0, 0, 0
    rows: list[tuple[float, ...]] = []
    for event, is_found in zip(copy.events, found, strict=True):
        joints = [joint for joint in _joints(skeleton, event) if _turned(event, joint, skeleton)]
        frames = slice(event.start, event.stop)
        filled = is_found and bool(solution.filled[frames, [event.joint, *joints]].all())
        left += is_found and not filled
        if not filled:
            rows.append((np.nan,) * 4)
            continue
        ours, slerp = np.nan, np.nan
        if joints:
            ours = _rms_length(errors[frames][:, joints])
            slerp = float(np.sqrt((straight_errors[frames][:, joints] ** 2).mean()))
            inside = _run_around(judged.trusted[:, event.joint], event)
            limits = _STEP_FACTOR * _steps(rotations[inside][:, joints]).max(axis=0) + _STEP_DEGREES
            steps += 1
            stepped += bool((_steps(after[inside][:, joints]) > limits).any())
            free = [joint for joint in joints if balls[joint]]
            if solution.sd_degrees is not None and free:
                reach = metrics.INTERVAL_90 * solution.sd_degrees[frames][:, free][..., None]
                covers = np.abs(errors[frames][:, free]) <= reach
                coordinates += covers.size
                covered += int(covers.sum())
        inside_limb = below(skeleton, event.joint)
        places = [joint_positions(skeleton, each[frames])[:, inside_limb] for each in (true_poses, *answers)]
        rows.append((ours, slerp, *(_rms_length(each - places[0]) for each in places[1:])))
    untouched = right & ~copy.mask
    measures: dict[str, float | int] = {
        "events": len(copy.events),
        "found": sum(found),
        "partly": sum(partly),
        "attributed": sum(a and b for a, b in zip(found, alone, strict=True)),
        "left": left,
        "steps": steps,
        "stepped": stepped,
        "coordinates": coordinates,
        "covered": covered,
        "kept": int(untouched.sum()),
        "changed": int((merged.poses != poses)[untouched].sum()),
    }
    names = ("degrees", "straight degrees", "mm", "straight mm")
    return measures, dict(zip(names, np.array(rows, dtype=np.float64).T, strict=True))


def _joints(skeleton: Skeleton, event: Event) -> list[int]:
    """Return the joints whose channels an event damages."""
    channels = skeleton.channels
    return sorted({channels[index].joint for index in event.channels})


def _turned(event: Event, joint: int, skeleton: Skeleton) -> bool:
    """Whether an event damages rotations of a joint."""
    channels = skeleton.channels
    return any(channels[index].joint == joint and channels[index].is_rotation for index in event.channels)


def _run_around(trusted: Bools, event: Event) -> slice:
    """Return the run of untrusted frames of a joint (F,) around an event, and the frames beside it."""
    start, stop = event.start, event.stop
    while start > 0 and not trusted[start - 1]:
        start -= 1
    while stop < len(trusted) and not trusted[stop]:
        stop += 1
    return slice(max(0, start - 1), stop + 1)


def _steps(rotations: Floats) -> Floats:
    """Return the angles (F - 1, n), degrees, from frame to frame."""
    return angles_between(rotations[:-1], rotations[1:])


def _rms_length(errors: Floats) -> float:
    """Return the root mean squared length of vectors (..., 3)."""
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


# Tables


def tables(results: Results) -> list[Table]:
    """Return the tables of found events, of errors and of undamaged takes."""
    parts = [
        (half, Results(tuple(row for row in results.rows if row.take in takes)))
        for half, takes in halves(results.takes).items()
        if takes
    ]
    return [_found(results), _errors([*parts, ("both", results)]), _undamaged(parts), _replaced(results)]


def _total(rows: Sequence[Row], measure: str) -> int:
    """Return the sum of a measure over rows."""
    return round(sum(row.values.get(measure, 0.0) for row in rows))


def _classes(results: Results, kinds: Sequence[str] = ()) -> list[tuple[tuple[str, ...], list[Row]]]:
    """Return the rows with events by damage, size, group of rates and format, and all formats together."""
    classes: list[tuple[tuple[str, ...], list[Row]]] = []
    formats_of = sorted({row.cell["format"] for row in results.rows})
    for kind, size in DAMAGES:
        own = [
            row
            for row in results.rows
            if row.cell["damage"] == kind and row.cell["size"] == str(size) and row.values.get("events")
        ]
        for name in GROUPS:
            for suffix in formats_of:
                rows = [r for r in own if group(r.values["rate"]) == name and r.cell["format"] == suffix]
                if rows and (not kinds or kind in kinds):
                    classes.append(((kind, str(size), name, suffix), rows))
    return classes


def _share(part: int, whole: int) -> str:
    """Return a share in percent."""
    return number(100.0 * part / whole) if whole else "-"


def _found(results: Results) -> Table:
    """Return the table of found events."""
    rows = []
    for cells, own in _classes(results, DETECTED):
        events = _total(own, "events")
        shares = (_share(_total(own, name), events) for name in ("found", "attributed", "partly"))
        rows.append((*cells, str(len({row.take for row in own})), str(events), *shares))
    return Table(
        title="Events found in all their frames, found without another joint, found at least in part, %",
        header=("damage", "size", "Hz", "format", "takes", "events", "found", "attributed", "in part"),
        rows=tuple(rows),
    )


def _errors(parts: Sequence[tuple[str, Results]]) -> Table:
    """Return the table of errors after the fill."""
    rows = [
        (half, *cells, *_error_cells(own))
        for half, results in parts
        for cells, own in _classes(results)
        if half == "both" or cells[0] in ("joint lost", "limb lost", "span")
    ]
    return Table(
        title="Filled events: rotation error, degrees (median / 90th percentile), ratio to the straight turn in "
        "degrees and in mm; steps above 1.5 times the truth's plus 1 degree, %; error bars that hold, %; untouched "
        "channels, %",
        header=(
            *("half", "damage", "size", "Hz", "format", "filled", "left", "degrees", "to straight", "in mm"),
            *("steps", "bars", "untouched"),
        ),
        rows=tuple(rows),
    )


def _error_cells(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the cells of a row of the table of errors."""
    all_series = [series for row in rows if (series := row.series())]
    columns = {name: np.concatenate([s[name] for s in all_series]) for name in all_series[0]} if all_series else {}
    degrees = columns.get("degrees", np.empty(0))
    turned = degrees[np.isfinite(degrees)]
    quantiles = f"{number(np.median(turned))} / {number(np.quantile(turned, 0.9))}" if turned.size else "-"
    kept = _total(rows, "kept")
    return (
        str(int(np.isfinite(columns.get("mm", np.empty(0))).sum())),
        str(_total(rows, "left")),
        quantiles,
        number(ratio(degrees, columns.get("straight degrees", degrees), _LEAST_DEGREES)),
        number(ratio(columns.get("mm", degrees), columns.get("straight mm", degrees), _LEAST_MM)),
        _share(_total(rows, "stepped"), _total(rows, "steps")),
        _share(_total(rows, "covered"), _total(rows, "coordinates")),
        f"{100.0 * (kept - _total(rows, 'changed')) / kept:.6g}" if kept else "-",
    )


def ratio(ours: Floats, theirs: Floats, floor: float) -> float | None:
    """Return the geometric mean of the ratios of errors, both at least ``floor``; None without any."""
    both = np.isfinite(ours) & np.isfinite(theirs)
    return geometric_mean(np.maximum(ours[both], floor) / np.maximum(theirs[both], floor))


def _undamaged(parts: Sequence[tuple[str, Results]]) -> Table:
    """Return the table of what is replaced in undamaged takes, by half and group of rates."""
    rows = []
    for half, results in parts:
        own = results.where(damage=UNCHANGED).rows
        for name in (*GROUPS, "all"):
            some = [row for row in own if name in ("all", group(row.values["rate"]))]
            if some:
                samples = _total(some, "samples")
                per = [number(_PER * _total(some, what) / max(samples, 1)) for what in ("replaced", "distrusted")]
                touched = sum(row.values["replaced"] > 0 for row in some)
                rows.append((half, name, str(len(some)), str(touched), str(samples), *per))
    return Table(
        title="Undamaged takes: joint-frames replaced, and distrusted, per 100,000",
        header=("half", "Hz", "takes", "with any", "joint-frames", "replaced", "distrusted"),
        rows=tuple(rows),
    )


def _replaced(results: Results) -> Table:
    """Return the list of undamaged takes with joint-frames replaced."""
    own = [row for row in results.where(damage=UNCHANGED).rows if row.values["distrusted"]]
    own.sort(key=lambda row: -row.values["distrusted"])
    return Table(
        title="Undamaged takes in which joint-frames are distrusted",
        header=("take", "rate", "joint-frames", "replaced", "distrusted"),
        rows=tuple(
            (
                row.take,
                f"{row.values['rate']:.4g}",
                *(str(round(row.values[name])) for name in ("samples", "replaced", "distrusted")),
            )
            for row in own
        ),
    )


def figures(results: Results) -> list[Figure]:
    """Return the figure of the cumulative share of lost joints over their rotation error, a panel for each length."""
    panels = []
    for kind, size in DAMAGES:
        if kind != "joint lost":
            continue
        curves = []
        for name in GROUPS:
            rows = [r for r in results.where(damage=kind, size=size).rows if group(r.values["rate"]) == name]
            errors = [series["degrees"] for row in rows if (series := row.series())]
            if errors:
                degrees = np.sort(np.concatenate(errors))
                degrees = degrees[np.isfinite(degrees)]
                share = (np.arange(degrees.size) + 1.0) / max(degrees.size, 1)
                curves.append(Curve(label=f"{name} Hz", x=degrees, y=share))
        panels.append(Panel(title=f"{size} frames", x_label="degrees", y_label="share", curves=tuple(curves)))
    return [Figure(name="skeletons_lost", title="Lost joints over their rotation error", panels=tuple(panels))]


EXPERIMENT = Experiment(
    reference="damage of known place in the poses of skeletons",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
    infers_unit=True,
    notes=notes,
)
