"""The words that every room shares: Take, Finding, Solution, Outcome.

F is the number of frames (always the first axis) and M the number of markers (or joints). Frame numbers inside
are indices from 0 and spans are half open; reports add ``Take.first_frame`` and close them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.metrics import Error, Length
from mocapclean.skeleton import Skeleton

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

GRADES = ("good", "fair", "poor")


def _freeze(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Something a rule or a format says of a take.

    ``frames`` is a half-open span of indices (start, stop); ``marker`` or ``frames`` are None when the finding is
    about the whole take. ``level`` is "info", "warning" or "error"; ``advice`` says what to do.
    """

    rule: str
    message: str
    level: str = "info"
    marker: str | None = None
    frames: tuple[int, int] | None = None
    advice: str = ""


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """What a file does not say of itself and its user may.

    skeleton: the .asf of an .amc; rate: Hz, for formats that have none (AMC); unit: millimetres per unit of
    length, for formats that have none (BVH); points: names of C3D points to read as markers even though the file
    lists them as something else.
    """

    skeleton: Path | None = None
    rate: float | None = None
    unit: float | None = None
    points: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where a take was read from: its path, format, the options it was read with, and the kept document.

    largest: mm, the largest coordinate that the file can hold.
    """

    path: Path
    format: str
    options: ReadOptions
    document: Any = field(repr=False)
    largest: float = float("inf")


@dataclass(frozen=True, kw_only=True)
class Take:
    """A capture as a marker matrix.

    positions: (F, M, 3) float64, millimetres, finite wherever trusted.
    trusted: (F, M) bool, the only word on what is missing or doubted; NaN is never a signal.
    filled: (F, M) bool, untrusted samples whose position a solver has supplied since reading; moved: (F, M) bool,
    trusted samples that someone asked to have moved (denoised, exchanged). Writing changes only these two.
    markers: M distinct names. rate: frames per second exactly as stored. first_frame: the file's number of
    frame 0. skeleton: the joints and bones, if known. The arrays are read-only.
    """

    positions: Floats
    trusted: Bools
    markers: tuple[str, ...]
    rate: float
    filled: Bools = None  # type: ignore[assignment]
    moved: Bools = None  # type: ignore[assignment]
    first_frame: int = 1
    skeleton: Skeleton | None = None
    findings: tuple[Finding, ...] = ()
    origin: Origin | None = None

    def __post_init__(self) -> None:
        shape = self.trusted.shape
        for name in ("filled", "moved"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(shape, dtype=bool))
        shapes = self.positions.shape, self.filled.shape, self.moved.shape
        if shapes != ((*shape, 3), shape, shape):
            raise ValueError(f"positions must be (F, M, 3), filled and moved (F, M) for trusted {shape}. Got {shapes}.")
        if len(self.markers) != shape[1] or len(set(self.markers)) != shape[1]:
            raise ValueError(f"markers must be {shape[1]} distinct names. Got {len(self.markers)}.")
        for name in ("positions", "trusted", "filled", "moved"):
            object.__setattr__(self, name, _freeze(getattr(self, name)))

    @property
    def changed(self) -> Bools:
        """The samples (F, M) that are no longer what the file says: filled or moved."""
        return self.filled | self.moved

    def distrusted_by(self, rule: str) -> Bools:
        """The samples (F, M) that a rule, by its findings, distrusts."""
        mask = np.zeros_like(self.trusted)
        columns = {name: column for column, name in enumerate(self.markers)}
        for finding in self.findings:
            if finding.rule == rule and finding.marker in columns and finding.frames:
                mask[slice(*finding.frames), columns[finding.marker]] = True
        return mask

    def select(self, columns: NDArray[np.intp]) -> "Take":
        """The take with only these markers, by column; it can no longer be written to its own file."""
        return replace(
            self,
            positions=self.positions[:, columns],
            trusted=self.trusted[:, columns],
            filled=self.filled[:, columns],
            moved=self.moved[:, columns],
            markers=tuple(self.markers[c] for c in columns),
            origin=None,
        )

    def crop(self, start: int, stop: int, step: int = 1) -> "Take":
        """The take with only these frames, by index, every ``step``-th; it can no longer be written to its own file."""
        frames = slice(start, stop, step)
        return replace(
            self,
            positions=self.positions[frames],
            trusted=self.trusted[frames],
            filled=self.filled[frames],
            moved=self.moved[frames],
            rate=self.rate / step,
            first_frame=self.first_frame + start,
            findings=(),
            origin=None,
        )

    def numbers(self, start: int, stop: int) -> tuple[int, int]:
        """A half-open span of indices as the file's own first and last frame numbers."""
        return start + self.first_frame, stop - 1 + self.first_frame


@dataclass(frozen=True, kw_only=True)
class Solution:
    """A solver's answer.

    positions: (F, M, 3) millimetres, finite where ``filled``; elsewhere it may hold the method's own estimate, which
    nobody writes. filled: (F, M) bool, the untrusted samples it answers for. sd: (F, M) millimetres, its own expected
    error per coordinate, or None. trace: the objective or residual after each iteration. facts: what the method chose
    by itself, such as a rank. outliers: (F, M, 3) millimetres, the sparse noise that a robust method took out of the
    trusted samples, or None. moved: (F, M) bool, the trusted samples that it was asked to denoise, or None.
    """

    positions: Floats
    filled: Bools
    sd: Floats | None = None
    converged: bool = True
    iterations: int = 0
    reason: str = "closed form"
    trace: tuple[float, ...] = ()
    facts: Mapping[str, float | int | str] = field(default_factory=dict)
    outliers: Floats | None = None
    moved: Bools | None = None


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
class Check:
    """Hidden gaps and the samples in them; the error of those that were filled; covered: the share of their
    coordinates within the method's own 90 % intervals, or None if it gives none.
    """

    gaps: int = 0
    samples: int = 0
    error: Error | None = None
    covered: float | None = None


@dataclass(frozen=True, kw_only=True)
class SelfCheck:
    """What a method got wrong on hidden samples of the take itself, in all and by length of gap.

    because: why there is no answer, or "".
    """

    rounds: int = 0
    total: Check = Check()
    by_length: Mapping[str, Check] = field(default_factory=dict)
    because: str = ""


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A method that might have been chosen: how it did on the hidden samples, or why it was left out."""

    method: str
    total: Check
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
