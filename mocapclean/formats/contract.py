"""The contract of a capture format: the facts that it declares and the functions that its module has."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from mocapclean.take import Event, ReadOptions, Take


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """The facts about a format on which the rest of the program depends.

    suffixes: lower-case file name endings.
    columns: the columns of its takes, captured markers or the joints of a skeleton.
    stores: the numbers of a frame, positions of the columns or channels of the skeleton (poses).
    marks_missing: whether the format has a mark for a missing sample, which ``invalidate`` sets.
    lists_points: whether files may hold points that are no markers, which ``ReadOptions.points`` selects by name. The
    module then is a ``PointFormat``.
    states_events: whether files may state events, such as foot strikes. The module then is an ``EventFormat``.
    precision: how finely new files store a coordinate, in words.
    lowest_frame: the lowest number that a frame can have, None where there is none.
    skeleton_suffix: the ending of the separate file that holds the skeleton, None where no such file is needed.
    default_rate: Hz, assumed where no rate is given; None where the files state their rate.
    default_unit: millimetres per unit of length, assumed where no unit is given and no human body shows it; None where
    the files state it.
    """

    suffixes: tuple[str, ...]
    columns: Literal["markers", "joints"]
    stores: Literal["positions", "poses"]
    marks_missing: bool
    lists_points: bool = False
    states_events: bool = False
    precision: str = ""
    lowest_frame: int | None = None
    skeleton_suffix: str | None = None
    default_rate: float | None = None
    default_unit: float | None = None

    def applicable(self, options: ReadOptions) -> ReadOptions:
        """Return the options that matter to this format, with its default rate where none is given."""
        return ReadOptions(
            skeleton=options.skeleton if self.skeleton_suffix else None,
            rate=(options.rate or self.default_rate) if self.default_rate else None,
            unit=options.unit if self.default_unit else None,
        )


class Format(Protocol):
    """A module, or any object, that reads and writes one format.

    The document of a file is whatever ``write`` needs to reproduce it byte for byte; ``read`` keeps it in
    ``Take.origin``. It has a property ``others``: what the file has beside the take, in words. The document of a format
    that stores poses has a method ``spelled``: poses (F, C) to the poses that the file will hold, rounded as the file
    spells numbers.
    """

    def sniff(self, head: bytes) -> bool:
        """Whether the first bytes of a file can begin a file of this format."""

    def read(self, path: Path, options: ReadOptions) -> Take:
        """Return the take of a file, its document kept in ``Take.origin``.

        Raises FormatError with the place of the fault.
        """

    def write(self, take: Take, path: Path, *, invalidate: bool = False) -> Take:
        """Write the take's document to ``path``, its changed samples replaced; return the take as the file holds it.

        ``path`` is a temporary name, never the input. A format that stores poses writes ``take.poses``, already fitted
        to the changed samples; any other writes ``take.positions``. The returned take has the positions as stored,
        ``filled`` and ``moved`` without the samples that the format could not hold, and a finding for those. With
        ``invalidate`` samples neither trusted nor filled are marked missing, where the format has such a mark.
        """

    def prove(self, take: Take, path: Path) -> None:
        """Raise FormatError unless ``path`` holds ``take``, as ``write`` returned it, and differs nowhere else."""

    def create(self, take: Take, path: Path) -> None:
        """Write a new file that owes nothing to an earlier one, and read it back.

        Raises UsageError for a take that the format cannot express, FormatError when the file does not read back as
        the take.
        """


class PointFormat(Protocol):
    """What a module of a format has in addition whose files may hold points that are no markers.

    Its document has a property ``carried``, the names of those points.
    """

    def outdated(self, take: Take) -> tuple[str, ...]:
        """Return those of the carried points that may have been computed from a marker that is changed in the take."""


class EventFormat(Protocol):
    """What a module of a format has in addition whose files may state events."""

    def events(self, take: Take) -> tuple[Event, ...]:
        """Return the events that a take's file states."""

    def create(self, take: Take, path: Path, happened: Sequence[Event] = ()) -> None:
        """Write a new file with these events, as ``Format.create`` does."""
