"""Harm: right samples that the defaults replace, and gaps that they fill worse than a straight line or holding still.

This experiment is from no paper. Detection runs with its defaults on takes as they are and on variations of them
(``simulate.vary``), in which all samples but those of one known fault are right. A sample is replaced if it was
trusted, is distrusted by ``detect``, and is then filled with an expected error that is not graded poor. Within 2 frames
of a fault of its marker a sample counts as neither right nor wrong. A real capture has faults of its own; "anew" leaves
out what is distrusted in the take as it is.

Gaps are hidden as natural losses are: single markers, neighbours together, all markers of a prop, at the ends. Harm is
the RMS 3D error of a gap less that of the better of linear interpolation, held at the ends, and holding still.
"""

import zlib
from collections.abc import Callable, Sequence
from functools import cache, lru_cache, partial

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import DEFAULT_METHOD, Grades
from mocapclean.detection import RULES, detect
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.hidden_gaps import GAPS
from mocapclean.experiments.markers import HARM, halves, notes_on
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Row, Table, number
from mocapclean.experiments.trials import Capture, Entry, Request, Trial, TrialResult, parameters, solve
from mocapclean.numerics.interpolation import linear
from mocapclean.numerics.robust import MAD_TO_SD, nan_median
from mocapclean.simulate import VARIATIONS, vary
from mocapclean.simulate.variations import UNCHANGED
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take

MOST_FRAMES = 2000
"""First frames of a take that are used; chosen for speed."""

QUICK_FRAMES = 600
"""First frames of a take that --quick keeps; chosen by hand."""

MIN_FRAMES = 60  # of a take that is run: 2.5 s of film, half a second of 120 Hz; chosen by hand
MIN_MARKERS = 4  # that are seen in a take that is run; fewer hold no segment

MEASURES = (
    *("samples", "replaced", "anew", "near", "doubted", "suspicious", "moved", "noises"),
    *(f"by {rule}" for rule in RULES),
    *("gaps", "left", "harmed", "harmed_if_left", "worst", "seconds"),
)

_MARGIN = 2  # frames on both sides of a fault that count as neither right nor wrong; chosen by hand
_FAR_SECONDS = 1.0  # from a fault of any marker, beyond which it can be no reason to change a sample
_LEAST_NOISE = 0.1  # mm, noise of a coordinate below which a marker counts as having this much; what cameras resolve
_SECOND_DIFFERENCE = 6.0  # variance of the second difference of white noise over that of the noise, 1 + 4 + 1
_PER = 1e5  # samples to which the counts of the tables refer

LENGTHS = (10, 30, 60)
"""Frames at 120 Hz of the hidden gaps; they are scaled by the rate of the take."""

_RATE = 120.0  # Hz, to which LENGTHS refer
_FEWEST_LENGTHS = 4  # gap lengths that a take must be long
_WORST = 12  # takes and gaps in the lists of the worst


# Captures


def selected(request: Request) -> tuple[list[Capture], list[str]]:
    """Return the captures to run, cropped, and the others with the reason."""
    return request.cropped(QUICK_FRAMES if request.quick else MOST_FRAMES, _reason_to_skip)


@cache
def _reason_to_skip(capture: Capture) -> str:
    """Return why a capture is not run; empty if it is run."""
    try:
        take = capture.take
    except MocapcleanError:
        return "cannot be read"
    n_frames, n_seen = len(take.trusted), int(take.trusted.any(axis=0).sum())
    if n_seen < MIN_MARKERS:
        return f"{n_seen} markers seen"
    return f"{n_frames} frames" if n_frames < MIN_FRAMES else ""


def notes(request: Request) -> list[str]:
    """Return lines with the takes of both halves, and with the takes left out and why."""
    return notes_on(*selected(request), MOST_FRAMES)


def trials(request: Request) -> list[Trial]:
    """Return a trial for every variation, and for every kind and length of gaps."""
    entries = request.entries([Entry(method=DEFAULT_METHOD)])
    cases: list[tuple[dict[str, str], Callable[[Capture, Entry, int], TrialResult]]] = [
        *(({"variation": kind}, partial(run_detection, kind)) for kind in VARIATIONS),
        *(({"gaps": kind, "frames": str(n)}, partial(run_fill, kind, n)) for kind in GAPS for n in LENGTHS),
    ]
    captures, _ = selected(request)
    return [
        Trial(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell=cell,
            seed=seed,
            run=partial(run, capture, entry, seed),
        )
        for capture in captures
        for cell, run in cases
        for seed in range(1 if cell.get("variation") == UNCHANGED else request.n_seeds)
        for entry in entries
    ]


# Detection


def run_detection(kind: str, capture: Capture, entry: Entry, seed: int) -> TrialResult:
    """Return the right samples of a variation that are replaced, and how far; nothing where there is no variation."""
    varied = vary(capture.take, kind, seed)
    if varied is None:
        return {}, {}
    take = varied.take
    judged = detect(take)
    distrusted = take.trusted & ~judged.trusted
    replaced, positions = _filled(judged, distrusted, entry)
    # A sample is right unless it is near the fault of its marker; it counts if it is far from all faults in time.
    right = take.trusted & ~_widened(varied.faulty, _MARGIN)
    near = _widened(_some_marker(varied.faulty), round(_FAR_SECONDS * take.rate))
    counted = right & ~near
    before = (varied.source >= 0) & _natural(capture).ravel()[varied.source]
    moved = np.linalg.norm(positions - take.positions, axis=2)
    wrong = replaced & counted
    return {
        "samples": int(counted.sum()),
        "replaced": int(wrong.sum()),
        "anew": int((wrong & ~before).sum()),
        "near": int((replaced & right & near & ~before).sum()),
        "doubted": int((distrusted & ~replaced & counted).sum()),
        "suspicious": int((judged.suspicious & counted).sum()),
        "moved": float(moved[wrong].max(initial=0.0)),
        "noises": float((moved / noise(take))[wrong].max(initial=0.0)),
        **{f"by {rule}": int((wrong & ~before & judged.distrusted_by(rule)).sum()) for rule in RULES},
    }, {}


def _some_marker(mask: Bools) -> Bools:
    """Return the frames (F, 1) of a mask (F, M) in which it is True for some marker."""
    return np.asarray(mask.any(axis=1, keepdims=True))


def _filled(judged: Take, distrusted: Bools, entry: Entry) -> tuple[Bools, Floats]:
    """Return the distrusted samples (F, M) that the method fills by default, and the positions after that.

    Gaps that are graded poor stay as they are.
    """
    if not distrusted.any():
        return distrusted, judged.positions
    solution = run_method(entry.method, judged, parameters(entry), dictionary=entry.learned)
    filled = distrusted & solution.filled
    for marker, start, stop in column_runs(~judged.trusted & solution.filled):
        if _expected(solution, marker, start, stop) > Grades().fair:
            filled[start:stop, marker] = False
    return filled, np.where(filled[..., None], solution.positions, judged.positions)


def _expected(solution: Solution, marker: int, start: int, stop: int) -> float:
    """Return the expected 3D error of a gap, mm; 0 from a method without error bars."""
    expected = None if solution.sd is None else metrics.expected_error(solution.sd[start:stop, marker])
    return 0.0 if expected is None else expected


@lru_cache(maxsize=2)
def _natural(capture: Capture) -> Bools:
    """Return the samples (F, M) within 2 frames of those that are distrusted in the take as it is."""
    take = capture.take
    return _widened(take.trusted & ~detect(take).trusted, _MARGIN)


def _widened(mask: Bools, margin: int) -> Bools:
    """Return a mask (F, n) extended by ``margin`` frames to both sides."""
    wide = mask.copy()
    for column, start, stop in column_runs(mask):
        wide[max(0, start - margin) : stop + margin, column] = True
    return wide


def noise(take: Take) -> Floats:
    """Return the noise (M,) of a coordinate of each marker, mm: robust SD of the second difference over √6.

    It is at least 0.1 mm, also for markers that are never seen in three frames in a row.
    """
    known = np.where(take.trusted[..., None], take.positions, np.nan)
    bend = np.abs(known[2:] - 2.0 * known[1:-1] + known[:-2])
    sd = MAD_TO_SD * nan_median(bend.transpose(0, 2, 1).reshape(-1, bend.shape[1])) / np.sqrt(_SECOND_DIFFERENCE)
    return np.asarray(np.fmax(sd, _LEAST_NOISE))


# Hidden gaps


def run_fill(kind: str, frames: int, capture: Capture, entry: Entry, seed: int) -> TrialResult:
    """Return how much worse hidden gaps are filled than by the better of linear interpolation and holding still.

    The series have a row for each gap: its harm and its errors, and whether it is filled by default. Nothing where the
    take has no such gaps.
    """
    variation, choose = GAPS[kind]
    varied = vary(capture.take, variation, seed)
    length = max(1, round(frames * capture.take.rate / _RATE))
    if varied is None or len(varied.take.trusted) < _FEWEST_LENGTHS * length:
        return {}, {}
    truth = varied.take
    rng = np.random.default_rng([seed, frames, zlib.crc32(kind.encode())])
    hidden = choose(truth, np.flatnonzero((varied.source < 0).all(axis=0)), length, rng)
    if not hidden.any():
        return {}, {}
    solution, seconds = solve(truth, hidden, entry)
    straight, still = linear(truth.positions, truth.trusted & ~hidden), _held(truth, hidden)
    rows = []
    for marker, start, stop in column_runs(hidden):
        gap = slice(start, stop), marker
        answers = (solution.positions, straight, still)
        ours, by_line, by_rest = (_rms_3d(answer[gap] - truth.positions[gap]) for answer in answers)
        filled = solution.filled[gap].all() and _expected(solution, marker, start, stop) <= Grades().fair
        rows.append((ours - min(by_line, by_rest), ours, by_line, by_rest, filled))
    harm, ours, by_line, by_rest, filled = np.array(rows, dtype=np.float64).T
    accepted = filled > 0
    measures = {
        "gaps": len(rows),
        "left": int((~accepted).sum()),
        "harmed": int((harm[accepted] > HARM).sum()),
        "harmed_if_left": int((harm[~accepted] > HARM).sum()),
        "worst": float(harm[accepted].max(initial=0.0)),
        "seconds": seconds,
    }
    return measures, {"harm": harm, "error": ours, "linear": by_line, "still": by_rest, "filled": filled}


def _held(truth: Take, hidden: Bools) -> Floats:
    """Return positions (F, M, 3) in which a hidden gap has the last sample before it, or at the start the next one."""
    positions = truth.positions.copy()
    for marker, start, stop in column_runs(hidden):
        positions[start:stop, marker] = truth.positions[start - 1 if start > 0 else stop, marker]
    return positions


def _rms_3d(errors: Floats) -> float:
    """Return the root mean squared length of errors (n, 3)."""
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


# Tables


def tables(results: Results) -> list[Table]:
    """Return the tables of replaced samples and of harmed gaps, for each half and both, and the lists of the worst."""
    parts = [
        (half, Results(tuple(row for row in results.rows if row.take in takes)))
        for half, takes in halves(results.takes).items()
        if takes
    ]
    parts.append(("both", results))
    return [_detection(parts), _by_rule(results), _gaps(parts), _worst_takes(results), _worst_gaps(results)]


def _total(rows: Sequence[Row], measure: str) -> float:
    """Return the sum of a measure over rows."""
    return sum(row.values.get(measure, 0.0) for row in rows)


def _most(rows: Sequence[Row], measure: str) -> float:
    """Return the largest value of a measure in rows."""
    return max(row.values.get(measure, 0.0) for row in rows)


def _per_take(rows: Sequence[Row], measure: str) -> float:
    """Return the median over the takes of a measure per 100,000 samples."""
    takes = dict.fromkeys(row.take for row in rows)
    rates = []
    for take in takes:
        own = [row for row in rows if row.take == take]
        rates.append(_PER * _total(own, measure) / max(_total(own, "samples"), 1.0))
    return float(np.median(rates))


def _detection(parts: Sequence[tuple[str, Results]]) -> Table:
    """Return the table of replaced samples by variation."""
    rows = []
    for half, results in parts:
        measured = [row for row in results.rows if row.values.get("samples")]
        kinds = [(kind, [row for row in measured if row.cell["variation"] == kind]) for kind in VARIATIONS]
        for kind, own in [*(kinds if half != "both" else []), ("all", measured)]:
            if own:
                rows.append((half, kind, *_detection_cells(own)))
    return Table(
        title="Right samples per 100,000: replaced, anew (not distrusted in the take as it is), distrusted but left, "
        "suspicious; near: replaced anew within a second of a fault, count; the largest move, mm and in SD of noise",
        header=(
            *("half", "variation", "takes", "samples", "replaced, median", "pooled", "anew", "near", "left"),
            *("suspicious", "moved", "in noise"),
        ),
        rows=tuple(rows),
    )


def _detection_cells(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the cells of a row of the table of replaced samples."""
    samples = _total(rows, "samples")
    rates = {name: _PER * _total(rows, name) / samples for name in ("replaced", "anew", "doubted", "suspicious")}
    return (
        str(len({row.take for row in rows})),
        f"{samples:.0f}",
        number(_per_take(rows, "replaced")),
        number(rates["replaced"]),
        number(rates["anew"]),
        f"{_total(rows, 'near'):.0f}",
        number(rates["doubted"]),
        number(rates["suspicious"]),
        number(_most(rows, "moved")),
        number(_most(rows, "noises")),
    )


def _by_rule(results: Results) -> Table:
    """Return the table of the samples that are replaced anew, by variation and rule."""
    measured = [row for row in results.rows if row.values.get("anew")]
    rules = [rule for rule in RULES if _total(measured, f"by {rule}")]
    rows = []
    for kind in VARIATIONS:
        own = [row for row in measured if row.cell["variation"] == kind]
        if own:
            rows.append((kind, *(f"{_total(own, f'by {rule}'):.0f}" for rule in rules)))
    return Table(
        title="Right samples that are replaced anew, by the rule that the finding names",
        header=("variation", *rules),
        rows=tuple(rows),
    )


def _gaps(parts: Sequence[tuple[str, Results]]) -> Table:
    """Return the table of harmed gaps by their kind and length."""
    rows = []
    for half, results in parts:
        measured = [row for row in results.rows if row.values.get("gaps")]
        kinds = [
            (kind, str(n), [row for row in measured if (row.cell["gaps"], row.cell["frames"]) == (kind, str(n))])
            for kind in GAPS
            for n in LENGTHS
        ]
        for kind, frames, own in [*(kinds if half != "both" else []), ("all", "all", measured)]:
            if own:
                counts = [_total(own, name) for name in ("gaps", "left", "harmed", "harmed_if_left")]
                rows.append((half, kind, frames, *(f"{n:.0f}" for n in counts), number(_most(own, "worst"))))
    return Table(
        title=f"Hidden gaps: left (poor or no answer), harmed (3D RMS more than {HARM:g} mm above the better of "
        "linear and holding still) among the filled and among the left, and the worst of the filled, mm",
        header=("half", "gaps", "frames at 120 Hz", "gaps", "left", "harmed", "harmed if not left", "worst"),
        rows=tuple(rows),
    )


def _worst_takes(results: Results) -> Table:
    """Return the list of the takes and variations with most replaced samples."""
    found = [row for row in results.rows if row.values.get("anew") or row.cell.get("variation") == UNCHANGED]
    found = [row for row in found if row.values.get("replaced")]
    found.sort(key=lambda row: -row.values["replaced"])
    return Table(
        title="Most right samples replaced: the take as it is, and variations with samples that are replaced anew",
        header=("take", "variation", "seed", "replaced", "anew", "moved, mm", "in noise"),
        rows=tuple(
            (
                row.take,
                row.cell["variation"],
                str(row.seed),
                *(number(row.values[name]) for name in ("replaced", "anew", "moved", "noises")),
            )
            for row in found[:_WORST]
        ),
    )


def _worst_gaps(results: Results) -> Table:
    """Return the list of the takes and kinds of gaps with the worst harm."""
    found = sorted((row for row in results.rows if row.values.get("harmed")), key=lambda row: -row.values["worst"])
    rows = []
    for row in found[:_WORST]:
        series = row.series()
        worst = int(np.argmax(np.where(series["filled"] > 0, series["harm"], -np.inf)))
        errors = (number(float(series[name][worst])) for name in ("harm", "error", "linear", "still"))
        rows.append((row.take, row.cell["gaps"], row.cell["frames"], str(row.seed), *errors))
    return Table(
        title="Worst harm in a filled gap, mm, and the 3D errors of the method, of linear and of holding still",
        header=("take", "gaps", "frames at 120 Hz", "seed", "harm", "error", "linear", "still"),
        rows=tuple(rows),
    )


def figures(results: Results) -> list[Figure]:
    """Return the figure of the cumulative share of filled gaps over their harm, with a panel for each length."""
    panels = []
    for n in LENGTHS:
        curves = []
        for kind in GAPS:
            all_series = [series for row in results.where(gaps=kind, frames=n).rows if (series := row.series())]
            if not all_series:
                continue
            harm = np.sort(np.concatenate([s["harm"][s["filled"] > 0] for s in all_series]))
            curves.append(Curve(label=kind, x=harm, y=(np.arange(harm.size) + 1.0) / max(harm.size, 1)))
        panels.append(Panel(title=f"{n} frames at 120 Hz", x_label="harm, mm", y_label="share", curves=tuple(curves)))
    return [Figure(name="harm_gaps", title="Cumulative share of filled gaps over their harm", panels=tuple(panels))]


EXPERIMENT = Experiment(
    reference="right samples in unusual situations, mocapclean.simulate.vary, and hidden gaps",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
    notes=notes,
)
