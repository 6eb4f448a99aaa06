"""TRC: the tables of markers that OpenSim, Vicon Nexus, Cortex and programs without markers exchange.

Source: the page "Marker (.trc) Files" of the OpenSim documentation (Stanford University). Three lines of facts, a line
of names above the first of three columns each, a line X1, Y1, Z1 and so on, a blank line, and a row for each frame.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mocapclean.errors import FormatError
from mocapclean.formats.tables.creating import create_table, name_of
from mocapclean.formats.tables.document import AXES, outdated, prove, write
from mocapclean.formats.tables.lines import Lines, cells, delimiter_of, first_lines, is_blank, load_lines
from mocapclean.formats.tables.reading import Header, read_table, stated_unit
from mocapclean.formats.text import quote
from mocapclean.take import Finding, ReadOptions, Take

__all__ = ["create", "outdated", "prove", "read", "sniff", "write"]

FIRST_WORD = b"PathFileType"
FACTS = 1
"""Index of the line with the names of the facts; their values are in the next, the markers' names behind it."""
LEADING = 2
"""Columns before the first marker: the frame's number and its time."""


def sniff(head: bytes) -> bool:
    """Whether the first bytes of a file can begin a TRC file."""
    lines = first_lines(head)
    return bool(lines) and lines[0].lstrip(b' "').startswith(FIRST_WORD)


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a TRC file, in millimetres.

    Raises FormatError with the line where the header or a frame is faulty.
    """
    text = load_lines(path)
    return read_table(path, "trc", options, text, _header(path, text, options))


def create(take: Take, path: Path) -> None:
    """Write a new TRC file in millimetres; the cells of missing samples are empty."""
    n_frames, n_markers = take.trusted.shape
    rate = repr(float(take.rate))
    header = (
        f"{FIRST_WORD.decode()}\t4\t(X/Y/Z)\t{name_of(take)}.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        f"{rate}\t{rate}\t{n_frames}\t{n_markers}\tmm\t{rate}\t{take.first_frame}\t{n_frames}",
        "Frame#\tTime\t" + "\t\t\t".join(take.markers) + "\t\t",
        "\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, n_markers + 1)),
        "",
    )
    create_table(
        take, path, header, lambda i: (str(take.first_frame + i), f"{i / take.rate:.6f}"), read, delimiter="\t"
    )


def _header(path: Path, text: Lines, options: ReadOptions) -> Header:
    """Return the facts of a header; raise FormatError with the line of a fault."""
    lines = text.lines
    facts = _facts(path, lines)
    at = FACTS + 2
    if len(lines) <= at or not lines[at].lstrip(b' "').lower().startswith(b"frame"):
        raise FormatError(
            path, "the names of the markers must follow 'Frame#' and 'Time'. Got no such line.", line=at + 1
        )
    names = _names(cells(lines[at], delimiter_of(lines[at]))[LEADING:])
    if not names:
        raise FormatError(path, "a take must have markers. Got no name behind 'Time'.", line=at + 1)
    first_row = at + 1
    if first_row < len(lines) and b"X1" in map(bytes.upper, cells(lines[first_row], delimiter_of(lines[first_row]))):
        first_row += 1
    while first_row < len(lines) and is_blank(lines[first_row]):
        first_row += 1
    factor, unit_findings = stated_unit(facts.get("Units", b"").decode("latin-1"), options, "Units")
    rate, rate_findings = _rate(facts)
    return Header(
        names=names,
        places=LEADING + np.arange(AXES * len(names)).reshape(-1, AXES),
        first_row=first_row,
        factor=factor,
        rate=rate,
        frames=0,
        times=1,
        n_frames=_count(path, facts, "NumFrames"),
        findings=(*unit_findings, *rate_findings, *_check_markers(path, facts, names, lines[first_row:])),
    )


def _names(titles: Sequence[bytes]) -> list[bytes]:
    """Return the names of the markers; b"" for one without a name, which the places of the others show.

    A name is above the first of three columns. In files whose names follow each other otherwise, all are named.
    """
    names = [title for title in titles if title]
    above = list(titles[::AXES])
    while above and not above[-1]:
        above.pop()
    return above if [name for name in above if name] == names else names


def _facts(path: Path, lines: Sequence[bytes]) -> dict[str, bytes]:
    """Return the values of the header's third line by the names in the second."""
    if len(lines) < FACTS + 2:
        raise FormatError(path, "the header must have five lines. The file ends before.", line=len(lines))
    names, values = (cells(line, delimiter_of(line)) for line in lines[FACTS : FACTS + 2])
    return {name.decode("latin-1"): value for name, value in zip(names, values, strict=False)}


def _count(path: Path, facts: dict[str, bytes], name: str) -> int | None:
    """Return a count of the header, None if it has none; raise FormatError if it is no whole number."""
    value = facts.get(name, b"")
    if not value:
        return None
    if not value.isdigit() or len(value) > len(str(1 << 53)):
        raise FormatError(path, f"{name} must be a whole number. Got {quote(value)}.", line=FACTS + 2)
    return int(value)


def _rate(facts: dict[str, bytes]) -> tuple[float | None, tuple[Finding, ...]]:
    """Return DataRate, or CameraRate where that is no rate, and a finding if the second was taken."""
    rates = {name: _positive(facts.get(name, b"")) for name in ("DataRate", "CameraRate")}
    if rates["DataRate"] or not rates["CameraRate"]:
        return rates["DataRate"], ()
    message = f"DataRate must be positive; CameraRate, {rates['CameraRate']:g} Hz, was used"
    return rates["CameraRate"], (Finding(rule="rate", level="warning", message=message),)


def _positive(value: bytes) -> float | None:
    """Return a positive number, None for any other text."""
    try:
        number = float(value.replace(b",", b"."))
    except ValueError:
        return None
    return number if math.isfinite(number) and number > 0 else None


def _check_markers(
    path: Path, facts: dict[str, bytes], names: Sequence[bytes], rows: Sequence[bytes]
) -> tuple[Finding, ...]:
    """Return a finding if NumMarkers is not the number of names; raise FormatError if that does not fit the frames."""
    stated = _count(path, facts, "NumMarkers")
    width = _width(rows[0]) if rows else 0
    if width > LEADING + AXES * len(names):
        got = f"{len(names)} names above {width - LEADING} coordinates"
        raise FormatError(path, f"every marker must have a name and three coordinates. Got {got}.", line=FACTS + 3)
    if stated in (None, len(names)):
        return ()
    message = f"NumMarkers is {stated}, but {len(names)} markers are named, which were read"
    return (Finding(rule="layout", level="warning", message=message),)


def _width(row: bytes) -> int:
    """Return the number of cells of a row up to its last that is not blank."""
    found = cells(row, delimiter_of(row))
    while found and not found[-1]:
        found.pop()
    return len(found)
