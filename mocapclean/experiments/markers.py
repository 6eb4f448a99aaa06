"""Real markers: gaps of known size in labelled takes, the default method against all others, and how honest it is.

Three patterns are judged: 1 marker out for 30 frames, 3 for 60, 5 for 120, each with one gap at a random place at least
10 frames off the ends (``simulate.single_gaps``). Short gaps are reported apart: 3 markers out for 5 or 10 frames, and
30 gaps of 1 to 10 frames. A case is a take, a pattern and a seed. Natural gaps stay missing; hidden samples with a
trusted one of the same marker before and after them count, which every method fills.

Of a folder those takes are run that have enough labelled markers, frames and motion, and few gaps of their own; every
second one in the order of their names is for choosing constants, the others are for reporting. Points computed from
others are no markers.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import DEFAULT_METHOD, Grades
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics
from mocapclean.evaluation.metrics import GRADES
from mocapclean.experiments.jobs import Capture, Choice, Entry, Found, Job, grid, solve
from mocapclean.experiments.results import Curve, Figure, Panel, Results, Row, Table, geometric_mean, number
from mocapclean.geometry.distances import mean_distances
from mocapclean.simulate import single_gaps
from mocapclean.solvers.fillable import enclosed
from mocapclean.take import Take

_LIMITS = metrics.LENGTH_CLASSES
CLASSES = (*(f"{low + 1}-{high}" for low, high in zip((0, *_LIMITS), _LIMITS, strict=False)), f"over {_LIMITS[-1]}")
MEASURES = (
    *("hidden", "left", "rmse", "rmse_3d", "largest", "gap_3d_median", "gap_3d_90", "seconds"),
    *(f"{what} {name}" for name in CLASSES for what in ("coordinates", "covered")),
)
QUICK_FRAMES = 600
METHODS = ("linear", "spline", "kalman", "pca", "pma", DEFAULT_METHOD)
ENTRIES = tuple(Entry(method=name) for name in dict.fromkeys(METHODS))
HALVES = ("chosen on", "reported on")

HARM = 2.0  # mm that a method may be worse than the better interpolation
LOSS = 1.0  # mm that the default may be worse than the best other method of a case

FEWEST_MARKERS, FEWEST_FRAMES, RATES = 20, 300, (99.5, 120.5)
MOST_MISSING = 0.05
LEAST_PRESENT = 0.5
LEAST_MOTION = 10.0
_EXACT = 0.01  # mm: a distance that varies by less is computed
_LOOKS = 600
_AXES = "OALP"
_CENTRE = re.compile(r"cent(er|re)|joint|JC$|^com$|^virtual", re.IGNORECASE)
_FOOT = re.compile(r"^[LR](ArchHeight|PROXFF|D1M0|FOF0|HDF0|TIB1)$")  # what the Oxford foot model puts out


@dataclass(frozen=True, kw_only=True)
class Gaps:
    """``out`` markers with one gap of ``length`` frames each."""

    out: int
    length: int

    @property
    def cell(self) -> dict[str, str]:
        """Its size."""
        return {"pattern": f"{self.out}x{self.length}"}

    def missing(self, take: Take, seed: int) -> Bools:
        """The trusted samples (F, M) that are hidden; the same for every method."""
        n_frames, n_markers = take.trusted.shape
        return single_gaps(n_frames, n_markers, self.out, self.length, np.random.default_rng(seed)) & take.trusted


@dataclass(frozen=True, kw_only=True)
class Scattered:
    """``count`` gaps of 1 to ``longest`` frames, of any markers at any places but the ends."""

    count: int
    longest: int

    @property
    def cell(self) -> dict[str, str]:
        """Its size."""
        return {"pattern": f"{self.count}x1-{self.longest}"}

    def missing(self, take: Take, seed: int) -> Bools:
        """The trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, self.count, self.longest])
        n_frames, n_markers = take.trusted.shape
        missing = np.zeros_like(take.trusted)
        for _ in range(self.count):
            missing |= single_gaps(n_frames, n_markers, 1, int(rng.integers(1, self.longest + 1)), rng)
        return missing & take.trusted


Pattern = Gaps | Scattered
JUDGED = (Gaps(out=1, length=30), Gaps(out=3, length=60), Gaps(out=5, length=120))
SHORT: tuple[Pattern, ...] = (Gaps(out=3, length=5), Gaps(out=3, length=10), Scattered(count=30, longest=10))


@dataclass(frozen=True, kw_only=True)
class Labelled(Capture):
    """A capture's labelled markers that are seen often enough, without what is computed from others."""

    @cached_property
    def take(self) -> Take:
        """The take, as ``labelled`` has it."""
        return labelled(super().take)


def labelled(take: Take) -> Take:
    """The markers with a name of their own that are trusted in half of the frames and not computed from others."""
    names = [name.rsplit(":", 1)[-1] for name in take.markers]
    often = take.trusted.mean(axis=0) >= LEAST_PRESENT if len(take.trusted) else np.zeros(len(names), dtype=bool)
    real = [often[k] and not name.startswith("*") and not _is_computed(name, names) for k, name in enumerate(names)]
    kept = take.select(np.flatnonzero(real))
    return kept.select(np.flatnonzero(~_repeated(kept)))


def _is_computed(name: str, names: Sequence[str]) -> bool:
    """Whether a name is that of a model's output: a joint centre, or one of the four points of a segment's axes."""
    axes = {name[:-1] + end for end in _AXES}
    return bool(_CENTRE.search(name) or _FOOT.match(name)) or (name[-1:] in _AXES and axes <= {*names})


def _repeated(take: Take) -> Bools:
    """The markers (M,) whose distance to an earlier one does not vary: nothing that is measured does so."""
    _, deviation = mean_distances(take.positions, take.trusted, _LOOKS)
    return np.asarray(np.triu(deviation < _EXACT, 1).any(axis=0))


def unfit(take: Take) -> str:
    """Why a take with its labelled markers is not to be run; empty when it is."""
    n_frames, n_markers = take.trusted.shape
    if n_markers < FEWEST_MARKERS:
        return f"{n_markers} labelled markers"
    if n_frames < FEWEST_FRAMES:
        return f"{n_frames} frames"
    if not RATES[0] <= take.rate <= RATES[1]:
        return f"{take.rate:g} Hz"
    missing = 1.0 - float(take.trusted.mean())
    if missing > MOST_MISSING:
        return f"{100 * missing:.1f} % missing"
    if _motion(take) < LEAST_MOTION:
        return "nobody moves"
    return ""


def _motion(take: Take) -> float:
    """The median over the markers of the root mean squared distance from their mean place, mm."""
    seen = take.trusted[..., None].astype(np.float64)
    count = seen.sum(axis=0)
    known = np.where(take.trusted[..., None], take.positions, 0.0)
    offsets = seen * (known - known.sum(axis=0) / count)
    return float(np.median(np.sqrt((offsets**2).sum(axis=(0, 2)) / count[:, 0])))


def selected(choice: Choice) -> tuple[list[Labelled], list[str]]:
    """The captures to run, and of those of a folder that are not, why."""
    captures, left_out = [], []
    for capture in choice.captures:
        fit = Labelled(path=capture.path, options=capture.options, n_frames=capture.n_frames)
        reason = _reason(fit) if choice.captures == choice.folder else ""
        if reason:
            left_out.append(f"{capture.path.name} ({reason})")
        else:
            captures.append(fit)
    return captures, left_out


@cache
def _reason(capture: Capture) -> str:
    if formats.declaration(capture.path).columns != "markers":
        return "no markers"
    try:
        return unfit(capture.take)
    except MocapcleanError:
        return "cannot be read"


def jobs(choice: Choice) -> list[Job]:
    """Every method on every case."""
    captures, _ = selected(choice)
    chosen = replace(choice, captures=tuple(captures)).shortened(QUICK_FRAMES)
    return grid(chosen, choice.entries(ENTRIES), [*JUDGED, *SHORT], run)


def notes(choice: Choice) -> list[str]:
    """The takes of both halves, and those of the folder that are left out, with the reason."""
    captures, left_out = selected(choice)
    lines = [f"{half}: {', '.join(names) or 'none'}" for half, names in halves([c.name for c in captures]).items()]
    return [*lines, f"left out: {', '.join(left_out)}"] if left_out else lines


def halves(takes: Sequence[str]) -> dict[str, list[str]]:
    """The takes in the order of their names, every second one in the other half."""
    ordered = sorted(takes)
    return {half: ordered[k::2] for k, half in enumerate(HALVES)}


def run(capture: Capture, entry: Entry, pattern: Pattern, seed: int) -> Found:
    """The error of the hidden samples, in all and by gap, and how many coordinates the method's intervals hold.

    A method with an expected error leaves a series with a row for each gap: its frames, its 3D error and the expected.
    """
    truth = capture.take
    missing = pattern.missing(truth, seed)
    solution, seconds = solve(truth, missing, entry)
    judged = missing & enclosed(truth.trusted & ~missing)
    filled = judged & solution.filled
    measures: dict[str, float | int] = {
        "hidden": int(judged.sum()),
        "left": int((judged & ~filled).sum()),
        "seconds": seconds,
    }
    found = metrics.error(truth.positions, solution.positions, filled)
    if found is None:
        return measures, {}
    errors = np.where(filled[..., None], solution.positions - truth.positions, 0.0)
    gaps = [gap for gap in _gaps(~truth.trusted | missing) if filled[gap].any()]
    size = [_rms_3d(errors[gap][filled[gap]]) for gap in gaps]
    measures |= {
        "rmse": found.rmse,
        "rmse_3d": found.rmse_3d,
        "largest": found.largest,
        "gap_3d_median": float(np.median(size)),
        "gap_3d_90": float(np.quantile(size, 0.9)),
    }
    if solution.sd is None:
        return measures, {}
    inside = np.abs(errors) <= metrics.INTERVAL_90 * solution.sd[..., None]
    lengths = [len(range(*gap[0].indices(len(missing)))) for gap in gaps]
    for name, members in metrics.by_length(lengths):
        held = [inside[gaps[k]][filled[gaps[k]]] for k in members]
        measures[f"coordinates {name}"] = sum(h.size for h in held)
        measures[f"covered {name}"] = sum(int(h.sum()) for h in held)
    expected = [metrics.expected_error(solution.sd[gap][filled[gap]]) for gap in gaps]
    series = {"frames": lengths, "error": size, "expected": expected}
    return measures, {name: np.array(values, dtype=np.float64) for name, values in series.items()}


def _gaps(untrusted: Bools) -> Iterator[tuple[slice, int]]:
    for marker, start, stop in column_runs(untrusted):
        yield slice(start, stop), marker


def _rms_3d(errors: Floats) -> float:
    """The root of the mean squared length of errors (n, 3)."""
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


Case = tuple[str, str, int]
_JUDGED = tuple(pattern.cell["pattern"] for pattern in JUDGED)
_SHORT = tuple(pattern.cell["pattern"] for pattern in SHORT)


@dataclass(frozen=True)
class Half:
    """The rows of one half of the takes, by method and case."""

    name: str
    rows: Mapping[str, Mapping[Case, Row]]

    def errors(self, label: str, patterns: Sequence[str]) -> dict[Case, float]:
        """The RMSE of a method in the cases of these patterns that it has filled."""
        rows = self.rows.get(label, {})
        return {case: row.values["rmse"] for case, row in rows.items() if case[1] in patterns and "rmse" in row.values}

    def best(self, labels: Sequence[str], patterns: Sequence[str]) -> dict[Case, float]:
        """The least RMSE that any of these methods has in each case."""
        found: dict[Case, float] = {}
        for label in labels:
            for case, error in self.errors(label, patterns).items():
                found[case] = min(error, found.get(case, np.inf))
        return found


def _split(results: Results) -> list[Half]:
    split = []
    for name, takes in halves(results.takes).items():
        rows: dict[str, dict[Case, Row]] = {label: {} for label in results.labels}
        for row in results.rows:
            if row.take in takes:
                rows[row.label][row.take, row.cell["pattern"], row.seed] = row
        split.append(Half(name, {label: cases for label, cases in rows.items() if cases}))
    return [half for half in split if half.rows]


def tables(results: Results) -> list[Table]:
    """Errors, the default against the others, calibration, grades, and harm, each for both halves."""
    split = _split(results)
    return [_errors(split), _ratios(split), _harm(split), _calibration(split), _grades(split)]


def _errors(split: Sequence[Half]) -> Table:
    groups = [*((name,) for name in _JUDGED), _JUDGED, *((name,) for name in _SHORT)]
    rows = []
    for half in split:
        for label in half.rows:
            errors = [[*half.errors(label, group).values()] for group in groups]
            cells = [f"{number(np.median(e))} / {number(np.quantile(e, 0.9))}" if e else "-" for e in errors]
            rows.append((half.name, label, str(len(errors[len(_JUDGED)])), *cells))
    heads = ["all three" if group == _JUDGED else group[0] for group in groups]
    return Table(
        title="RMSE per coordinate, mm: median / 90th percentile of the cases, by markers out x frames",
        header=("half", "method", "cases", *heads),
        rows=tuple(rows),
    )


def _ratios(split: Sequence[Half]) -> Table:
    groups = [*((name,) for name in _JUDGED), _JUDGED]
    rows = []
    for half in split:
        others = [label for label in half.rows if label != DEFAULT_METHOD]
        rivals = [(label, [label]) for label in others]
        if len(others) > 1:
            rivals.append(("best of them", others))
        for name, labels in rivals if DEFAULT_METHOD in half.rows else ():
            cells = []
            for group in groups:
                pairs = _pairs(half.errors(DEFAULT_METHOD, group), half.best(labels, group))
                cells.append(number(geometric_mean(mine / theirs for mine, theirs in pairs if mine and theirs)))
            lost = [mine > theirs + LOSS for mine, theirs in pairs]
            rows.append((half.name, name, str(len(pairs)), *cells, _share(sum(lost), len(lost))))
    return Table(
        title=f"{DEFAULT_METHOD} against others: geometric mean of the ratio of errors; lost: by more than {LOSS:g} mm",
        header=("half", "other", "cases", *_JUDGED, "all three", "lost"),
        rows=tuple(rows),
    )


def _harm(split: Sequence[Half]) -> Table:
    rows = []
    lines = ("linear", "spline")
    for half in split:
        for label in half.rows:
            if label in lines:
                continue
            cells = []
            for group in (_JUDGED, _SHORT):
                pairs = _pairs(half.errors(label, group), half.best(lines, group))
                excess = [mine - theirs for mine, theirs in pairs]
                worse = sum(e > HARM for e in excess)
                cells += [str(len(pairs)), _share(worse, len(pairs)), number(max(0.0, *excess) if excess else None)]
            rows.append((half.name, label, *cells))
    return Table(
        title=f"Harm: cases more than {HARM:g} mm worse than the better of linear and spline, and the worst of all, mm",
        header=("half", "method", "cases", "worse", "most", "short cases", "worse", "most"),
        rows=tuple(rows),
    )


def _pairs(mine: Mapping[Case, float], theirs: Mapping[Case, float]) -> list[tuple[float, float]]:
    return [(error, theirs[case]) for case, error in mine.items() if case in theirs]


def _share(count: int, of: int) -> str:
    return f"{100 * count / of:.1f} %" if of else "-"


def _calibration(split: Sequence[Half]) -> Table:
    rows = []
    for half in split:
        for label, cases in half.rows.items():
            total, held = (
                [int(sum(row.values.get(f"{what} {name}", 0) for row in cases.values())) for name in CLASSES]
                for what in ("coordinates", "covered")
            )
            if any(total):
                cells = [_share(*pair) for pair in zip(held, total, strict=True)]
                rows.append((half.name, label, *cells, _share(sum(held), sum(total)), str(sum(total))))
    return Table(
        title=f"Coordinates within {metrics.INTERVAL_90:g} sd (90 % if expected errors are right), by frames of a gap",
        header=("half", "method", *CLASSES, "all", "coordinates"),
        rows=tuple(rows),
    )


def _grades(split: Sequence[Half]) -> Table:
    rows, limits = [], Grades()
    for half in split:
        for label, cases in half.rows.items():
            series = [found for row in cases.values() if (found := row.series())]
            if not series:
                continue
            error, expected, frames = (np.concatenate([s[k] for s in series]) for k in ("error", "expected", "frames"))
            grade = np.array([limits.of(value) for value in expected])
            for name in GRADES:
                mine = grade == name
                middle, most = np.quantile(error[mine], [0.5, 0.95]) if mine.any() else (None, None)
                brief = frames <= 60
                row = (str(mine.sum()), number(middle), number(most), _share((mine & brief).sum(), brief.sum()))
                rows.append((half.name, label, name, *row))
    return Table(
        title=f"Gaps by expected 3D error (good up to {limits.good:g} mm, fair {limits.fair:g}); their 3D errors, mm",
        header=("half", "method", "grade", "gaps", "median", "95 %", "of gaps up to 60 frames"),
        rows=tuple(rows),
    )


def figures(results: Results) -> list[Figure]:
    """The share of cases below an error, for each of the three patterns."""
    panels = []
    for pattern in _JUDGED:
        curves = []
        for label in results.labels:
            rows = results.where(label=label, pattern=pattern).rows
            errors = sorted(row.values["rmse"] for row in rows if "rmse" in row.values)
            share = (np.arange(len(errors)) + 1.0) / max(len(errors), 1)
            curves.append(Curve(label=label, x=errors, y=share))
        panels.append(
            Panel(title=pattern, x_label="RMSE, mm", y_label="share of cases", curves=tuple(curves), log_x=True)
        )
    return [Figure(name="markers_errors", title="Cases with an error of at most so much", panels=tuple(panels))]
