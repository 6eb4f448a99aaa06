"""The parts of an experiment: captures, entries (a method with parameters), loss patterns, and trials."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol, TypeVar

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats
from mocapclean.config.loading import resolve
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import FormatError, UsageError
from mocapclean.simulate import block_loss, hide, random_loss
from mocapclean.solvers.names import needs_dictionary, require_method
from mocapclean.solvers.running import run_method
from mocapclean.take import ReadOptions, Solution, Take

CMU_UNIT = 25.4 / 0.45
"""Millimetres per unit of length of the CMU's AMC and ASF files: an inch is 25.4 mm, and the files' scale is 0.45."""

Measures = Mapping[str, float | int]
"""The measures of a trial, by column name."""

Series = Mapping[str, Floats]
"""Curves of a trial, such as an error for each frame, by column name; all have the same length."""

TrialResult = tuple[Measures, Series]


@dataclass(frozen=True, kw_only=True)
class Capture:
    """A file of a take, read on first use. n_frames: only this many of its first frames; None for all."""

    path: Path
    options: ReadOptions = ReadOptions()  # noqa: RUF009
    n_frames: int | None = None

    @property
    def name(self) -> str:
        """Return the name of the file without its suffix."""
        return self.path.stem

    @cached_property
    def digest(self) -> str:
        """Return the first twelve digits of the file's SHA-256, with ``n_frames`` if it is set."""
        try:
            digits = hashlib.sha256(self.path.read_bytes()).hexdigest()[:12]
            return f"{digits}:{self.n_frames}" if self.n_frames else digits
        except OSError as error:
            raise FormatError(self.path, f"cannot be read: {error.strerror or error}.") from None

    def shortened(self, n_frames: int) -> "Capture":
        """Return the capture with only its first ``n_frames``, or with fewer where it is already that short."""
        return replace(self, n_frames=min(n_frames, self.n_frames or n_frames))

    @cached_property
    def take(self) -> Take:
        """Return the take in the file, or its first frames, as markers: the papers judge positions."""
        take = self._read().as_markers()
        return take.crop(0, self.n_frames) if self.n_frames else take

    @cached_property
    def posed(self) -> Take:
        """Return the take in the file, or its first frames, with its poses if it has any."""
        take = self._read()
        return take.crop(0, self.n_frames) if self.n_frames else take

    def _read(self) -> Take:
        """Return the take in the file."""
        options = self.options
        return formats.read(self.path, skeleton=options.skeleton, rate=options.rate, unit=options.unit)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A method with its parameters in an experiment.

    variant: a name that tells several entries of one method apart. changes: parameters that differ from the defaults.
    learned: the dictionary of a method that needs one.
    """

    method: str
    variant: str = ""
    changes: Mapping[str, Any] = field(default_factory=dict)
    learned: Dictionary | None = field(default=None, repr=False)

    @property
    def parameters(self) -> str:
        """Return the changed parameters as JSON with sorted keys."""
        return json.dumps(dict(self.changes), sort_keys=True)


@dataclass(frozen=True, kw_only=True)
class Request:
    """The user's request: which captures and methods to run, and how.

    methods: empty for the experiment's own methods. changes: parameters by method. n_seeds: repetitions with other
    random losses. quick: fewer and shorter trials. folder: further captures, for training. dictionary: for the methods
    that need one. masks: captures whose natural gaps are put into the others.
    """

    captures: tuple[Capture, ...] = ()
    methods: tuple[str, ...] = ()
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    n_seeds: int = 1
    quick: bool = False
    folder: tuple[Capture, ...] = ()
    dictionary: Dictionary | None = None
    masks: tuple[Capture, ...] = ()

    def shortened(self, n_frames: int) -> "Request":
        """Return the same request; if it is ``quick``, with only the first ``n_frames`` of each capture."""
        short = tuple(capture.shortened(n_frames) for capture in self.captures)
        return replace(self, captures=short) if self.quick else self

    def cropped(self, n_frames: int, reason_to_skip: Callable[[Capture], str]) -> tuple[list[Capture], list[str]]:
        """Return the captures with only their first frames, and the names of those left out with the reason."""
        captures, left_out = [], []
        for capture in (each.shortened(n_frames) for each in self.captures):
            reason = reason_to_skip(capture)
            if reason:
                left_out.append(f"{capture.path.name} ({reason})")
            else:
                captures.append(capture)
        return captures, left_out

    def entries(self, own: Sequence[Entry], *, trained: bool = False) -> list[Entry]:
        """Return the requested entries among an experiment's own, and an entry for every other requested method.

        The user's value of a parameter replaces that of an entry. trained: the experiment trains dictionaries itself.
        Raises UsageError for an unknown method or one without its dictionary, ConfigError for an unknown parameter.
        """
        for name in (*self.methods, *self.changes):
            require_method(name)
        if self.dictionary is None and not trained:
            for name in filter(needs_dictionary, self.methods):
                raise UsageError(f"{name} needs a trained dictionary. Give --dictionary, or use 'bench wang2016'.")
        others = [Entry(method=name) for name in self.methods if name not in {entry.method for entry in own}]
        wanted = [entry for entry in (*own, *others) if not self.methods or entry.method in self.methods]
        changed = [replace(e, changes={**e.changes, **self.changes.get(e.method, {})}) for e in wanted]
        unused = {*self.changes} - {entry.method for entry in wanted}
        if unused:
            raise UsageError(f"--set must name a method of this run. Got {', '.join(sorted(unused))}.")
        for entry in changed:
            parameters(entry)
        return [self._with_dictionary(entry) for entry in changed]

    def _with_dictionary(self, entry: Entry) -> Entry:
        """Return the entry with the user's dictionary, if its method needs one."""
        if self.dictionary is None or not needs_dictionary(entry.method):
            return entry
        return replace(entry, variant=f"with {self.dictionary.sha256[:8]}", learned=self.dictionary)


def parameters(entry: Entry) -> Any:
    """Return the Params of an entry's method; raise ConfigError for invalid changes."""
    return getattr(resolve(None, {"methods": {entry.method: dict(entry.changes)}}).methods, entry.method)


class LossPattern(Protocol):
    """A pattern of lost samples, drawn at random for each seed."""

    @property
    def cell(self) -> dict[str, str]:
        """Return the cell of the results' tables for this pattern, as names and values."""

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) of a take that are hidden from the method."""


@dataclass(frozen=True, kw_only=True)
class Loss:
    """The papers' losses: a ``ratio`` of the markers per frame, or ``out`` markers per block of ``length`` frames."""

    ratio: float = 0.0
    length: int = 0
    out: int = 0

    @property
    def cell(self) -> dict[str, str]:
        """Return the kind and the size of the loss."""
        if self.length:
            return {"loss": "blocks", "length": str(self.length), "out": str(self.out)}
        return {"loss": "random", "ratio": f"{self.ratio:g}"}

    def hidden(self, take: Take, seed: int) -> Bools:
        """Return the trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, round(1000 * self.ratio), self.length, self.out])
        n_frames, n_markers = take.trusted.shape
        if self.length:
            return block_loss(n_frames, n_markers, self.length, self.out, rng) & take.trusted
        return random_loss(n_frames, n_markers, self.ratio, rng) & take.trusted


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One method on one take with one loss pattern and one seed: one row of the results.

    source: the capture's digest. cell: the place of the trial in the results' tables. run: returns the result.
    """

    take: str
    source: str
    entry: Entry
    cell: Mapping[str, str]
    seed: int
    run: Callable[[], TrialResult] = field(repr=False)

    @property
    def key(self) -> tuple[str, ...]:
        """Return the values that identify the trial among all trials of an experiment."""
        cell = " ".join(f"{name}={value}" for name, value in self.cell.items())
        entry = self.entry
        return self.take, self.source, entry.method, entry.variant, entry.parameters, cell, str(self.seed)


Pattern = TypeVar("Pattern", bound=LossPattern)


def grid(
    request: Request,
    entries: Sequence[Entry],
    losses: Sequence[Pattern],
    run: Callable[[Capture, Entry, Pattern, int], TrialResult],
) -> list[Trial]:
    """Return all trials of captures, seeds, losses and entries, in this order of loops."""
    return [
        Trial(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell=loss.cell,
            seed=seed,
            run=partial(run, capture, entry, loss, seed),
        )
        for capture in request.captures
        for seed in range(request.n_seeds)
        for loss in losses
        for entry in entries
    ]


def solve(take: Take, hidden: Bools, entry: Entry) -> tuple[Solution, float]:
    """Return a method's solution for a take without its ``hidden`` samples (F, M), and the seconds it needed."""
    params = parameters(entry)
    with_gaps = hide(take, hidden)
    begin = perf_counter()
    solution = run_method(entry.method, with_gaps, params, dictionary=entry.learned)
    return solution, perf_counter() - begin


def rms(differences: Floats) -> float:
    """Return the root mean square of all entries; 0 if there are none."""
    return float(np.sqrt(np.mean(differences**2))) if differences.size else 0.0
