"""The take of a table of text, from the facts that a maker's module has found in its header."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from operator import itemgetter
from pathlib import Path

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.errors import FormatError
from mocapclean.formats.c3d.point_kinds import (
    MOVES_ALONE,
    PLACES,
    QUANTITY_KINDS,
    Kind,
    computed_by_position,
    kind_by_label,
)
from mocapclean.formats.c3d.points import MILLIMETRES, carried_points, named_markers, unlabelled_take
from mocapclean.formats.tables.document import AXES, TableDocument
from mocapclean.formats.tables.lines import Lines, delimiter_of, is_blank, names_of, raw_cells
from mocapclean.formats.tables.numbers import is_missing_cell, numbers, style_of
from mocapclean.formats.text import LARGEST_NUMBER
from mocapclean.take import Event, Finding, Origin, ReadOptions, Take
from mocapclean.take.names import bare_name

STYLE_ROWS = 200
"""Rows, evenly spaced, from which the style of the numbers is taken. Chosen for speed."""
BLOCK_ROWS = 1000
"""Rows whose cells are in memory at the same time. Chosen by hand."""
RATE_TOLERANCE = 0.01
"""Relative difference from which the stated rate and that of the times are said not to agree. Chosen by hand."""
TIME_ROUNDING = 2e-3
"""Seconds by which the span of the times may be off in any case, because some files have times with three decimals."""
UNEVEN = 1.5
"""Times of the median step from which a step of the times is said to be uneven: a frame is nearer missing than late."""
MOST_RATE_DIGITS = 12
"""Significant digits of a rate from times, beyond which float64 seconds show none."""
RATES = (1e-3, 1e6)
"""Hz: a rate of a file outside is a mistake; no system takes as few or as many frames. Chosen by hand."""
SLOWEST = 5.0
"""Hz: a slower rate from times is taken to be a mistake of their unit. No system that tracks bodies is as slow."""


@dataclass(frozen=True, kw_only=True)
class Header:
    """What the header of a table says.

    names: of P points, as the file spells them. places: (P, 3) the cell of each coordinate. first_row: index of the
    line of the first frame. factor: millimetres per number. rate: Hz, None if not stated. frames, times: the cells of a
    frame's number and time, None where there is none. time_unit: times per second. n_frames: as stated. kinds: of
    points that are known by more than their names, by index. zeros: whether a missing sample is usually 0, 0, 0.
    sub_frames: the cell of the number of a part of a frame.
    has_sections: whether other text may follow behind a blank line. sections: titles of the other sections that no take
    holds.
    """

    names: Sequence[bytes]
    places: Ints
    first_row: int
    factor: float
    rate: float | None = None
    frames: int | None = None
    times: int | None = None
    sub_frames: int | None = None
    time_unit: float = 1.0
    n_frames: int | None = None
    kinds: dict[int, Kind] | None = None
    zeros: bool = False
    has_sections: bool = False
    sections: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()
    findings: tuple[Finding, ...] = ()


def read_table(path: Path, format_name: str, options: ReadOptions, text: Lines, header: Header) -> Take:
    """Return the take of a table.

    Raises FormatError with the line where a row has too few cells or a cell is no number; UsageError for a name in
    ``options.points`` that no point has.
    """
    table = _Table(path, text, header)
    samples = table.samples
    names, findings = _distinct([name or f"point{i}" for i, name in enumerate(names_of(header.names), start=1)])
    kinds = _kinds(names, header)
    columns = np.array(named_markers(path, names, kinds, options))
    findings += _counts(header, table)
    known = np.asarray(np.isfinite(samples).all(axis=2) & (samples != 0).any(axis=2))
    chosen = _selected(names, kinds, columns, samples * header.factor, known, options)
    if Kind.CAPTURED not in kinds and any(kinds[i] is Kind.UNLABELLED for i in chosen):
        findings.append(unlabelled_take(len(chosen)))
    findings += carried_points(names, kinds, chosen)
    n_zeros = int((samples[:, chosen] == 0).all(axis=2).sum())
    if n_zeros and not header.zeros:
        message = f"samples of exactly 0, 0, 0 are read as missing: {n_zeros}"
        findings.append(Finding(rule="zeros", message=message))
    rate, rate_findings = _rate(path, table, header, options)
    positions = samples[:, chosen] * header.factor
    others = sorted({*range(len(names))} - {*chosen})
    return Take(
        positions=positions,
        trusted=known[:, chosen],
        markers=tuple(names[i] for i in chosen),
        detached=np.array([kinds[i] in MOVES_ALONE for i in chosen]),
        rate=rate,
        first_frame=table.first_frame,
        findings=(*header.findings, *findings, *table.findings, *rate_findings),
        origin=Origin(
            path=path,
            format=format_name,
            options=options,
            largest=LARGEST_NUMBER * header.factor,
            document=TableDocument(
                text=text,
                first_row=header.first_row,
                n_frames=len(samples),
                delimiter=table.delimiter,
                places=header.places[chosen],
                factor=header.factor,
                style=style_of(table.style_cells(), table.comma),
                missing=table.missing_word(known[:, chosen], header.places[chosen]),
                present=known[:, chosen],
                computed=tuple(names[i] for i in others if kinds[i] in PLACES | QUANTITY_KINDS),
                others=table.others(),
                carried=tuple(names[i] for i in others),
                events=header.events,
            ),
        ),
    )


def stated_unit(unit: str, options: ReadOptions, where: str) -> tuple[float, tuple[Finding, ...]]:
    """Return the millimetres of a unit of length that a file states at a place, and a finding where that is in doubt.

    The option comes first, then the file, then millimetres.
    """
    known = next((factor for pattern, factor in MILLIMETRES if re.fullmatch(pattern, unit.strip().lower())), None)
    if options.unit is not None:
        if known in (None, options.unit):
            return options.unit, ()
        message = f"{where} is {unit!r}, but a unit of {options.unit:g} mm was given (--unit), which was used"
        return options.unit, (Finding(rule="units", level="warning", message=message),)
    if known is not None:
        return known, ()
    message = f"{where} must be a unit of length. Got {unit!r}; positions are taken as millimetres"
    advice = "compare a known distance, or give the unit (--unit)"
    return 1.0, (Finding(rule="units", level="warning", message=message, advice=advice),)


class _Table:
    """The rows of a table as numbers.

    lines: the rows. samples: (F, P, 3) numbers of the file. first_frame: the number of the first row. times: (F,)
    seconds, or None.
    """

    def __init__(self, path: Path, text: Lines, header: Header) -> None:
        self.path, self.header = path, header
        self.lines = self._rows(text.lines)
        if not self.lines:
            raise FormatError(path, "a take must have frames. Got none below the header.")
        self.delimiter = delimiter_of(self.lines[0])
        columns = [place for place in (header.frames, header.times) if place is not None]
        self.places = [*columns, *header.places.ravel().tolist()]
        self.width = max(self.places) + 1
        # Programs may drop the delimiters of samples that are missing at the end of a row.
        self.whole = frozenset(header.places.min(axis=1).tolist()) if self.delimiter else frozenset[int]()
        # Commas between other delimiters are decimal marks.
        self.comma = False
        self.comma = self.delimiter != b"," and any(b"," in cell for cell in self.style_cells())
        table = np.concatenate([self._block(start) for start in range(0, len(self.lines), BLOCK_ROWS)])
        self.samples = table[:, len(columns) :].reshape(len(table), -1, AXES)
        self.first_frame, self.findings = self._frames(table[:, 0] if header.frames is not None else None)
        self.times = table[:, len(columns) - 1] / header.time_unit if header.times is not None else None

    def _rows(self, lines: Sequence[bytes]) -> list[bytes]:
        """Return the lines of frames: up to the first without any character, without blank ones at the end.

        Raises FormatError for text behind it, unless the file may have other sections.
        """
        first = stop = self.header.first_row
        while stop < len(lines) and lines[stop].strip(b" \r\n"):
            stop += 1
        behind = next((i for i in range(stop, len(lines)) if not is_blank(lines[i])), None)
        if behind is not None and not self.header.has_sections:
            raise FormatError(self.path, "a line between frames must not be blank.", line=stop + 1)
        while stop > first and is_blank(lines[stop - 1]):
            stop -= 1
        return list(lines[first:stop])

    def _block(self, start: int) -> Floats:
        """Return the numbers of some rows."""
        indices = range(start, min(start + BLOCK_ROWS, len(self.lines)))
        first_line = self.header.first_row + 1
        return numbers(self.path, [self._row(i) for i in indices], [first_line + i for i in indices])

    def _row(self, index: int) -> list[bytes]:
        """Return the cells of a row that hold numbers, with decimal points.

        Samples may be left out at the end of a row, but not of the last, which may be cut off. Raises FormatError if
        there are fewer cells otherwise.
        """
        row = raw_cells(self.lines[index], self.delimiter)
        if len(row) in self.whole and index + 1 < len(self.lines):
            row += [b""] * (self.width - len(row))
        if len(row) < self.width:
            raise FormatError(
                self.path,
                f"a frame must have at least {self.width} cells. Got {len(row)}; the file may be cut off.",
                line=self.header.first_row + 1 + index,
            )
        chosen = itemgetter(*self.places)(row)
        return [cell.replace(b",", b".") for cell in chosen] if self.comma else list(chosen)

    def style_cells(self) -> list[bytes]:
        """Return the cells of coordinates in some rows, evenly spaced."""
        rows = map(self._row, range(0, len(self.lines), max(1, len(self.lines) // STYLE_ROWS)))
        return [cell for row in rows for cell in row[len(self.places) - self.header.places.size :]]

    def missing_word(self, known: Bools, places: Ints) -> bytes:
        """Return how the file spells a missing number: as in its first missing sample, else as its maker does."""
        style = style_of(self.style_cells(), self.comma)
        zero = style.spell(0.0)
        for frame, marker in np.argwhere(~known)[:1]:
            row = raw_cells(self.lines[frame], self.delimiter)
            own = [row[place] if place < len(row) else b"" for place in places[marker]]
            return next((cell for cell in own if is_missing_cell(cell)), zero).strip(b' "')
        if self.header.zeros:
            return zero
        return b"NaN" if self.delimiter is None else b""

    def others(self) -> tuple[str, ...]:
        """Return what the file has beside the frames' numbers, times and positions: columns, and other sections."""
        row = raw_cells(self.lines[0], self.delimiter)
        known = {*self.places, self.header.sub_frames}
        n_columns = sum(bool(cell.strip()) for place, cell in enumerate(row) if place not in known)
        columns = (f"other columns: {n_columns}",) if n_columns else ()
        return (*columns, *(f"section {title}" for title in self.header.sections))

    def _frames(self, stored: Floats | None) -> tuple[int, tuple[Finding, ...]]:
        """Return the number of the first frame; raise FormatError unless the others follow it evenly."""
        if stored is None:
            return 1, ()
        steps = np.diff(stored)
        even = steps == (steps[0] if len(steps) else 1)
        whole = np.isfinite(stored) & (stored == np.round(stored))
        bad = ~whole | ~np.append(True, even & (steps > 0))
        for index in np.flatnonzero(bad)[:1]:
            message = f"frame numbers must be whole and evenly spaced. Got {stored[index]:g}."
            raise FormatError(self.path, message, line=self.header.first_row + 1 + int(index))
        if not len(steps) or steps[0] == 1:
            return int(stored[0]), ()
        message = f"frame numbers go up by {steps[0]:g}; the frames are counted from {stored[0]:g} on, one by one"
        return int(stored[0]), (Finding(rule="frames", level="warning", message=message),)


def _distinct(names: Sequence[str]) -> tuple[list[str], list[Finding]]:
    """Return names of which no two are equal, and a finding for those that were made up."""
    taken, seen = set(names), set[str]()
    distinct, made_up = list[str](), list[str]()
    for name in names:
        own = name
        if name in seen:
            own = next(new for number in count(2) if (new := f"{name}#{number}") not in taken)
            taken.add(own)
            made_up.append(own)
        seen.add(name)
        distinct.append(own)
    if not made_up:
        return distinct, []
    shown = ", ".join(made_up[:5])
    return distinct, [Finding(rule="labels", message=f"{len(made_up)} repeated labels got a new name: {shown}")]


def _kinds(names: Sequence[str], header: Header) -> list[Kind]:
    """Return the kind of each point; one without a name beside others has no label."""
    bare = {bare_name(name) for name in names}
    unnamed = {i: Kind.UNLABELLED for i, name in enumerate(header.names) if not name and any(header.names)}
    known = unnamed | (header.kinds or {})
    return [known.get(i) or kind_by_label(name, bare) for i, name in enumerate(names)]


def _selected(
    names: list[str], kinds: list[Kind], columns: Ints, positions: Floats, known: Bools, options: ReadOptions
) -> list[int]:
    """Return the points that are markers by their names and by their positions, and set the kinds of the others."""
    is_free = np.array([names[i] not in options.points for i in columns])
    seen = known[:, columns].any(axis=0)
    left = ~seen & is_free & seen.any()
    _set_kind(kinds, columns[left], Kind.NEVER_SEEN)
    captured = np.array([kinds[i] is Kind.CAPTURED for i in columns])
    if captured.any():
        follows = computed_by_position(positions[:, columns], known[:, columns], captured) & is_free
        _set_kind(kinds, columns[follows], Kind.COMPUTED)
        left |= follows
    return [int(i) for i in columns[~left]]


def _set_kind(kinds: list[Kind], points: Ints, kind: Kind) -> None:
    """Set the kind of some points, in place."""
    for i in points:
        kinds[i] = kind


def _counts(header: Header, table: _Table) -> list[Finding]:
    """Return a finding if the file has not as many frames as it states."""
    stated, found = header.n_frames, len(table.samples)
    if stated in (None, found):
        return []
    message = f"the header states {stated} frames, the file has {found}, which were read"
    return [Finding(rule="layout", level="warning", message=message, advice="the file may be cut off")]


def _rate(path: Path, table: _Table, header: Header, options: ReadOptions) -> tuple[float, list[Finding]]:
    """Return the frames per second: as given, as stated, or by the times; and findings where these do not agree.

    Raises FormatError if nothing tells the rate.
    """
    findings: list[Finding] = []
    timed = None if table.times is None else _timed_rate(table.times)
    if table.times is not None and timed is not None:
        steps = np.diff(table.times)
        if steps.max() > UNEVEN * np.median(steps):
            message = f"the times are uneven: the longest step is {steps.max():g} s, the median {np.median(steps):g} s"
            findings.append(Finding(rule="times", level="warning", message=message))
    rate = options.rate or header.rate or (timed if timed and timed >= SLOWEST else None)
    if rate is None:
        got = "no column of times" if table.times is None else "times that do not tell it"
        raise FormatError(path, f"the frame rate must be known. Got {got}; give it with --rate.")
    if not RATES[0] <= rate <= RATES[1]:
        raise FormatError(path, f"the frame rate must be {RATES[0]:g} to {RATES[1]:g} Hz. Got {rate:g}; give --rate.")
    if table.times is not None and timed is not None:
        span, stated = float(np.ptp(table.times)), (len(table.times) - 1) / rate
        if abs(span - stated) <= max(RATE_TOLERANCE * span, TIME_ROUNDING):
            return rate, findings
        message = f"the rate is {rate:g} Hz, but the times tell {timed:.6g} Hz"
        findings.append(Finding(rule="rate", level="warning", message=message, advice="if it is wrong, give --rate"))
    return rate, findings


def _timed_rate(times: Floats) -> float | None:
    """Return the rate by times (F,), seconds, with the fewest digits that their rounding allows, or None.

    The rounding is how far the times are from evenly spaced ones. Times that do not rise tell no rate.
    """
    if len(times) < 2 or not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        return None
    span, n_steps = float(times[-1] - times[0]), len(times) - 1
    rounding = min(float(np.abs(times - np.linspace(times[0], times[-1], len(times))).max()), 0.25 * span / n_steps)
    slowest, fastest = n_steps / (span + 2 * rounding), n_steps / (span - 2 * rounding)
    candidates = (float(f"{n_steps / span:.{digits}g}") for digits in range(1, MOST_RATE_DIGITS))
    return next((rate for rate in candidates if slowest <= rate <= fastest), n_steps / span)
