"""The words of a benchmark: captures, entries, losses and jobs."""

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
from mocapclean.solvers import SOLVERS
from mocapclean.take import ReadOptions, Solution, Take

CMU_UNIT = 25.4 / 0.45
"""Millimetres per unit of length of the CMU's AMC and ASF files."""

LEARNERS = ("srmmp", "llc")
"""The methods that need a trained dictionary."""

Measures = Mapping[str, float | int]
Series = Mapping[str, Floats]
Found = tuple[Measures, Series]


@dataclass(frozen=True, kw_only=True)
class Capture:
    """A take that is read when it is first needed; n_frames: no more than this many of its first frames."""

    path: Path
    options: ReadOptions = ReadOptions()  # noqa: RUF009
    n_frames: int | None = None

    @property
    def name(self) -> str:
        """The name of the file without its suffix."""
        return self.path.stem

    @cached_property
    def digest(self) -> str:
        """The first twelve digits of the file's SHA-256, and how many frames at most."""
        try:
            digits = hashlib.sha256(self.path.read_bytes()).hexdigest()[:12]
            return f"{digits}:{self.n_frames}" if self.n_frames else digits
        except OSError as fault:
            raise FormatError(self.path, f"cannot be read: {fault.strerror or fault}.") from None

    @cached_property
    def take(self) -> Take:
        """The take as it is in the file, or its first frames."""
        options = self.options
        take = formats.read(self.path, skeleton=options.skeleton, rate=options.rate, unit=options.unit)
        return take.crop(0, self.n_frames) if self.n_frames else take


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A method as it enters an experiment.

    variant: a name for it among those of one method. changes: the parameters that are not the defaults. learned: the
    dictionary of a method that learns.
    """

    method: str
    variant: str = ""
    changes: Mapping[str, Any] = field(default_factory=dict)
    learned: Dictionary | None = field(default=None, repr=False)

    @property
    def parameters(self) -> str:
        """The changed parameters as JSON, the same text for the same parameters."""
        return json.dumps(dict(self.changes), sort_keys=True)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What the user asked for.

    methods: none for the experiment's own. changes: parameters by method. folder: other captures, to learn from.
    """

    captures: tuple[Capture, ...] = ()
    methods: tuple[str, ...] = ()
    changes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    n_seeds: int = 1
    quick: bool = False
    folder: tuple[Capture, ...] = ()
    dictionary: Dictionary | None = None

    def shortened(self, n_frames: int) -> "Choice":
        """With ``quick``, the same with only so many first frames of each capture."""
        short = tuple(replace(capture, n_frames=n_frames) for capture in self.captures)
        return replace(self, captures=short) if self.quick else self

    def entries(self, own: Sequence[Entry], *, trained: bool = False) -> list[Entry]:
        """The chosen ones of an experiment's own entries, and any other method that was named, with its changes.

        Where a variant and the user set one parameter, the user's value holds. Raises UsageError for a method
        that is not there or needs a dictionary (unless the experiment has ``trained`` one), ConfigError for parameters
        that it does not have.
        """
        for name in {*self.methods, *self.changes} - {*SOLVERS}:
            raise UsageError(f"a method must be one of {', '.join(SOLVERS)}. Got {name!r}.")
        if self.dictionary is None and not trained:
            for name in {*self.methods} & {*LEARNERS}:
                raise UsageError(f"{name} needs a trained dictionary. Give --dictionary, or use 'bench wang2016'.")
        others = [Entry(method=name) for name in self.methods if name not in {entry.method for entry in own}]
        wanted = [entry for entry in (*own, *others) if not self.methods or entry.method in self.methods]
        changed = [replace(e, changes={**e.changes, **self.changes.get(e.method, {})}) for e in wanted]
        unused = {*self.changes} - {entry.method for entry in wanted}
        if unused:
            raise UsageError(f"--set must name a method of this run. Got {', '.join(sorted(unused))}.")
        for entry in changed:
            parameters(entry)
        return [self._equipped(entry) for entry in changed]

    def _equipped(self, entry: Entry) -> Entry:
        if self.dictionary is None or entry.method not in LEARNERS:
            return entry
        return replace(entry, variant=f"with {self.dictionary.sha256[:8]}", learned=self.dictionary)


def parameters(entry: Entry) -> Any:
    """The method's Params; raises ConfigError with every fault."""
    return getattr(resolve(None, {"methods": {entry.method: dict(entry.changes)}}).methods, entry.method)


class Hiding(Protocol):
    """A way to lose samples: its place in a table, and the trusted samples (F, M) that it hides."""

    @property
    def cell(self) -> dict[str, str]: ...  # noqa: D102
    def missing(self, take: Take, seed: int) -> Bools: ...  # noqa: D102


@dataclass(frozen=True, kw_only=True)
class Loss:
    """The papers' losses: a ``ratio`` of the markers in each frame, or ``out`` of them in each block of ``length``."""

    ratio: float = 0.0
    length: int = 0
    out: int = 0

    @property
    def cell(self) -> dict[str, str]:
        """Its kind and its size."""
        if self.length:
            return {"loss": "blocks", "length": str(self.length), "out": str(self.out)}
        return {"loss": "random", "ratio": f"{self.ratio:g}"}

    def missing(self, take: Take, seed: int) -> Bools:
        """The trusted samples (F, M) that are hidden; the same for every method."""
        rng = np.random.default_rng([seed, round(1000 * self.ratio), self.length, self.out])
        n_frames, n_markers = take.trusted.shape
        if self.length:
            return block_loss(n_frames, n_markers, self.length, self.out, rng) & take.trusted
        return random_loss(n_frames, n_markers, self.ratio, rng) & take.trusted


@dataclass(frozen=True, kw_only=True)
class Job:
    """One row to be: its key, and how it is found. source: the first digits of the capture's SHA-256."""

    take: str
    source: str
    entry: Entry
    cell: Mapping[str, str]
    seed: int
    run: Callable[[], Found] = field(repr=False)

    @property
    def key(self) -> tuple[str, ...]:
        """What tells it from all other jobs of the experiment."""
        cell = " ".join(f"{name}={value}" for name, value in self.cell.items())
        entry = self.entry
        return self.take, self.source, entry.method, entry.variant, entry.parameters, cell, str(self.seed)


H = TypeVar("H", bound=Hiding)


def grid(
    choice: Choice,
    entries: Sequence[Entry],
    losses: Sequence[H],
    run: Callable[[Capture, Entry, H, int], Found],
) -> list[Job]:
    """All jobs of captures, seeds, losses and entries, in this order."""
    return [
        Job(
            take=capture.name,
            source=capture.digest,
            entry=entry,
            cell=loss.cell,
            seed=seed,
            run=partial(run, capture, entry, loss, seed),
        )
        for capture in choice.captures
        for seed in range(choice.n_seeds)
        for loss in losses
        for entry in entries
    ]


def solve(take: Take, missing: Bools, entry: Entry) -> tuple[Solution, float]:
    """What a method makes of a take without its ``missing`` samples (F, M), and in how many seconds."""
    params = parameters(entry)
    broken = hide(take, missing)
    begin = perf_counter()
    solution = SOLVERS[entry.method].solve(broken, params, entry.learned)
    return solution, perf_counter() - begin


def rms(differences: Floats) -> float:
    """The root of the mean square of all entries; 0 without any."""
    return float(np.sqrt(np.mean(differences**2))) if differences.size else 0.0
