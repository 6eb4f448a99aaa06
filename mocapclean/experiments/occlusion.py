"""Gaps as cameras leave them, in real labelled markers: neighbours lost together, whole limbs, long losses at an end.

This experiment is from no paper. Markers that are near each other are lost together, in clusters of 3, 5 and 8, at the
end of the take, by the masks of captures with natural gaps, and where cameras around the take do not see past the body;
beside them 10 markers anywhere. A case is a take, a
pattern and a seed. Natural gaps of the take stay missing. Errors are over the hidden samples that a method fills.

The takes of ``CHOSEN`` are for choosing constants, those of ``REPORTED`` and all others for reporting. The two halves
share no source: no laboratory and no subject is in both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics
from mocapclean.experiments.cases import (
    CALIBRATION_MEASURES,
    HALF_NAMES,
    Half,
    by_half,
    calibration,
    calibration_tables,
    error_figure,
    inside,
    over_expected,
)
from mocapclean.experiments.experiment import Experiment
from mocapclean.experiments.markers import Labelled, SingleGaps
from mocapclean.experiments.results import Figure, Results, Row, Table, geometric_mean, number
from mocapclean.experiments.trials import Capture, Entry, LossPattern, Request, Trial, TrialResult, grid, solve
from mocapclean.geometry.distances import mean_distances
from mocapclean.simulate import occlude_by_cameras
from mocapclean.take import Take

CHOSEN = (
    "BTKData__others_FunctionalWalk",
    "MocapRecovery__data_HDM_mm_01-02_03_120",
    "auto-marker-label__transfer_learning_data_KneeltoProne01",
    "c3dio__Vicon_Motion_Systems_pyCGM2_lower_limb_CGM24_Walking01",
    "c3dio__sample_32_vicon_zerowire",
    "kineticstoolkit__data_kinematics_tennis_serve",
)
"""Takes of six sources on which constants are chosen, by the names of their files."""

REPORTED = (
    "MocapRecovery__data_85_12",
    "biomechzoo__Turn_HC030A22",
    "c3dio__sample_13_golfswing1",
    "c3dio__sample_30_marche281",
    "nimblephysics__ComplexKnee_2022_01_0403",
    "nimblephysics__c3d_cmu_dribble_shoot_basketball",
)
"""Takes of five other sources on which results are reported (two of the CMU, of different subjects)."""

GAPPY = (
    "MocapRecovery__data_03_rolling",
    "c3dio__Codamotion_codamotion_gaitwands_20150204",
    "c3dio__sample_26_Walking_Hybrid_1_3",
    "kineticstoolkit__kinematics_walkingOptiTrack",
    "nimblephysics__c3d_nick_freeform_001",
)
"""Captures of five sources with many natural gaps, whose masks are put into the takes."""

MOST_FRAMES = 1500
"""Frames of a take that are used, its first; chosen for speed."""

QUICK_FRAMES = 600
"""First frames of a take that --quick keeps; chosen by hand."""

MIN_FRAMES = 200  # of a take that is run: the longest pattern, and most of it before and after; chosen by hand
MIN_MARKERS = 12  # labelled markers of a take that is run: the largest cluster and half as many; chosen by hand

RIGID_SD = 3.0  # mm, SD of the distance of a pair of markers up to which it counts as rigid
MIN_SHARED = 60  # frames in which both markers of a rigid pair are trusted; chosen by hand

_MARGIN = 10  # frames between a cluster's gaps and the ends of the take, about; chosen by hand
_DISTANCE_FRAMES = 200  # most frames of the distances that define neighbours; chosen for speed
_PAIR_FRAMES = 600  # most frames of the distances that define rigid pairs; chosen for speed
_SPREADS = 2.0  # SDs of a distance that are added to its mean, so that neighbours belong to one segment if they can
_LEAST_LOSS = 0.005  # share of the frames that a marker of a mask must miss to be used; chosen by hand
_MOST_LOSS = 0.6  # the largest such share; chosen by hand
_MASKED_PART = 3  # a mask is put on one of so many markers, but at least on as many markers
NATURAL = "natural"
"""First word of the patterns that are masks of other captures."""

CAMERAS = "cameras"
"""First word of the patterns by ray casting."""

ENTRIES = tuple(Entry(method=name) for name in (DEFAULT_METHOD, "pma", "pca"))
MEASURES = (
    *("hidden", "left", "rmse", "rmse_3d", "largest", "pair", "pair_truth", "seconds"),
    *CALIBRATION_MEASURES,
)


def neighbours(take: Take) -> Ints:
    """Return all markers (M, M) in the order of their distance from each marker, itself first.

    The distance is the mean plus two SDs.
    """
    mean, deviation = mean_distances(take.positions, take.trusted, _DISTANCE_FRAMES)
    distance = mean + _SPREADS * deviation
    np.fill_diagonal(distance, -1.0)
    return np.argsort(distance, axis=1, kind="stable")


@dataclass(frozen=True, kw_only=True)
class Cluster:
    """A marker and its nearest ones, ``out`` in all, each lost for ``length`` frames.

    Their gaps start at about the same time: up to a quarter of the length sooner or later. at_end: they all start
    ``length`` frames before the end of the take instead.
    """

    out: int
    length: int
    at_end: bool = False

    @property
    def cell(self) -> dict[str, str]:
        """Return the size of the pattern."""
        return {"pattern": f"end{self.out}x{self.length}" if self.at_end else f"{self.out}n{self.length}"}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, self.out, self.length])
        n_frames, n_markers = take.trusted.shape
        hidden = np.zeros_like(take.trusted)
        members = neighbours(take)[rng.integers(n_markers), : self.out]
        if self.at_end:
            hidden[-self.length :, members] = True
            return hidden & take.trusted
        start = rng.integers(_MARGIN, n_frames - self.length - _MARGIN)
        shift = self.length // 4
        for member in members:
            first = max(_MARGIN // 2, start + rng.integers(-shift, shift + 1))
            hidden[first : min(first + self.length, n_frames - _MARGIN // 2), member] = True
        return hidden & take.trusted


@dataclass(frozen=True, kw_only=True)
class NaturalMask:
    """The missing samples of a capture with natural gaps, frame by frame, from a random frame on.

    The marker that misses most falls on a random marker, and those that are lost together with it, most often first,
    fall on its nearest ones. So what was lost together is lost together.
    """

    capture: Capture = field(repr=False)

    @property
    def cell(self) -> dict[str, str]:
        """Return the name of the capture, and its digest."""
        return {"pattern": f"{NATURAL} {self.capture.name}", "mask": self.capture.digest}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, *self.capture.name.encode()])
        n_frames, n_markers = take.trusted.shape
        hidden = np.zeros_like(take.trusted)
        missing = ~self.capture.take.trusted
        start = rng.integers(0, max(0, len(missing) - n_frames) + 1)
        targets = neighbours(take)[rng.integers(n_markers)]
        missing = missing[start : start + n_frames]
        lost = missing.mean(axis=0)
        missing = missing[:, (lost > _LEAST_LOSS) & (lost < _MOST_LOSS)]
        if not missing.size:
            return hidden
        together = missing.T.astype(np.float64) @ missing
        order = np.argsort(-together[np.argmax(missing.sum(axis=0))], kind="stable")
        order = order[: max(_MASKED_PART, n_markers // _MASKED_PART)]
        hidden[: len(missing), targets[: len(order)]] = missing[:, order]
        hidden[0] = False
        return hidden & take.trusted


@dataclass(frozen=True, kw_only=True)
class CameraRing:
    """What fewer than two of ``cameras`` around the take see past its body (``simulate.occlude_by_cameras``).

    Markers that would be lost in more than 60 % of the frames are not hidden.
    """

    cameras: int

    @property
    def cell(self) -> dict[str, str]:
        """Return the number of cameras."""
        return {"pattern": f"{CAMERAS} {self.cameras}"}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        lost = occlude_by_cameras(take, np.random.default_rng([seed, self.cameras]), self.cameras)
        return np.asarray(lost & (lost.mean(axis=0) < _MOST_LOSS))


PATTERNS: tuple[LossPattern, ...] = (
    Cluster(out=3, length=60),
    Cluster(out=5, length=120),
    Cluster(out=8, length=60),
    Cluster(out=3, length=120, at_end=True),
    SingleGaps(out=10, length=30),
    *(CameraRing(cameras=n) for n in (6, 8, 12, 16)),
)
"""The patterns of every take; sizes chosen by hand, up to a second and to a fifth of 41 markers."""


def selected(request: Request) -> tuple[list[Capture], list[str]]:
    """Return the captures to run, of labelled markers and cropped, and the others with the reason."""
    captures, left_out = request.cropped(QUICK_FRAMES if request.quick else MOST_FRAMES, _reason_to_skip)
    return [_labelled(capture) for capture in captures], left_out


@cache
def _labelled(capture: Capture) -> Labelled:
    """Return the capture with its labelled markers only."""
    return Labelled(path=capture.path, options=capture.options, n_frames=capture.n_frames)


@cache
def _reason_to_skip(capture: Capture) -> str:
    """Return why a capture is not run; empty if it is run."""
    if formats.declaration(capture.path).columns != "markers":
        return "no markers"
    try:
        n_frames, n_markers = _labelled(capture).take.trusted.shape
    except MocapcleanError:
        return "cannot be read"
    if n_markers < MIN_MARKERS:
        return f"{n_markers} labelled markers"
    return f"{n_frames} frames" if n_frames < MIN_FRAMES else ""


def trials(request: Request) -> list[Trial]:
    """Return a trial for every method and case."""
    captures, _ = selected(request)
    masks = [NaturalMask(capture=_labelled(capture)) for capture in request.masks]
    return [
        trial
        for capture in captures
        for trial in grid(
            Request(captures=(capture,), n_seeds=request.n_seeds),
            request.entries(ENTRIES),
            [*PATTERNS, *(mask for mask in masks if mask.capture.name != capture.name)],
            run,
        )
    ]


def halves(takes: Sequence[str]) -> dict[str, list[str]]:
    """Return the takes of each half; takes in neither list are for reporting."""
    chosen = [take for take in takes if take in CHOSEN]
    return dict(zip(HALF_NAMES, (chosen, [take for take in takes if take not in CHOSEN]), strict=True))


def notes(request: Request) -> list[str]:
    """Return lines with the takes of both halves, the captures with gaps, and what was left out and why."""
    captures, left_out = selected(request)
    names = {**halves([c.name for c in captures]), "masks of": [c.name for c in request.masks], "left out": left_out}
    return [f"{what}: {', '.join(which)}" for what, which in names.items() if which]


def run(capture: Capture, entry: Entry, pattern: LossPattern, seed: int) -> TrialResult:
    """Return the errors of the hidden samples, their calibration, and the worst deviations of rigid pairs."""
    truth = capture.take
    hidden = pattern.hidden(truth, seed)
    solution, seconds = solve(truth, hidden, entry)
    filled = hidden & solution.filled
    measures: dict[str, float | int] = {
        "hidden": int(hidden.sum()),
        "left": int((hidden & ~filled).sum()),
        "seconds": seconds,
    }
    error = metrics.error(truth.positions, solution.positions, filled)
    if error is None:
        return measures, {}
    measures |= {"rmse": error.rmse, "rmse_3d": error.rmse_3d, "largest": error.largest}
    positions = np.where(filled[..., None], solution.positions, truth.positions)
    measures |= _worst_pairs(truth, positions, hidden, filled)
    if solution.sd is not None:
        errors = solution.positions - truth.positions
        measures |= calibration(errors, solution.sd, filled, ~truth.trusted | hidden)
    return measures, {}


def _worst_pairs(truth: Take, positions: Floats, hidden: Bools, filled: Bools) -> dict[str, float]:
    """Return the largest deviations of rigid pairs from their mean distance, mm: after the fill, and in truth.

    They are over the frames in which one marker of a pair is filled, and the other filled or trusted. Rigid pairs are
    those whose distance has an SD of at most 3 mm in the frames in which both are trusted and neither is hidden.
    """
    known = truth.trusted & ~hidden
    mean, deviation = mean_distances(truth.positions, known, _PAIR_FRAMES)
    shared = known.T.astype(np.float64) @ known
    first, second = np.nonzero(np.triu((deviation <= RIGID_SD) & (shared >= MIN_SHARED), 1))
    present = known | filled
    counted = (filled[:, first] | filled[:, second]) & present[:, first] & present[:, second]
    if not counted.any():
        return {}
    frame, pair = np.nonzero(counted)
    first, second = first[pair], second[pair]
    worst = [
        float(np.abs(np.linalg.norm(p[frame, first] - p[frame, second], axis=1) - mean[first, second]).max())
        for p in (positions, truth.positions)
    ]
    return {"pair": worst[0], "pair_truth": worst[1]}


# Tables


def tables(results: Results) -> list[Table]:
    """Return tables of the patterns, of the masks one by one, and of the calibration, each for both halves."""
    both = by_half(results, halves(results.takes))
    names = [name for (name,) in results.cells("pattern")]
    masks = [name for name in names if name.startswith(NATURAL)]
    groups = {name: [name] for name in names if name not in masks}
    if masks:
        groups["natural masks"] = masks
    made = [_errors("All patterns", both, groups)]
    if len(masks) > 1:
        made.append(_errors("Each mask", both, {name: [name] for name in masks}))
    return [*made, *calibration_tables(both)]


def _errors(title: str, both: Sequence[Half], groups: dict[str, list[str]]) -> Table:
    """Return a table with a row for each half, group of patterns and method."""
    rows = [
        (half.name, group, label, *_cells(half, label, patterns))
        for half in both
        for group, patterns in groups.items()
        for label in half.rows
    ]
    columns = (
        *("cases", "median", "90 %", "/ best other", "within 90 %", "/ expected"),
        *("pair", "in truth", "ratio", "left", "seconds"),
    )
    return Table(
        title=f"{title}: RMSE per coordinate, mm; / best other: geometric mean of the ratio case by case; / expected: "
        f"RMS 3D error over expected; pair: worst deviation of a rigid pair, mm, median of the cases",
        header=("half", "pattern", "method", *columns),
        rows=tuple(rows),
    )


def _cells(half: Half, label: str, patterns: Sequence[str]) -> tuple[str, ...]:
    """Return the values of a method in some patterns."""
    rows = half.of(label, patterns)
    values = list(rows.values())
    errors = [row.values["rmse"] for row in values]
    pairs, pairs_truth = ([row.values[name] for row in values if name in row.values] for name in ("pair", "pair_truth"))
    ratios = [ours / theirs for ours, theirs in _beside_others(half, label, patterns) if ours and theirs]
    left, hidden = (sum(row.values[name] for row in values) for name in ("left", "hidden"))
    return (
        str(len(values)),
        _median(errors),
        number(float(np.quantile(errors, 0.9)) if errors else None),
        number(geometric_mean(ratios)),
        inside(values),
        over_expected(values),
        _median(pairs),
        _median(pairs_truth),
        _median([after / before for after, before in zip(pairs, pairs_truth, strict=True) if before]),
        f"{100 * left / hidden:.1f} %" if hidden else "-",
        number(float(np.mean([row.values["seconds"] for row in values])) if values else None),
    )


def _median(values: Sequence[float]) -> str:
    """Return the median of some values as text; "-" without any."""
    return number(float(np.median(values)) if values else None)


def _beside_others(half: Half, label: str, patterns: Sequence[str]) -> list[tuple[float, float]]:
    """Return a method's RMSE and the least of the others in each case.

    A method that leaves more samples of the case than this one does not count: those left may be the hardest.
    """
    pairs = []
    for case, row in half.of(label, patterns).items():
        rivals: list[Row] = [rows[case] for other, rows in half.rows.items() if other != label and case in rows]
        errors = [r.values["rmse"] for r in rivals if "rmse" in r.values and r.values["left"] <= row.values["left"]]
        if errors:
            pairs.append((row.values["rmse"], min(errors)))
    return pairs


def figures(results: Results) -> list[Figure]:
    """Return the figure of the cumulative share of cases over their error, for each pattern."""
    return [error_figure(results, "occlusion_errors", [name for (name,) in results.cells("pattern")])]


EXPERIMENT = Experiment(
    reference="neighbours lost together in real labelled markers",
    measures=MEASURES,
    trials=trials,
    tables=tables,
    figures=figures,
    sequences=(*CHOSEN, *REPORTED),
    gappy=GAPPY,
    quick_frames=QUICK_FRAMES,
    notes=notes,
)
