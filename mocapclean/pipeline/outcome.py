"""What happened to a take, as reports show it: outcomes of repairs and verdicts of checks."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mocapclean.evaluation.metrics import Error, Length
from mocapclean.evaluation.self_check import HiddenGaps, SelfCheck
from mocapclean.take import Finding


@dataclass(frozen=True, kw_only=True)
class Gap:
    """A run of untrusted samples of one marker, and what became of it.

    start, stop: half-open indices. rules: why it was distrusted. n_filled: how many of its samples were filled;
    left_because: why not all of them. expected: the 3D error, mm, that the method expects of the samples it answered
    for, even if they were left for it; None where it gives no sd. grade: what that makes of a filled gap, one of
    ``GRADES``, or "". error: against the reference, if one was given.
    """

    marker: str
    start: int
    stop: int
    rules: tuple[str, ...]
    n_filled: int = 0
    left_because: str = ""
    expected: float | None = None
    grade: str = ""
    error: Error | None = None


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A method that might have been chosen: how it did on the hidden samples, or why it was left out."""

    method: str
    total: HiddenGaps
    left_out: str = ""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The method that was chosen for a take, why, and among which."""

    method: str
    because: str
    candidates: tuple[Candidate, ...]


@dataclass(frozen=True, kw_only=True)
class Breach:
    """A limit that a take does not keep: what was found and is allowed, where these are numbers, and what to do."""

    limit: str
    message: str
    advice: str
    marker: str | None = None
    found: float | None = None
    allowed: float | None = None


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """A take against its limits: what was measured, by limit, and what it does not keep."""

    source: Path
    breaches: tuple[Breach, ...] = ()
    seconds: float = 0.0
    format: str = ""
    n_frames: int = 0
    n_markers: int = 0
    first_frame: int = 1
    measures: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    @property
    def passes(self) -> bool:
        """Whether all limits are kept."""
        return not self.breaches


@dataclass(frozen=True, kw_only=True)
class BoneReport:
    """One bone before and after the repair; reference: its known length, or the take's median, mm."""

    start: str
    end: str
    reference: float
    before: Length
    after: Length


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Samples of the markers in play: all, distrusted (missing among them), filled, left, moved, invalidated."""

    samples: int
    untrusted: int
    missing: int
    filled: int
    left: int
    moved: int
    invalidated: int


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What happened to one take: everything that a report says, and nothing that it computes.

    status is "repaired", "unchanged", "skipped" or "failed"; lengths are millimetres, spans are half-open indices.
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
    rate: float = 0.0
    method: str = ""
    choice: Choice | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    counts: Counts | None = None
    gaps: tuple[Gap, ...] = ()
    findings: tuple[Finding, ...] = ()
    solution: Mapping[str, Any] = field(default_factory=dict)
    reference: Path | None = None
    accuracy: Error | None = None
    accuracy_by_marker: Mapping[str, Error] = field(default_factory=dict)
    accuracy_by_length: Mapping[str, Error] = field(default_factory=dict)
    self_check: SelfCheck | None = None
    fitting: Error | None = None
    bones_from: str = ""
    bones: tuple[BoneReport, ...] = ()
    skeleton_rmse: tuple[float | None, float | None] = (None, None)
