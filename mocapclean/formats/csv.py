"""Plain tables: text with a row for each frame and columns such as LANK_X, LANK_Y, LANK_Z, in the order of any program.

The names of the columns decide. A name and an axis make a coordinate: ``LANK_X``, ``LANK.x``, ``LANK:X``, ``LANK x``,
``x_LANK``, ``LANK_X (mm)``; or the names are in a line above one of axes alone. Columns for the frame's number and time
are known by their names. All other columns, such as confidences, are carried along.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Ints
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.c3d.point_kinds import Kind
from mocapclean.formats.c3d.points import MILLIMETRES
from mocapclean.formats.tables.creating import create_table
from mocapclean.formats.tables.document import AXES, outdated, prove, write
from mocapclean.formats.tables.lines import Lines, cells, delimiter_of, first_lines, is_blank, load_lines, raw_cells
from mocapclean.formats.tables.numbers import numbers
from mocapclean.formats.tables.reading import Header, read_table
from mocapclean.formats.text import is_number
from mocapclean.take import Finding, ReadOptions, Take

__all__ = ["create", "outdated", "prove", "read", "sniff", "write"]

MOST_HEADER_LINES = 20
"""Lines in which the names of the columns are looked for. Chosen by hand: programs write fewer before them."""
MARK = rb"[ _.:\-/|]"
"""What stands between a name and an axis."""
AXIS_LAST = re.compile(rb"(?P<name>.+)%s(?P<axis>[xyz])" % MARK, re.IGNORECASE)
AXIS_FIRST = re.compile(rb"(?P<axis>[xyz])%s(?P<name>.+)" % MARK, re.IGNORECASE)
AXIS_JOINED = re.compile(rb"(?P<name>.*[a-z0-9])(?P<axis>[XYZ])")
"""Patterns of a coordinate's name, of which the first that finds three axes counts; the last is noseX."""
FOURTH_AXIS = re.compile(rb"(.+)%sw" % MARK), re.compile(rb"(.+)w"), re.compile(rb"w%s(.+)" % MARK)
"""Patterns of the fourth coordinate of a quaternion, in lower case."""
UNIT = re.compile(rb"\s*[(\[]\s*(?P<unit>[^()\[\]]+?)\s*[)\]]$")
FRAME = re.compile(rb"frame[ _]?(?:#|no\.?|nr\.?|number|id|index)?", re.IGNORECASE)
TIME = re.compile(rb"(?:time|timestamp|t)[ _]?(?P<unit>s|sec|seconds|ms|msec|milliseconds)?", re.IGNORECASE)
MILLISECONDS = re.compile(rb"ms|msec|milliseconds", re.IGNORECASE)
MILLISECONDS_PER_SECOND = 1e3
"""By definition."""
QUANTITY_WORDS = re.compile(
    rb"rot|rotation|quat|quaternion|orientation|euler|angle|angles|vel|velocity|acc|accel|acceleration|gyro|mag"
    rb"|force|moment|torque|power|size|scale|residual|error",
    re.IGNORECASE,
)
"""Words in names of what has three axes and is no position."""
WORD = re.compile(rb"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""A word within a name in camel case or with other marks between."""
SMALLEST_BODY = 10.0
"""Numbers between the farthest markers of a frame below which they are taken as metres: nothing of 10 mm is captured,
and nothing of 10 m. Chosen by hand."""
METRE = 1000.0
"""Millimetres, by definition."""
SEEN_ROWS = 100
"""Rows from which the size of the body is taken, where the unit is not stated. Chosen for speed."""


class Column(NamedTuple):
    """A coordinate: the name of its point, the axis from 0, and the unit of length that the title states."""

    name: bytes
    axis: int
    unit: bytes


def sniff(head: bytes) -> bool:
    """Whether the first bytes of a file can begin a table whose columns name coordinates."""
    lines = first_lines(head)
    starts = (b"Format Version", b"PathFileType", b"NO_OF_", b"Trajectories", b"Model Outputs", b"Devices", b"Events")
    if not lines or lines[0].lstrip(b' "').startswith(starts):
        return False
    titles = _titles(lines[:MOST_HEADER_LINES])
    return titles is not None and len(_quantities(titles)) < len(titles.names)


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a plain table, in millimetres.

    Raises FormatError if no columns name coordinates or nothing tells the frame rate, and with the line of a faulty
    frame.
    """
    text = load_lines(path)
    return read_table(path, "csv", options, text, _header(path, text, options))


def create(take: Take, path: Path) -> None:
    """Write a new table with the columns frame, time and, in millimetres, NAME_X, NAME_Y, NAME_Z of each marker.

    Raises UsageError for a take of one frame, because the times of a plain table tell its rate.
    """
    if len(take) == 1:
        raise UsageError("a plain table tells the rate by its times, and must have two frames or more. Got 1.")
    titles = [f"{name}_{axis} (mm)" for name in take.markers for axis in "XYZ"]
    create_table(
        take,
        path,
        [",".join(["frame", "time", *titles])],
        lambda i: (str(take.first_frame + i), f"{i / take.rate:.9f}"),
        read,
        delimiter=",",
    )


class Titles(NamedTuple):
    """The line of the titles, by index, and for each point its name, the cells of its coordinates and their unit."""

    line: int
    cells: list[bytes]
    names: list[bytes]
    places: list[list[int]]
    unit: bytes


def _titles(lines: Sequence[bytes]) -> Titles | None:
    """Return the titles of a table: the first line in which columns name all axes of a point, alone or with the line
    above; None if there is none.
    """
    above: list[bytes] = []
    for index, line in enumerate(lines):
        titles = cells(line, delimiter_of(line))
        joined = _below(above, titles)
        for pattern in (AXIS_LAST, AXIS_FIRST, AXIS_JOINED):
            found = _points(_columns(titles if joined is None else joined, pattern))
            if found[0]:
                return Titles(index, titles, *found)
        above = titles
    return None


def _below(above: Sequence[bytes], titles: Sequence[bytes]) -> list[bytes] | None:
    """Return the titles of a line of axes alone below a line of names; None for any other two lines."""
    is_axis = [title.lower() in (b"x", b"y", b"z") for title in titles]
    if sum(is_axis) < AXES or len(above) < len(titles) - AXES:
        return None
    names, name = [], b""
    for column in range(len(titles)):
        name = above[column] if column < len(above) and above[column] else name
        names.append(b"%b_%b" % (name, titles[column]) if is_axis[column] and name else titles[column])
    return names


def _columns(titles: Sequence[bytes], pattern: re.Pattern[bytes]) -> dict[int, Column]:
    """Return the coordinates among titles by their place."""
    found = {}
    for place, title in enumerate(titles):
        unit = UNIT.search(title)
        match = pattern.fullmatch(title[: unit.start()] if unit else title)
        if match:
            axis = b"xyz".index(match["axis"].lower())
            found[place] = Column(match["name"].strip(), axis, unit["unit"] if unit else b"")
    return found


def _points(columns: dict[int, Column]) -> tuple[list[bytes], list[list[int]], bytes]:
    """Return the names of points that have all three axes, the places of these, and the unit that all titles state."""
    places: dict[bytes, dict[int, int]] = {}
    for place, column in columns.items():
        places.setdefault(column.name, {}).setdefault(column.axis, place)
    whole = {name: [axes[axis] for axis in range(AXES)] for name, axes in places.items() if len(axes) == AXES}
    units = {columns[place].unit for own in whole.values() for place in own}
    return list(whole), list(whole.values()), units.pop() if len(units) == 1 else b""


def _header(path: Path, text: Lines, options: ReadOptions) -> Header:
    """Return the facts of a header; raise FormatError if no columns name coordinates."""
    titles = _titles(text.lines[:MOST_HEADER_LINES])
    if titles is None:
        raise FormatError(path, "columns must be named such as LANK_X, LANK_Y, LANK_Z. Got none with all three axes.")
    first_row = titles.line + 1
    while first_row < len(text.lines) and is_blank(text.lines[first_row]):
        first_row += 1
    times = {i: match for i, title in enumerate(titles.cells) if (match := TIME.fullmatch(_without_marks(title)))}
    first = cells(text.lines[first_row], delimiter_of(text.lines[first_row])) if first_row < len(text.lines) else []
    # Dates, and seconds since 1970, which are larger than a number may be, are carried along.
    time = next((i for i in times if i < len(first) and is_number(first[i].replace(b",", b"."))), None)
    is_milliseconds = time is not None and MILLISECONDS.fullmatch(times[time]["unit"] or b"") is not None
    places = np.array(titles.places)
    factor, finding = _unit(path, text.lines, first_row, places, titles.unit, options)
    return Header(
        names=titles.names,
        places=places,
        first_row=first_row,
        factor=factor,
        frames=next((i for i, title in enumerate(titles.cells) if FRAME.fullmatch(title)), None),
        times=time,
        time_unit=MILLISECONDS_PER_SECOND if is_milliseconds else 1.0,
        kinds=dict.fromkeys(_quantities(titles), Kind.QUANTITY),
        findings=(finding,),
    )


def _quantities(titles: Titles) -> list[int]:
    """Return the points that are no positions: by a word in their name, or because a fourth axis makes a quaternion."""
    fourth = set[bytes]()
    for title in map(bytes.lower, titles.cells):
        fourth |= {match[1] for pattern in FOURTH_AXIS if (match := pattern.fullmatch(title))}
    return [
        i
        for i, name in enumerate(titles.names)
        if name.lower() in fourth or any(map(QUANTITY_WORDS.fullmatch, WORD.findall(name)))
    ]


def _unit(
    path: Path, lines: Sequence[bytes], first_row: int, places: Ints, stated: bytes, options: ReadOptions
) -> tuple[float, Finding]:
    """Return the millimetres of a unit of length, and the finding that tells why.

    The option comes first, then the titles. Else it is a metre if the first rows would be tiny in millimetres, or a
    millimetre.
    """
    word = stated.decode("latin-1").lower()
    known = next((factor for pattern, factor in MILLIMETRES if re.fullmatch(pattern, word)), None)
    if options.unit is not None:
        level = "info" if known in (None, options.unit) else "warning"
        also = "" if level == "info" else f", although the titles state {word}"
        message = f"a unit of length is {options.unit:g} mm, as given (--unit){also}"
        return options.unit, Finding(rule="units", level=level, message=message)
    if known is not None:
        return known, Finding(rule="units", message=f"a unit of length is {known:g} mm, as the titles state")
    size = _size(path, lines, first_row, places)
    factor, why = (METRE, f"the markers are {size:.3g} apart") if size < SMALLEST_BODY else (1.0, "as most tables have")
    message = f"the table states no unit of length; {factor:g} mm is assumed ({why})"
    advice = "compare a known distance, or give the unit (--unit)"
    return factor, Finding(rule="units", level="warning", message=message, advice=advice)


def _size(path: Path, lines: Sequence[bytes], first_row: int, places: Ints) -> float:
    """Return the median over some rows of the largest range of a coordinate, infinity if no row has two points."""
    rows = lines[first_row : first_row + SEEN_ROWS]
    delimiter = delimiter_of(rows[0]) if rows else None
    found = {number: raw_cells(row, delimiter) for number, row in enumerate(rows, start=first_row + 1)}
    wide = {n: [row[place] for place in places.ravel()] for n, row in found.items() if len(row) > places.max()}
    if delimiter != b",":
        wide = {n: [cell.replace(b",", b".") for cell in row] for n, row in wide.items()}
    ranges = []
    for points in numbers(path, list(wide.values()), list(wide)).reshape(-1, *places.shape):
        seen = points[np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)]
        if len(seen) > 1:
            ranges.append(np.ptp(seen, axis=0).max())
    return float(np.median(ranges)) if ranges else np.inf


def _without_marks(title: bytes) -> bytes:
    """Return a title with the brackets around its unit taken away."""
    return re.sub(rb"[()\[\]]", b"", title).strip()
