"""Motive CSV: the tables that OptiTrack Motive exports, with versions 1.2 to 1.25 of the format.

Source: the page "Data Export: CSV" of the OptiTrack documentation (NaturalPoint). A line of facts in pairs; lines with
the type, the name and further facts of each column; a line of what a column is of (Rotation, Position, ...); the axes;
and a row for each frame. An empty cell is a missing number.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocapclean.errors import FormatError
from mocapclean.formats.c3d.point_kinds import Kind
from mocapclean.formats.tables.creating import create_table, name_of
from mocapclean.formats.tables.document import AXES, outdated, prove, write
from mocapclean.formats.tables.lines import Lines, cells, delimiter_of, first_lines, is_blank, load_lines
from mocapclean.formats.tables.reading import Header, read_table, stated_unit
from mocapclean.take import ReadOptions, Take

__all__ = ["create", "outdated", "prove", "read", "sniff", "write"]

FIRST_WORD = b"Format Version"
AXIS_NAMES = [b"X", b"Y", b"Z"]
MARKER = b"marker"
"""The type, in lower case, of measured markers. Others, such as "Rigid Body Marker" and "Bone", Motive computes."""
RATES = ("Export Frame Rate", "Capture Frame Rate")
"""Facts that state the rate, the first that is there counts."""


def sniff(head: bytes) -> bool:
    """Whether the first bytes of a file can begin a CSV file of Motive."""
    lines = first_lines(head)
    return bool(lines) and lines[0].lstrip(b' "').startswith(FIRST_WORD)


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a CSV file of Motive, in millimetres.

    Where none was measured, the unlabelled ones are read, and where there are not even these, what Motive computed.
    Raises FormatError with the line where the header or a frame is faulty.
    """
    text = load_lines(path)
    return read_table(path, "motive", options, text, _header(path, text, options))


def create(take: Take, path: Path) -> None:
    """Write a new CSV file of the form that Motive exports, in millimetres."""
    n_frames, n_markers = take.trusted.shape
    rate = repr(float(take.rate))

    def row(*lead: str, each: Sequence[str]) -> str:
        return ",".join([*lead, *each])

    def thrice(texts: Sequence[str]) -> list[str]:
        return [text for text in texts for _ in range(AXES)]

    header = (
        f"{FIRST_WORD.decode()},1.23,Take Name,{name_of(take)},Capture Frame Rate,{rate},"
        f"Export Frame Rate,{rate},Capture Start Frame,{take.first_frame},Total Frames in Take,{n_frames},"
        f"Total Exported Frames,{n_frames},Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global",
        "",
        row("", "Type", each=["Marker"] * AXES * n_markers),
        row("", "Name", each=thrice(take.markers)),
        row("", "ID", each=thrice([str(i) for i in range(1, n_markers + 1)])),
        row("", "", each=["Position"] * AXES * n_markers),
        row("Frame", "Time (Seconds)", each=["X", "Y", "Z"] * n_markers),
    )
    create_table(take, path, header, lambda i: (str(take.first_frame + i), f"{i / take.rate:.6f}"), read, delimiter=",")


def _header(path: Path, text: Lines, options: ReadOptions) -> Header:
    """Return the facts of a header; raise FormatError with the line of a fault."""
    lines = text.lines
    axes_line = next((i for i, line in enumerate(lines) if cells(line, delimiter_of(line))[:1] == [b"Frame"]), None)
    if axes_line is None:
        raise FormatError(path, "a line that begins with 'Frame' must name the axes. Got none.")
    delimiter = delimiter_of(lines[axes_line])
    above = [cells(line, delimiter) for line in lines[1:axes_line] if not is_blank(line)]
    if len(above) < 3:  # type, name and what the columns are of
        raise FormatError(path, "lines above the axes must have types, names and Position.", line=axes_line + 1)
    axes = cells(lines[axes_line], delimiter)
    types, names, what = _labelled(above, b"Type", 0), _labelled(above, b"Name", 1), above[-1]
    points = [
        column
        for column in range(len(axes) - AXES + 1)
        if axes[column : column + AXES] == AXIS_NAMES
        and [cell.lower() for cell in what[column : column + AXES]] == [b"position"] * AXES
    ]
    if not points:
        raise FormatError(path, "a take must have columns of positions. Got none.", line=axes_line + 1)
    facts = _facts(lines[0])
    factor, findings = stated_unit(facts.get("Length Units", ""), options, "Length Units")
    times = next((i for i, cell in enumerate(axes) if cell.lower().startswith(b"time (")), None)
    return Header(
        names=[_at(names, column) for column in points],
        places=np.array(points)[:, None] + np.arange(AXES),
        first_row=axes_line + 1,
        factor=factor,
        rate=next((rate for name in RATES if (rate := _positive(facts.get(name, "")))), None),
        frames=0,
        times=times,
        n_frames=_count(facts.get("Total Exported Frames", "")),
        kinds={i: Kind.MODEL_OUTPUT for i, column in enumerate(points) if _at(types, column).strip().lower() != MARKER},
        findings=findings,
    )


def _labelled(rows: Sequence[list[bytes]], label: bytes, default: int) -> list[bytes]:
    """Return the row with a label in its first cells, else the one at the place that it has in versions without."""
    return next((row for row in rows if label in row[:3]), rows[default])


def _at(row: Sequence[bytes], column: int) -> bytes:
    """Return a cell of a row, which may end before."""
    return row[column] if column < len(row) else b""


def _facts(line: bytes) -> dict[str, str]:
    """Return the facts of the first line, which holds names and values in turn."""
    words = [cell.decode("latin-1") for cell in cells(line, delimiter_of(line))]
    return dict(zip(words[0::2], words[1::2], strict=False))


def _positive(text: str) -> float | None:
    """Return a positive number, None for any other text."""
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        return None
    return number if math.isfinite(number) and number > 0 else None


def _count(text: str) -> int | None:
    """Return a whole number, None for any other text."""
    return int(text) if text.isascii() and text.isdigit() and len(text) <= len(str(1 << 53)) else None
