"""The take, the findings of rules and formats, and the solution of a solver.

F is the number of frames (always the first axis) and M the number of markers or joints. Frame numbers inside the
program are indices from 0 and spans are half open; reports add ``Take.first_frame`` and close them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton, influence, settled
from mocapclean.take.content import same_content
from mocapclean.take.names import similar_names
from mocapclean.take.session import Session

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view of an array."""
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True, kw_only=True)
class Finding:
    """The result of a trust rule, or a remark of a file format, about a take.

    rule: its name. message: the sentence for the user. level: "info", "warning" or "error". marker, frames: the marker
    and the half-open span of indices (start, stop) that it concerns; None for all. advice: what the user can do.
    suspicion: whether the rule only reports its samples, which stay trusted; else they are distrusted. channels: of a
    joint, those that it concerns, by index in ``Skeleton.channels``; empty for all of them, and for markers.
    """

    rule: str
    message: str
    level: str = "info"
    marker: str | None = None
    frames: tuple[int, int] | None = None
    advice: str = ""
    suspicion: bool = False
    channels: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Event:
    """A named moment of a take, such as a foot strike, as the file states it.

    label: what happens. context: whose it is, such as "Left", or "". frame: index from 0, a fraction between frames.
    """

    label: str
    context: str
    frame: float


@dataclass(frozen=True)
class Exchanged:
    """Two markers whose samples were exchanged in a half-open span of frames (start, stop)."""

    first: str
    second: str
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Facts about a file that its format does not store, from the user.

    skeleton: the file of the skeleton, for formats that keep it apart; rate: Hz, for formats that state none; unit:
    millimetres per unit of length, for formats that state none or in place of what a file states; points: names of
    points to read as markers even though they are something else.
    """

    skeleton: Path | None = None
    rate: float | None = None
    unit: float | None = None
    points: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Origin:
    """The file that a take was read from.

    path, format: of the file. options: those it was read with. document: its parsed content, for writing. largest: mm,
    the largest coordinate that the file can store.
    """

    path: Path
    format: str
    options: ReadOptions
    document: Any = field(repr=False)
    largest: float = float("inf")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Take:
    """A capture as a marker matrix; ``take["LANK"]`` is the path of a marker, and ``len(take)`` the number of frames.

    positions: (F, M, 3) float64, millimetres, finite wherever trusted.
    trusted: (F, M) bool, False for all samples that are missing or doubtful; NaN has no meaning of its own. A sample of
    a joint, in a take with poses, is its own channels; its position follows from these and from those of its parents.
    filled: (F, M) bool, untrusted samples with a position from a solver.
    moved: (F, M) bool, trusted samples that were changed at the user's request: denoised, or exchanged labels.
    exchanged: the pairs of markers whose samples were exchanged at the user's request, in that order; a format that
    stores more than positions exchanges the rest too. Writing changes the samples of ``filled`` and ``moved`` alone.
    markers: M distinct names. detached: (M,) bool, the columns that move with no other one, such as angles or points
    without a label; each is judged and filled by its own path alone.
    rate: frames per second exactly as stored. first_frame: the file's number of frame 0.
    skeleton: the joints and bones, if known. poses: (F, C) degrees and millimetres, the channels of the skeleton whose
    joints are the columns, or None. known: (F, C) bool, the channels that can be trusted, or None without poses; a
    joint is trusted where all its channels are. Positions are those of the poses in which a straight line bridges the
    missing numbers. findings: of rules and formats. origin: the file, None for a take that cannot be written to one.
    session: other takes of the subject that methods may learn from, or None.
    The arrays are read-only. Takes are equal where all of this is equal but ``origin``; NaN is equal to NaN.
    """

    positions: Floats
    trusted: Bools
    markers: tuple[str, ...]
    rate: float
    filled: Bools = None  # type: ignore[assignment]
    moved: Bools = None  # type: ignore[assignment]
    detached: Bools = None  # type: ignore[assignment]
    exchanged: tuple[Exchanged, ...] = ()
    first_frame: int = 1
    skeleton: Skeleton | None = None
    poses: Floats | None = None
    known: Bools | None = None
    findings: tuple[Finding, ...] = ()
    origin: Origin | None = None
    session: Session | None = None

    def __post_init__(self) -> None:
        shape = self.trusted.shape
        for name in ("filled", "moved"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(shape, dtype=bool))
        if self.detached is None:
            object.__setattr__(self, "detached", np.zeros(shape[1], dtype=bool))
        shapes = self.positions.shape, self.filled.shape, self.moved.shape, self.detached.shape
        if shapes != ((*shape, 3), shape, shape, shape[1:]):
            raise ValueError(
                f"positions must be (F, M, 3), filled and moved (F, M), detached (M,) for {shape}. Got {shapes}."
            )
        if len(self.markers) != shape[1] or len(set(self.markers)) != shape[1]:
            raise ValueError(f"markers must be {shape[1]} distinct names. Got {len(self.markers)}.")
        self._check_values()
        for name in ("positions", "trusted", "filled", "moved", "detached"):
            object.__setattr__(self, name, _read_only(getattr(self, name)))
        if self.poses is not None:
            expected = (shape[0], len(self.skeleton.channels)) if self.skeleton else None
            if self.poses.shape != expected:
                raise ValueError(
                    f"poses must be frames by channels of the skeleton, {expected}. Got {self.poses.shape}."
                )
            object.__setattr__(self, "poses", _read_only(self.poses))
            known = self.known
            if known is None:
                known = np.isfinite(self.poses) & self.trusted[:, self.owners]
            object.__setattr__(self, "known", _read_only(known))

    def _check_values(self) -> None:
        """Raise ValueError unless the masks are bool and the rate is positive: numbers as masks invert otherwise."""
        for name in ("trusted", "filled", "moved", "detached"):
            if getattr(self, name).dtype != bool:
                raise ValueError(f"{name} must be bool. Got {getattr(self, name).dtype}.")
        if not 0 < self.rate < np.inf:
            raise ValueError(f"rate must be positive and finite. Got {self.rate}.")

    def __repr__(self) -> str:
        n_frames, n_markers = self.trusted.shape
        name = f" {self.origin.path.name}" if self.origin else ""
        columns = "markers" if self.poses is None else "joints"
        filled = f", {int(self.filled.sum()):,} filled" if self.filled.any() else ""
        missing = int((~self.trusted & ~self.filled).sum())
        size = f"{n_frames:,} frames, {n_markers} {columns}, {self.rate:g} Hz"
        return f"<Take{name}: {size}, {missing:,} samples missing{filled}>"

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.trusted)

    def __bool__(self) -> bool:
        """Return true: a take without frames is a take."""
        return True

    def __eq__(self, other: object) -> bool:
        return same_content(self, other, skip=("origin",)) if isinstance(other, Take) else NotImplemented

    __hash__ = None  # type: ignore[assignment]
    __iter__ = None

    def __contains__(self, marker: object) -> bool:
        """Whether the take has a marker of this name."""
        return marker in self.markers

    def __getitem__(self, markers: str | list[str]) -> Floats:
        """Return the path (F, 3) of a marker, or those (F, n, 3) of a list of markers, mm, as ``to_numpy`` does.

        Raises UsageError for a marker that the take does not have.
        """
        named = [markers] if isinstance(markers, str) else markers
        if not (isinstance(named, list) and all(isinstance(name, str) for name in named)):
            raise UsageError(f"a take is indexed by the name of a marker or a list of names. Got {markers!r}.")
        for name in named:
            if name not in self.markers:
                near = ", ".join(similar_names(name, self.markers) or self.markers[:5])
                raise UsageError(f"the marker must be one of the take. Got {name!r}; near: {near}.")
        columns = [self.markers.index(name) for name in named]
        paths: Floats = np.where(self.placed[:, columns, None], self.positions[:, columns], np.nan)
        return paths[:, 0] if isinstance(markers, str) else paths

    @property
    def placed(self) -> Bools:
        """The samples (F, M) whose position is known or filled.

        A joint has such a position where each channel that decides it is known or filled.
        """
        if self.known is None or self.skeleton is None:
            return np.asarray(self.trusted | self.filled)
        places, _ = influence(self.skeleton)
        return np.asarray(~(~(self.known | self.filled[:, self.owners]) @ places.T))

    def to_numpy(self) -> Floats:
        """Return the positions (F, M, 3), mm, as a new array, with NaN where a sample is neither trusted nor filled."""
        return np.where(self.placed[..., None], self.positions, np.nan)

    def to_xarray(self) -> "xr.Dataset":
        """Return the take as an xarray Dataset: position, confidence, status, sd; see ``take.tables.to_xarray``."""
        dataset: xr.Dataset = _tables().to_xarray(self)
        return dataset

    @staticmethod
    def from_xarray(dataset: "xr.Dataset") -> "Take":
        """Return the take of an xarray Dataset with the layout of ``to_xarray``; see ``take.tables.from_xarray``."""
        take: Take = _tables().from_xarray(dataset)
        return take

    def to_dataframe(self) -> "pd.DataFrame":
        """Return the positions as a pandas table, columns (marker, axis); see ``take.tables.to_dataframe``."""
        table: pd.DataFrame = _tables().to_dataframe(self)
        return table

    @property
    def owners(self) -> Ints:
        """The joint (C,) of each channel of the poses."""
        channels = self.skeleton.channels if self.skeleton else ()
        return np.array([channel.joint for channel in channels], dtype=np.intp)

    def with_known(self, known: Bools, **changes: Any) -> "Take":
        """Return the take with other channels (F, C) that can be trusted, and the trust of its joints that follows."""
        trusted = np.ones_like(self.trusted)
        for channel, joint in enumerate(self.owners):
            trusted[:, joint] &= known[:, channel]
        return replace(self, known=known, trusted=trusted, **changes)

    def as_markers(self) -> "Take":
        """Return the take of its positions alone, for what works on markers; the poses go, the skeleton's bones stay.

        A joint is a trusted marker where no unknown channel decides its position.
        """
        trusted, skeleton = self.trusted, self.skeleton
        if skeleton is not None and self.known is not None and self.poses is not None:
            places, _ = influence(skeleton)
            trusted = np.asarray(~(~self.known @ places.T))
            skeleton = settled(skeleton, np.where(self.known, self.poses, np.nan))
        return replace(self, trusted=trusted, skeleton=skeleton, poses=None, known=None, origin=None)

    @property
    def changed(self) -> Bools:
        """The samples (F, M) that differ from the file: filled or moved."""
        return self.filled | self.moved

    def distrusted_by(self, rule: str) -> Bools:
        """Return the samples (F, M) that a rule distrusts, by the markers and frames of its findings."""
        return self._named(lambda finding: finding.rule == rule and not finding.suspicion)

    @property
    def distrusted(self) -> Bools:
        """The samples (F, M) that a finding distrusts, those missing in the file included."""
        return self._named(lambda finding: not finding.suspicion)

    @property
    def suspicious(self) -> Bools:
        """The trusted samples (F, M) that a rule reports without distrusting them."""
        return self.trusted & self._named(lambda finding: finding.suspicion)

    def _named(self, counts: Callable[[Finding], bool]) -> Bools:
        """Return the samples (F, M) that those findings name that count."""
        mask = np.zeros_like(self.trusted)
        columns = {name: column for column, name in enumerate(self.markers)}
        for finding in self.findings:
            if finding.marker in columns and finding.frames and counts(finding):
                mask[slice(*finding.frames), columns[finding.marker]] = True
        return mask

    def select(self, columns: NDArray[np.intp]) -> "Take":
        """Return the take with these markers alone, by column, without its file; poses stay with all joints alone."""
        whole = np.array_equal(columns, np.arange(len(self.markers)))
        return replace(
            self,
            positions=self.positions[:, columns],
            trusted=self.trusted[:, columns],
            filled=self.filled[:, columns],
            moved=self.moved[:, columns],
            detached=self.detached[columns],
            markers=tuple(self.markers[c] for c in columns),
            exchanged=(),
            poses=self.poses if whole else None,
            known=self.known if whole else None,
            origin=None,
            session=self.session and self.session.select(columns),
        )

    def crop(self, start: int, stop: int, step: int = 1) -> "Take":
        """Return the take with every ``step``-th of these frames, by index, without its findings and its file.

        A session has the frame rate of its take, and goes where the step is not 1.
        """
        frames = slice(start, stop, step)
        return replace(
            self,
            positions=self.positions[frames],
            trusted=self.trusted[frames],
            filled=self.filled[frames],
            moved=self.moved[frames],
            rate=self.rate / step,
            first_frame=self.first_frame + start,
            exchanged=(),
            poses=None if self.poses is None else self.poses[frames],
            known=None if self.known is None else self.known[frames],
            findings=(),
            origin=None,
            session=self.session if step == 1 else None,
        )

    def numbers(self, start: int, stop: int) -> tuple[int, int]:
        """Return the first and last frame numbers of the file, inclusive, for a half-open span of indices."""
        return start + self.first_frame, stop - 1 + self.first_frame

    def plot(self) -> Any:
        """Return the map of the samples as a matplotlib figure (extra ``plots``)."""
        return _notebook().plot(self)

    def plot_gap(self, marker: str, frame: int) -> Any:
        """Return the curves of a marker around its gap at a frame of the file, as a matplotlib figure.

        A gap that is not filled is filled by the default method for the figure alone.
        """
        return _notebook().plot_gap(self, marker, frame)

    def _repr_html_(self) -> str:
        """Return a small map of the samples, which notebooks show."""
        html: str = _notebook().html(self)
        return html


def _tables() -> Any:
    """Return the module for tables of other packages; it works on takes, so that it is imported when asked for."""
    return import_module("mocapclean.take.tables")


def _notebook() -> Any:
    """Return the module that draws takes; it is above this package, so that it is imported when it is asked for."""
    return import_module("mocapclean.report.notebook")


def require_take(take: object, function: str) -> None:
    """Raise UsageError unless an argument of a function is a Take."""
    if not isinstance(take, Take):
        got = type(take).__name__
        raise UsageError(f"{function} takes a Take, such as the attribute take of what fill returns. Got {got}.")


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The result of a solver.

    positions: (F, M, 3) millimetres, finite where ``filled``; other samples may have the method's own estimate, which
    is not written. filled: (F, M) bool, the untrusted samples that the method estimated. sd: (F, M) millimetres, the
    standard deviation of a coordinate's error as the method expects it, or None. converged, iterations, reason: how
    the method ended. trace: the objective or residual after each iteration. facts: quantities that the method
    determined itself, such as a rank. outliers: (F, M, 3) millimetres, the sparse noise that a robust method removed
    from trusted samples, or None. moved: (F, M) bool, the trusted samples that the method denoised on request, or
    None. For a take with poses also: poses: (F, C) with the answer in the channels that were not known. sd_degrees:
    (F, M), the standard deviation of an error about an axis, or None. misfit: (F, M) mm, how far the poses are from
    the positions that a method for markers answered, or None. unreachable: (F, M) bool, joints that no pose brings
    near enough to these positions, or None.
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
    poses: Floats | None = None
    sd_degrees: Floats | None = None
    misfit: Floats | None = None
    unreachable: Bools | None = None
