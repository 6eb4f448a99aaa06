"""Nexus CSV: the sections of tables that Vicon Nexus exports as ASCII.

Source: the pages on ASCII export of the Vicon Nexus user guide. A section has its name, its rate, the names of what is
in it above the first of their columns, the axes, the units, and a row for each frame; blank lines are between sections.
The section Trajectories holds the markers, Events what happened when. All other sections are carried along.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocapclean.errors import FormatError
from mocapclean.formats.tables.creating import create_table
from mocapclean.formats.tables.document import AXES, events, outdated, prove, write
from mocapclean.formats.tables.lines import Lines, cells, delimiter_of, first_lines, load_lines, names_of
from mocapclean.formats.tables.reading import Header, read_table, stated_unit
from mocapclean.take import Event, ReadOptions, Take

__all__ = ["create", "events", "outdated", "prove", "read", "sniff", "write"]

MARKERS, EVENTS = b"Trajectories", b"Events"
SECTIONS = {MARKERS, EVENTS, b"Model Outputs", b"Devices", b"Joints", b"Segments"}
AXIS_NAMES = [b"X", b"Y", b"Z"]
RATE, NAMES, AXES_LINE, UNITS, FIRST_ROW = 1, 2, 3, 4, 5
"""Lines of a section behind its name."""


def sniff(head: bytes) -> bool:
    """Whether the first bytes of a file can begin a CSV file of Nexus."""
    lines = first_lines(head)
    return bool(lines) and _title(lines[0]) in SECTIONS


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a CSV file of Nexus, in millimetres.

    Raises FormatError with the line where the section of the markers is faulty.
    """
    text = load_lines(path)
    return read_table(path, "nexus", options, text, _header(path, text, options))


def create(take: Take, path: Path, happened: Sequence[Event] = ()) -> None:
    """Write a new CSV file of the form that Nexus exports, in millimetres, with a section of events if any."""
    n_markers = len(take.markers)
    header = (
        *(_event_lines(happened, take) if happened else ()),
        MARKERS.decode(),
        repr(float(take.rate)),
        ",," + ",,,".join(take.markers) + ",,",
        ",".join(["Frame", "Sub Frame", *["X", "Y", "Z"] * n_markers]),
        ",".join(["", "", *["mm"] * AXES * n_markers]),
    )
    create_table(take, path, header, lambda i: (str(take.first_frame + i), "0"), read, delimiter=",")


def _event_lines(happened: Sequence[Event], take: Take) -> list[str]:
    """Return the section of events; frame 1 of the trial is at time 0."""
    times = [(event.frame + take.first_frame - 1) / take.rate for event in happened]
    rows = [f",{_plain(e.context)},{_plain(e.label)},{t:.9f}," for e, t in zip(happened, times, strict=True)]
    return [EVENTS.decode(), repr(float(take.rate)), "Subject,Context,Name,Time (s),Description", *rows, ""]


def _plain(text: str) -> str:
    """Return a text without the delimiter and the ends of lines."""
    return " ".join(text.replace(",", " ").split())


def _header(path: Path, text: Lines, options: ReadOptions) -> Header:
    """Return the facts of the section of the markers; raise FormatError with the line of a fault."""
    lines = text.lines
    start = next((i for i, line in enumerate(lines) if _title(line) == MARKERS), None)
    if start is None:
        raise FormatError(path, "a section 'Trajectories' must hold the markers. Got none; export it too.")
    if len(lines) <= start + FIRST_ROW:
        raise FormatError(path, "the section 'Trajectories' must have frames. The file ends before.", line=start + 1)
    rate = _positive(_title(lines[start + RATE]))
    delimiter = delimiter_of(lines[start + AXES_LINE])
    names, axes, units = (cells(lines[start + k], delimiter) for k in (NAMES, AXES_LINE, UNITS))
    points = [column for column in range(len(axes) - AXES + 1) if axes[column : column + AXES] == AXIS_NAMES]
    if axes[:1] != [b"Frame"] or not points:
        message = "the axes must follow 'Frame' and 'Sub Frame'. Got none."
        raise FormatError(path, message, line=start + AXES_LINE + 1)
    stated = {
        units[column].decode("latin-1") for point in points for column in range(point, min(point + AXES, len(units)))
    }
    if len(stated) != 1:
        got = ", ".join(sorted(stated)) or "none"
        raise FormatError(path, f"all coordinates must have one unit. Got {got}.", line=start + UNITS + 1)
    factor, findings = stated_unit(stated.pop(), options, "the unit")
    return Header(
        names=[names[column] if column < len(names) else b"" for column in points],
        places=np.array(points)[:, None] + np.arange(AXES),
        first_row=start + FIRST_ROW,
        factor=factor,
        rate=rate,
        frames=0,
        sub_frames=1,
        has_sections=True,
        sections=tuple(t.decode() for line in lines if (t := _title(line)) in SECTIONS - {MARKERS, EVENTS}),
        events=_events(lines, rate, start + FIRST_ROW) if rate else (),
        findings=findings,
    )


def _events(lines: Sequence[bytes], rate: float, first_row: int) -> tuple[Event, ...]:
    """Return the events of a section of them, in the order of their times; frame 1 of the trial is at time 0."""
    start = next((i for i, line in enumerate(lines) if _title(line) == EVENTS), len(lines))
    titles = lines[start + NAMES : start + AXES_LINE]
    rows = [cells(line, delimiter_of(titles[0])) for line in lines[start + NAMES :]] if titles else []
    if not rows or b"Time (s)" not in rows[0]:
        return ()
    first = cells(lines[first_row], delimiter_of(lines[first_row]))[:1]
    first_frame = _number(first[0]) if first else math.nan
    columns = {name: rows[0].index(name) for name in (b"Time (s)", b"Name", b"Context") if name in rows[0]}
    found = []
    for row in rows[1:]:
        if not any(row):
            break
        texts = [row[at] if at < len(row) else b"" for at in columns.values()]
        values = dict(zip(columns, names_of(texts), strict=True))
        seconds = _number(values[b"Time (s)"])
        frame = seconds * rate + 1 - first_frame
        if math.isfinite(frame):
            found.append(Event(label=values.get(b"Name", ""), context=values.get(b"Context", ""), frame=frame))
    return tuple(sorted(found, key=lambda event: event.frame))


def _title(line: bytes) -> bytes:
    """Return what a line has beside delimiters, quotation marks and space at its ends."""
    return line.strip(b' "\t\r\n,;')


def _number(text: str | bytes) -> float:
    """Return a number with a decimal point or comma, NaN for any other text."""
    try:
        return float(text.replace(",", ".") if isinstance(text, str) else text.replace(b",", b"."))
    except ValueError:
        return math.nan


def _positive(text: bytes) -> float | None:
    """Return a positive number, None for any other text."""
    number = _number(text)
    return number if math.isfinite(number) and number > 0 else None
