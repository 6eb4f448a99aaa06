"""A take, what rules and formats find in it, and what a solver answers.

F is the number of frames (always the first axis) and M the number of markers or joints. Frame numbers inside the
program are indices from 0 and spans are half open; reports add ``Take.first_frame`` and close them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.skeleton import Skeleton


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

    skeleton: the file of the skeleton, for formats that keep it apart; rate: Hz, for formats that state none; unit:
    millimetres per unit of length, for formats that state none; points: names of points to read as markers even though
    the file lists them as something else.
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
    frame 0. skeleton: the joints and bones, if known. poses: (F, C) degrees and millimetres, the channels of the
    skeleton whose joints are the columns, or None; changed samples are in them once they are fitted. The arrays are
    read-only.
    """

    positions: Floats
    trusted: Bools
    markers: tuple[str, ...]
    rate: float
    filled: Bools = None  # type: ignore[assignment]
    moved: Bools = None  # type: ignore[assignment]
    first_frame: int = 1
    skeleton: Skeleton | None = None
    poses: Floats | None = None
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
        if self.poses is not None:
            expected = (shape[0], len(self.skeleton.channels)) if self.skeleton else None
            if self.poses.shape != expected:
                raise ValueError(
                    f"poses must be frames by channels of the skeleton, {expected}. Got {self.poses.shape}."
                )
            object.__setattr__(self, "poses", _freeze(self.poses))

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
            poses=None,
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
            poses=None if self.poses is None else self.poses[frames],
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
