"""Qualisys TSV: the tables of 3D positions that Qualisys Track Manager exports, with or without their header.

Source: the manual of Qualisys Track Manager, TSV file formats. Lines of facts, each with a word in capitals; EVENT
lines with name, frame and time; MARKER_NAMES; optionally TRAJECTORY_TYPES and a line of titles; and a row for each
frame, optionally behind the frame's number and time. Lengths are millimetres. A missing sample is 0.000 or a word that
the user chose.
"""

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocapclean.arrays import Ints
from mocapclean.errors import FormatError
from mocapclean.formats.tables.creating import create_table
from mocapclean.formats.tables.document import AXES, events, outdated, prove, write
from mocapclean.formats.tables.lines import Lines, cells, first_lines, load_lines, names_of
from mocapclean.formats.tables.numbers import is_missing_cell, is_number
from mocapclean.formats.tables.reading import Header, read_table
from mocapclean.formats.text import quote
from mocapclean.take import Event, Finding, ReadOptions, Take

__all__ = ["create", "events", "outdated", "prove", "read", "sniff", "write"]

FACT = re.compile(rb"[A-Z][A-Z_]+")
"""The first word of a line of the header."""
POINTS = (b"NO_OF_MARKERS", b"MARKER_NAMES", b"NO_OF_BODIES", b"BODY_NAMES")
"""Words of headers of files with positions; files of analog data and forces have none of them."""
FEWEST_HEADERLESS = AXES
"""Numbers in the first line of a file without header."""
TAB = b"\t"


def sniff(head: bytes) -> bool:
    """Whether the first bytes of a file can begin a TSV file of Qualisys, or one that has numbers alone."""
    lines = first_lines(head)
    if not lines:
        return False
    first = cells(lines[0], TAB)
    if FACT.fullmatch(first[0]):
        return any(cells(line, TAB)[0] in POINTS for line in lines)
    numbers = sum(map(is_number, first))
    return numbers >= FEWEST_HEADERLESS and all(is_number(cell) or is_missing_cell(cell) for cell in first)


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a TSV file of Qualisys, in millimetres.

    Raises FormatError with the line where the header or a frame is faulty, and for a file of rigid bodies (6D) or of
    images (2D).
    """
    text = load_lines(path)
    return read_table(path, "qualisys", options, text, _header(path, text, options))


def create(take: Take, path: Path, happened: Sequence[Event] = ()) -> None:
    """Write a new TSV file of the form that Qualisys exports, with events; missing samples are 0."""
    n_frames, n_markers = take.trusted.shape
    header = (
        f"NO_OF_FRAMES\t{n_frames}",
        "NO_OF_CAMERAS\t0",
        f"NO_OF_MARKERS\t{n_markers}",
        f"FREQUENCY\t{float(take.rate)!r}",
        "NO_OF_ANALOG\t0",
        "ANALOG_FREQUENCY\t0",
        "DESCRIPTION\t--",
        "DATA_INCLUDED\t3D",
        *(_event_line(event, take) for event in happened),
        "\t".join(["MARKER_NAMES", *take.markers]),
        "\t".join(["TRAJECTORY_TYPES", *["Measured"] * n_markers]),
        "\t".join(["Frame", "Time", *(f"{name} {axis}" for name in take.markers for axis in "XYZ")]),
    )
    create_table(
        take,
        path,
        header,
        lambda i: (str(take.first_frame + i), f"{i / take.rate:.6f}"),
        read,
        delimiter="\t",
        missing="0.000000",
    )


def _event_line(event: Event, take: Take) -> str:
    """Return the line of an event: its name, frame and time."""
    name = " ".join(f"{event.context} {event.label}".split())
    return f"EVENT\t{name}\t{event.frame + take.first_frame:.10g}\t{event.frame / take.rate:.6f}"


def _header(path: Path, text: Lines, options: ReadOptions) -> Header:
    """Return the facts of a header; raise FormatError with the line of a fault."""
    facts, first_row = _facts(text.lines)
    included = [cell.upper() for cell in facts.get("DATA_INCLUDED", [])[:1]]
    if included not in ([], [b"3D"]) or "BODY_NAMES" in facts:
        message = f"a take must have 3D positions of markers. Got {quote(included[0] if included else b'6D')} data."
        raise FormatError(path, f"{message} Export the 3D data instead.")
    titles = cells(text.lines[first_row], TAB) if first_row < len(text.lines) else []
    has_titles = bool(titles) and not all(is_number(cell) or is_missing_cell(cell) for cell in titles)
    first_row += has_titles
    row = cells(text.lines[first_row], TAB) if first_row < len(text.lines) else []
    while row and not row[-1] and len(row) > 1:
        row.pop()
    names = [name for name in facts.get("MARKER_NAMES", []) if name]
    names, places = _titled(titles) if has_titles else _untitled(path, names, len(row), first_row + 1)
    if not names:
        raise FormatError(path, "a take must have markers. Got none in the header.", line=first_row + 1)
    n_leading = int(places.min())
    stated = _count(facts, "NO_OF_MARKERS")
    findings = []
    if stated not in (None, len(names)):
        message = f"NO_OF_MARKERS is {stated}, but there are {len(names)} markers, which were read"
        findings.append(Finding(rule="layout", level="warning", message=message))
    rate = _positive(facts.get("FREQUENCY", [b""])[:1])
    if options.unit is not None and options.unit != 1.0:
        message = f"lengths are millimetres, but a unit of {options.unit:g} mm was given (--unit), which was used"
        findings.append(Finding(rule="units", level="warning", message=message))
    return Header(
        names=names,
        places=places,
        first_row=first_row,
        factor=options.unit or 1.0,
        rate=rate,
        frames=0 if n_leading else None,
        times=1 if n_leading > 1 else None,
        n_frames=_count(facts, "NO_OF_FRAMES"),
        zeros=True,
        events=_events(text.lines[:first_row], _first_frame(row) if n_leading else 1),
        findings=tuple(findings),
    )


def _facts(lines: Sequence[bytes]) -> tuple[dict[str, list[bytes]], int]:
    """Return the cells behind the word of each line of the header, and the index of the line behind the header."""
    facts: dict[str, list[bytes]] = {}
    for index, line in enumerate(lines):
        word, *values = cells(line, TAB)
        if not FACT.fullmatch(word):
            return facts, index
        facts[word.decode()] = values
    return facts, len(lines)


def _titled(titles: Sequence[bytes]) -> tuple[list[bytes], Ints]:
    """Return the names and the places of points by titles such as "LANK X"; none where no three belong together."""
    names, places = [], []
    for column in range(len(titles) - AXES + 1):
        parts = [title.rpartition(b" ") for title in titles[column : column + AXES]]
        if [axis for _, _, axis in parts] == [b"X", b"Y", b"Z"] and len({name for name, _, _ in parts}) == 1:
            names.append(parts[0][0])
            places.append(range(column, column + AXES))
    return names, np.array(places, dtype=np.intp).reshape(-1, AXES)


def _untitled(path: Path, names: list[bytes], width: int, line: int) -> tuple[list[bytes], Ints]:
    """Return the names and places of points by the cells of a row, which may have the frame's number and time first."""
    n_leading = width - AXES * len(names) if names else width % AXES
    if n_leading not in (0, 1, 2) or width < AXES:
        got = f"{len(names)} names and {width} cells"
        raise FormatError(path, f"a frame must have three cells for each marker. Got {got}.", line=line)
    n_points = (width - n_leading) // AXES
    return names or [b""] * n_points, n_leading + np.arange(AXES * n_points).reshape(-1, AXES)


def _events(lines: Sequence[bytes], first_frame: float) -> tuple[Event, ...]:
    """Return the events of a header in the order of their frames."""
    found = []
    for line in lines:
        word, *values = cells(line, TAB)
        if word == b"EVENT" and len(values) > 1 and is_number(values[1]):
            frame = float(values[1].replace(b",", b".")) - first_frame
            found.append(Event(label=names_of(values[:1])[0], context="", frame=frame))
    return tuple(sorted(found, key=lambda event: event.frame))


def _first_frame(row: Sequence[bytes]) -> float:
    """Return the number of the first frame, 1 where it is none."""
    return float(row[0].replace(b",", b".")) if row and is_number(row[0]) else 1.0


def _count(facts: dict[str, list[bytes]], name: str) -> int | None:
    """Return a count of the header, None for any other text."""
    value = (facts.get(name) or [b""])[0]
    return int(value) if value.isdigit() and len(value) <= len(str(1 << 53)) else None


def _positive(values: Sequence[bytes]) -> float | None:
    """Return a positive number, None for any other text."""
    try:
        number = float(values[0].replace(b",", b"."))
    except (ValueError, IndexError):
        return None
    return number if math.isfinite(number) and number > 0 else None
