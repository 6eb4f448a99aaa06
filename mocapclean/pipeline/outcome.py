"""Records for reports: the outcome of a repair or inspection, and the verdict of a check."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mocapclean.evaluation.metrics import Error, Length
from mocapclean.evaluation.self_check import HiddenGaps, SelfCheck
from mocapclean.take import Finding
from mocapclean.take.status import Status


@dataclass(frozen=True, kw_only=True)
class GapReport:
    """A run of untrusted samples of one marker, and what became of it.

    start, stop: half-open indices. rules: the rules that distrust its samples. n_filled: how many samples were filled,
    and n_replaced how many of these are in the file. largest_move: mm, between the file and the output, for these.
    status: the status of its samples, or the most frequent one of those that were left. expected: the 3D error, mm,
    that the method expects of the samples it answered; None where it gives no sd. grade: the grade of a filled gap,
    one of ``GRADES``, or "". error: the error against the reference, if one was given. Of a joint also: channels: those
    that are not trusted. expected_degrees: the size of the rotation error that the method expects. largest_turn:
    degrees, between the file and the output, for replaced samples. fitted: mm, the largest distance between where the
    method put what hangs on the joint and where the stored pose has it.
    """

    marker: str
    start: int
    stop: int
    rules: tuple[str, ...]
    status: Status
    n_filled: int = 0
    n_replaced: int = 0
    largest_move: float | None = None
    expected: float | None = None
    grade: str = ""
    error: Error | None = None
    channels: tuple[str, ...] = ()
    expected_degrees: float | None = None
    largest_turn: float | None = None
    fitted: float | None = None


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A candidate of method auto: its result on the hidden samples, or the reason why it was left out."""

    method: str
    total: HiddenGaps
    left_out: str = ""


@dataclass(frozen=True, kw_only=True)
class MethodChoice:
    """The method that was chosen for a take, the reason, and its candidates."""

    method: str
    because: str
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, kw_only=True)
class Breach:
    """A limit that a take breaks: the value found and the value allowed, where these are numbers, and what to do."""

    limit: str
    message: str
    advice: str
    marker: str | None = None
    found: float | None = None
    allowed: float | None = None


@dataclass(frozen=True, kw_only=True)
class BoneReport:
    """One bone before and after the repair; reference is its known length or the take's median, mm."""

    start: str
    end: str
    reference: float
    before: Length
    after: Length


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Numbers of samples of the selected markers.

    samples: all. untrusted: missing or distrusted. filled: supplied by the method, the replaced ones included.
    replaced: measured in the file and supplied nevertheless, because a rule or the user distrusts them. left: untrusted
    and not filled. moved: trusted and moved as asked. suspicious: reported by a rule and left as they are.
    invalidated: marked missing in the output. outside: of the frames that are not judged, in none of the other numbers.
    """

    samples: int
    untrusted: int
    missing: int
    filled: int
    replaced: int
    left: int
    moved: int
    suspicious: int
    invalidated: int
    outside: int


@dataclass(frozen=True, kw_only=True)
class LearntFrom:
    """A file that a take was learnt from, with its hash.

    moved: markers that it did not teach, because they were placed elsewhere there.
    """

    path: Path
    sha256: str
    moved: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What happened to one take: everything that a report shows, so that a report computes nothing.

    status is "repaired", "unchanged", "inspected", "skipped" or "failed". statuses: how many samples have each status.
    largest_move: mm, the largest distance between a replaced sample in the file and in the output. outdated: the
    carried points that may have been computed from a changed marker. judged: the first and last number of the frames
    that are judged and repaired; None for all.
    contacts_broken: joint, first and last frame number of the contacts that the repair breaks; None for markers.
    Lengths are millimetres, spans are half-open indices.
    """

    source: Path
    status: str
    output: Path | None = None
    sidecar: Path | None = None
    error: str = ""
    exit_code: int = 0
    seconds: float = 0.0
    source_sha256: str = ""
    output_sha256: str = ""
    format: str = ""
    n_frames: int = 0
    n_markers: int = 0
    first_frame: int = 1
    judged: tuple[int, int] | None = None
    rate: float = 0.0
    method: str = ""
    choice: MethodChoice | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    counts: Counts | None = None
    statuses: Mapping[Status, int] = field(default_factory=dict)
    largest_move: float | None = None
    gaps: tuple[GapReport, ...] = ()
    findings: tuple[Finding, ...] = ()
    outdated: tuple[str, ...] = ()
    contacts_broken: tuple[tuple[str, int, int], ...] | None = None
    solution: Mapping[str, Any] = field(default_factory=dict)
    reference: Path | None = None
    learnt_from: tuple[LearntFrom, ...] = ()
    accuracy: Error | None = None
    accuracy_by_marker: Mapping[str, Error] = field(default_factory=dict)
    accuracy_by_length: Mapping[str, Error] = field(default_factory=dict)
    self_check: SelfCheck | None = None
    bones_from: str = ""
    bones: tuple[BoneReport, ...] = ()
    skeleton_rmse: tuple[float | None, float | None] = (None, None)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The result of a check: the measured value for each limit, and the limits that the take breaks.

    judged: the first and the last number of the frames that are judged; None for all. inspected: counts, gaps and bones
    of the take, where a page is made of it.
    """

    source: Path
    breaches: tuple[Breach, ...] = ()
    seconds: float = 0.0
    format: str = ""
    n_frames: int = 0
    n_markers: int = 0
    first_frame: int = 1
    judged: tuple[int, int] | None = None
    measures: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    inspected: Outcome | None = None

    @property
    def passes(self) -> bool:
        """Whether all limits are kept."""
        return not self.breaches

    @property
    def worst(self) -> tuple[tuple[Breach, int], ...]:
        """The worst breach of each limit, and how many breaches of the limit there are."""
        limits: dict[str, list[Breach]] = {}
        for breach in self.breaches:
            limits.setdefault(breach.limit, []).append(breach)
        return tuple((max(each, key=lambda breach: breach.found or 0.0), len(each)) for each in limits.values())
