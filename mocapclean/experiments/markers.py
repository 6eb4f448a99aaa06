"""Gaps of known size in real labelled markers: the default method against the others, and its expected errors.

This experiment is from no paper. The main patterns hide 1 marker for 30 frames, 3 for 60 and 5 for 120. Each marker has
one gap at a random time, at least 10 frames from the ends (``simulate.single_gaps``). Short gaps are reported
separately: 3 markers for 5 or 10 frames, and 30 gaps of 1 to 10 frames. A case is a take, a pattern and a seed. Natural
gaps stay missing. Errors are over hidden samples with a trusted sample of the same marker before and after the gap,
which every method fills.

Takes of a folder are run if they have enough labelled markers, frames and motion, and few natural gaps. Sorted by name,
every second take is for choosing constants, the others are for reporting. Computed points are left out by the reader.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import DEFAULT_METHOD, Grades
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics
from mocapclean.evaluation.metrics import GRADES
from mocapclean.experiments.cases import (
    CALIBRATION_MEASURES,
    HALF_NAMES,
    Half,
    by_half,
    calibration,
    calibration_tables,
    error_figure,
    pairs_of,
    share,
)
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.results import Figure, Results, Table, geometric_mean, number
from mocapclean.experiments.trials import Capture, Entry, Request, Trial, TrialResult, grid, solve
from mocapclean.simulate import single_gaps
from mocapclean.solvers.fillable import enclosed
from mocapclean.take import Take

MEASURES = (
    *("hidden", "left", "rmse", "rmse_3d", "largest", "gap_3d_median", "gap_3d_90", "seconds"),
    *CALIBRATION_MEASURES,
)
QUICK_FRAMES = 600
"""First frames of a take that --quick keeps; chosen by hand."""

METHODS = ("linear", "spline", "kalman", "pca", "pma", DEFAULT_METHOD)
ENTRIES = tuple(Entry(method=name) for name in dict.fromkeys(METHODS))

# The limits below were chosen by hand; no sweep was kept.
HARM = 2.0  # mm; a case that is worse than the better interpolation by more counts as harmed
LOSS = 1.0  # mm; a case in which the default is worse than the other method by more counts as lost
SHORT_GAP = 60  # frames; the longest gaps in the last column of the table of grades

MIN_MARKERS = 20  # labelled markers of a take that is run
MIN_FRAMES = 300  # of a take that is run; chosen by hand
MIN_RATE = 99.5  # Hz; 100 Hz, allowing for rounded rates
MAX_RATE = 120.5  # Hz; 120 Hz, allowing for rounded rates
MAX_MISSING = 0.05  # share of the samples
MIN_MOTION = 10.0  # mm, RMS distance of a marker from its mean position, median over the markers
MIN_PRESENT = 0.5  # share of the frames in which a marker must be trusted


@dataclass(frozen=True, kw_only=True)
class SingleGaps:
    """``out`` markers with one gap of ``length`` frames each."""

    out: int
    length: int

    @property
    def cell(self) -> dict[str, str]:
        """Return the size of the pattern."""
        return {"pattern": f"{self.out}x{self.length}"}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        n_frames, n_markers = take.trusted.shape
        return single_gaps(n_frames, n_markers, self.out, self.length, np.random.default_rng(seed)) & take.trusted


@dataclass(frozen=True, kw_only=True)
class ScatteredGaps:
    """``count`` gaps of 1 to ``longest`` frames, of random markers at random times, not at the ends of the take."""

    count: int
    longest: int

    @property
    def cell(self) -> dict[str, str]:
        """Return the size of the pattern."""
        return {"pattern": f"{self.count}x1-{self.longest}"}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, self.count, self.longest])
        n_frames, n_markers = take.trusted.shape
        hidden = np.zeros_like(take.trusted)
        for _ in range(self.count):
            hidden |= single_gaps(n_frames, n_markers, 1, int(rng.integers(1, self.longest + 1)), rng)
        return hidden & take.trusted


Pattern = SingleGaps | ScatteredGaps
MAIN = (  # 1, 3 and 5 markers out for a quarter, a half and a whole second at 120 Hz; chosen by hand
    SingleGaps(out=1, length=30),
    SingleGaps(out=3, length=60),
    SingleGaps(out=5, length=120),
)
SHORT: tuple[Pattern, ...] = (  # gaps that a path over time can bridge; chosen by hand
    SingleGaps(out=3, length=5),
    SingleGaps(out=3, length=10),
    ScatteredGaps(count=30, longest=10),
)


@dataclass(frozen=True, kw_only=True)
class Labelled(Capture):
    """A capture of which only labelled, measured markers are used."""

    @cached_property
    def take(self) -> Take:
        """Return the take's labelled markers."""
        return labelled(super().take)


def labelled(take: Take) -> Take:
    """Return the markers that have a label and are trusted in half of the frames."""
    present = take.trusted.mean(axis=0) >= MIN_PRESENT if len(take.trusted) else np.zeros_like(take.detached)
    return take.select(np.flatnonzero(present & ~take.detached))


def reason_to_skip(take: Take) -> str:
    """Return why a take of labelled markers is not run; empty if it is run."""
    n_frames, n_markers = take.trusted.shape
    if n_markers < MIN_MARKERS:
        return f"{n_markers} labelled markers"
    if n_frames < MIN_FRAMES:
        return f"{n_frames} frames"
    if not MIN_RATE <= take.rate <= MAX_RATE:
        return f"{take.rate:g} Hz"
    missing = 1.0 - float(take.trusted.mean())
    if missing > MAX_MISSING:
        return f"{100 * missing:.1f} % missing"
    if _motion(take) < MIN_MOTION:
        return "no motion"
    return ""


def _motion(take: Take) -> float:
    """Return the RMS distance of the markers from their mean positions, median over the markers, mm."""
    seen = take.trusted[..., None].astype(np.float64)
    count = seen.sum(axis=0)
    known = np.where(take.trusted[..., None], take.positions, 0.0)
    offsets = seen * (known - known.sum(axis=0) / count)
    return float(np.median(np.sqrt((offsets**2).sum(axis=(0, 2)) / count[:, 0])))


def selected(request: Request) -> tuple[list[Labelled], list[str]]:
    """Return the captures to run, and the others of the folder with the reason. Captures given by name are all run."""
    captures, left_out = [], []
    for capture in request.captures:
        labelled_capture = Labelled(path=capture.path, options=capture.options, n_frames=capture.n_frames)
        reason = _reason(labelled_capture) if request.captures == request.folder else ""
        if reason:
            left_out.append(f"{capture.path.name} ({reason})")
        else:
            captures.append(labelled_capture)
    return captures, left_out


@cache
def _reason(capture: Capture) -> str:
    """Return why a capture is not run; empty if it is run."""
    if formats.declaration(capture.path).columns != "markers":
        return "no markers"
    try:
        return reason_to_skip(capture.take)
    except MocapcleanError:
        return "cannot be read"


def trials(request: Request) -> list[Trial]:
    """Return a trial for every method and case."""
    captures, _ = selected(request)
    labelled_request = replace(request, captures=tuple(captures)).shortened(QUICK_FRAMES)
    return grid(labelled_request, request.entries(ENTRIES), [*MAIN, *SHORT], run)


def notes(request: Request) -> list[str]:
    """Return lines with the takes of both halves, and with the takes left out and why."""
    return notes_on(*selected(request))


def halves(takes: Sequence[str]) -> dict[str, list[str]]:
    """Return the takes of each half: sorted by name, they belong to the halves in turn."""
    ordered = sorted(takes)
    return {half: ordered[k::2] for k, half in enumerate(HALF_NAMES)}


def notes_on(captures: Sequence[Capture], left_out: Sequence[str], most_frames: int | None = None) -> list[str]:
    """Return lines with the captures of both halves, the most frames of each, and what was left out and why."""
    lines = [f"{half}: {', '.join(names) or 'none'}" for half, names in halves([c.name for c in captures]).items()]
    if most_frames is not None:
        lines.append(f"at most {most_frames} frames of each take")
    return [*lines, f"left out: {', '.join(left_out)}"] if left_out else lines


def run(capture: Capture, entry: Entry, pattern: Pattern, seed: int) -> TrialResult:
    """Return the errors of the hidden samples, and the number of coordinates inside the method's 90 % intervals.

    A method with expected errors adds series with a row for each gap: its frames, its 3D error and its expected error.
    """
    truth = capture.take
    hidden = pattern.hidden(truth, seed)
    solution, seconds = solve(truth, hidden, entry)
    compared = hidden & enclosed(truth.trusted & ~hidden)
    filled = compared & solution.filled
    measures: dict[str, float | int] = {
        "hidden": int(compared.sum()),
        "left": int((compared & ~filled).sum()),
        "seconds": seconds,
    }
    error = metrics.error(truth.positions, solution.positions, filled)
    if error is None:
        return measures, {}
    errors = np.where(filled[..., None], solution.positions - truth.positions, 0.0)
    gaps = [gap for gap in _gaps(~truth.trusted | hidden) if filled[gap].any()]
    gap_errors = [_rms_3d(errors[gap][filled[gap]]) for gap in gaps]
    measures |= {
        "rmse": error.rmse,
        "rmse_3d": error.rmse_3d,
        "largest": error.largest,
        "gap_3d_median": float(np.median(gap_errors)),
        "gap_3d_90": float(np.quantile(gap_errors, 0.9)),
    }
    if solution.sd is None:
        return measures, {}
    lengths = [len(range(*gap[0].indices(len(hidden)))) for gap in gaps]
    measures |= calibration(errors, solution.sd, filled, ~truth.trusted | hidden)
    expected = [metrics.expected_error(solution.sd[gap][filled[gap]]) for gap in gaps]
    series = {"frames": lengths, "error": gap_errors, "expected": expected}
    return measures, {name: np.array(values, dtype=np.float64) for name, values in series.items()}


def _gaps(untrusted: Bools) -> Iterator[tuple[slice, int]]:
    """Yield each gap as an index (frames, marker) into an array (F, M)."""
    for marker, start, stop in column_runs(untrusted):
        yield slice(start, stop), marker


def _rms_3d(errors: Floats) -> float:
    """Return the root mean squared length of errors (n, 3)."""
    return float(np.sqrt((errors**2).sum(axis=-1).mean()))


_MAIN = tuple(pattern.cell["pattern"] for pattern in MAIN)
_SHORT = tuple(pattern.cell["pattern"] for pattern in SHORT)


def tables(results: Results) -> list[Table]:
    """Return tables of errors, ratios to the default, harm, calibration and grades, each for both halves."""
    both = by_half(results, halves(results.takes))
    return [_errors(both), _ratios(both), _harm(both), *calibration_tables(both), _grades(both)]


def _errors(both: Sequence[Half]) -> Table:
    """Return the table of errors by pattern."""
    groups = [*((name,) for name in _MAIN), _MAIN, *((name,) for name in _SHORT)]
    rows = []
    for half in both:
        for label in half.rows:
            errors = [[*half.errors(label, group).values()] for group in groups]
            cells = [f"{number(np.median(e))} / {number(np.quantile(e, 0.9))}" if e else "-" for e in errors]
            rows.append((half.name, label, str(len(errors[len(_MAIN)])), *cells))
    heads = ["all three" if group == _MAIN else group[0] for group in groups]
    return Table(
        title="RMSE per coordinate, mm: median / 90th percentile of the cases, by markers out x frames",
        header=("half", "method", "cases", *heads),
        rows=tuple(rows),
    )


def _ratios(both: Sequence[Half]) -> Table:
    """Return the table of ratios of the default's errors to those of each other method and of the best of them."""
    groups = [*((name,) for name in _MAIN), _MAIN]
    rows = []
    for half in both:
        others = [label for label in half.rows if label != DEFAULT_METHOD]
        rivals = [(label, [label]) for label in others]
        if len(others) > 1:
            rivals.append(("best of them", others))
        for name, labels in rivals if DEFAULT_METHOD in half.rows else ():
            cells = []
            for group in groups:
                pairs = pairs_of(half.errors(DEFAULT_METHOD, group), half.best(labels, group))
                cells.append(number(geometric_mean(ours / theirs for ours, theirs in pairs if ours and theirs)))
            lost = [ours > theirs + LOSS for ours, theirs in pairs]
            rows.append((half.name, name, str(len(pairs)), *cells, share(sum(lost), len(lost))))
    return Table(
        title=f"{DEFAULT_METHOD} against others: geometric mean of the ratio of errors; lost: by more than {LOSS:g} mm",
        header=("half", "other", "cases", *_MAIN, "all three", "lost"),
        rows=tuple(rows),
    )


def _harm(both: Sequence[Half]) -> Table:
    """Return the table of cases in which a method is worse than interpolation."""
    rows = []
    interpolations = ("linear", "spline")
    for half in both:
        for label in half.rows:
            if label in interpolations:
                continue
            cells = []
            for group in (_MAIN, _SHORT):
                pairs = pairs_of(half.errors(label, group), half.best(interpolations, group))
                excess = [ours - theirs for ours, theirs in pairs]
                worse = sum(e > HARM for e in excess)
                cells += [str(len(pairs)), share(worse, len(pairs)), number(max(0.0, *excess) if excess else None)]
            rows.append((half.name, label, *cells))
    return Table(
        title=f"Harm: cases more than {HARM:g} mm worse than the better of linear and spline, and the worst of all, mm",
        header=("half", "method", "cases", "worse", "most", "short cases", "worse", "most"),
        rows=tuple(rows),
    )


def _grades(both: Sequence[Half]) -> Table:
    """Return the table of true errors of gaps by grade."""
    rows, limits = [], Grades()
    for half in both:
        for label, cases in half.rows.items():
            series = [curves for row in cases.values() if (curves := row.series())]
            if not series:
                continue
            error, expected, frames = (np.concatenate([s[k] for s in series]) for k in ("error", "expected", "frames"))
            grade = np.array([limits.of(value) for value in expected])
            for name in GRADES:
                graded = grade == name
                median, upper = np.quantile(error[graded], [0.5, 0.95]) if graded.any() else (None, None)
                is_short = frames <= SHORT_GAP
                row = (
                    str(graded.sum()),
                    number(median),
                    number(upper),
                    share((graded & is_short).sum(), is_short.sum()),
                )
                rows.append((half.name, label, name, *row))
    return Table(
        title=f"Gaps by expected 3D error (good up to {limits.good:g} mm, fair {limits.fair:g}); their 3D errors, mm",
        header=("half", "method", "grade", "gaps", "median", "95 %", f"of gaps up to {SHORT_GAP} frames"),
        rows=tuple(rows),
    )


def figures(results: Results) -> list[Figure]:
    """Return the figure of the cumulative share of cases over their error, for each main pattern."""
    return [error_figure(results, "markers_errors", _MAIN)]


EXPERIMENT = Experiment(
    reference="gaps of known size in real labelled markers, mocapclean.simulate.single_gaps",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    quick_frames=QUICK_FRAMES,
    notes=notes,
)
