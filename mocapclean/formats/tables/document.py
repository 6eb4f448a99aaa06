"""The document of a table of text, its repair and the proof: a copy in which only cells of changed samples differ."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.tables.lines import Lines, load_lines, spans_at
from mocapclean.formats.tables.numbers import NumberStyle, is_number
from mocapclean.formats.text import LARGEST_NUMBER
from mocapclean.take import Event, Finding, Take

AXES = 3
"""Coordinates of a sample."""


@dataclass(frozen=True, kw_only=True)
class TableDocument:
    """A text file with a row for each of F frames, kept byte for byte.

    text: its lines. first_row: index of the line of frame 0. n_frames: F. delimiter: of the
    rows' cells, None for white space. places: (M, 3) index of the cell of each coordinate. factor: millimetres per
    number. style: of the numbers. missing: how the file spells a missing number. present: (F, M) the samples that the
    file has. carried: names of the points that are no markers; computed: of those that follow
    from others. others: what the file has beside the positions of its
    points, in words. events: that the file states.
    """

    text: Lines = field(repr=False)
    first_row: int
    n_frames: int
    delimiter: bytes | None
    places: Ints
    factor: float
    style: NumberStyle
    missing: bytes
    present: Bools
    carried: tuple[str, ...] = ()
    computed: tuple[str, ...] = ()
    others: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()

    def row(self, frame: int) -> bytes:
        """Return the line of a frame, with delimiters for samples that are left out at its end."""
        line = self.text.lines[self.first_row + frame]
        if self.delimiter is None:
            return line
        body = line.rstrip(b"\r\n")
        n_left_out = int(self.places.max()) - body.count(self.delimiter)
        return body + self.delimiter * max(n_left_out, 0) + line[len(body) :]

    def spelled(self, positions: Floats) -> tuple[list[list[bytes]], Floats]:
        """Return the cells of samples (n, 3), and the positions that these cells stand for."""
        cells = [[self.style.spell(value) for value in row] for row in (positions / self.factor).tolist()]
        stored = np.array([[self.style.value(cell) for cell in row] for row in cells]).reshape(-1, AXES)
        return cells, stored * self.factor

    def with_cells(self, frame: int, cells: dict[int, bytes]) -> bytes:
        """Return the line of a frame with some of its cells, by index, replaced."""
        line, parts, at = self.row(frame), [], 0
        places = sorted(cells)
        for place, (start, stop) in zip(places, spans_at(line, self.delimiter, places), strict=True):
            parts += [line[at:start], cells[place]]
            at = stop
        return b"".join([*parts, line[at:]])


def events(take: Take) -> tuple[Event, ...]:
    """Return the events that the file of a take states."""
    document = take.origin.document if take.origin else None
    return document.events if isinstance(document, TableDocument) else ()


def outdated(take: Take) -> tuple[str, ...]:
    """Return the computed points, which are carried untouched, if a marker of a take is changed.

    A table does not state from which markers they were computed.
    """
    document = take.origin.document if take.origin else None
    return document.computed if isinstance(document, TableDocument) and take.changed.any() else ()


def write(take: Take, path: Path, *, invalidate: bool = False) -> Take:
    """Write the kept text with the cells of changed samples replaced; return the take as stored.

    Numbers are spelled as the file spells its own. With ``invalidate``, samples neither trusted nor filled get the
    file's mark of a missing number. Raises FormatError when a filled position is too large; UsageError when the take
    has not the frames and markers with which it was read.
    """
    document = _kept_document(take)
    positions, changed = take.positions.copy(), take.changed.copy()
    frames, markers = np.nonzero(changed)
    _check_size(take, path, document, frames, markers)
    spelled, stored = document.spelled(positions[frames, markers])
    positions[frames, markers] = stored
    lost = (stored == 0).all(axis=1)
    changed[frames[lost], markers[lost]] = False
    cells: dict[int, dict[int, bytes]] = {}
    for frame, marker, texts, is_lost in zip(frames.tolist(), markers.tolist(), spelled, lost, strict=True):
        if not is_lost:
            cells.setdefault(frame, {}).update(zip(document.places[marker].tolist(), texts, strict=True))
    if invalidate:
        for frame, marker in np.argwhere(~(take.trusted | take.filled) & document.present).tolist():
            cells.setdefault(frame, {}).update(dict.fromkeys(document.places[marker].tolist(), document.missing))
    lines = list(document.text.lines)
    for frame, own in cells.items():
        lines[document.first_row + frame] = document.with_cells(frame, own)
    path.write_bytes(document.text.encoded(_mark(document) + b"".join(lines)))
    return _as_stored(take, positions, take.changed & ~changed)


def prove(take: Take, path: Path) -> None:
    """Raise FormatError unless ``path`` is the take's own file except for the cells of changed and invalidated samples.

    take: the return of ``write``. The file is read again; the changed cells must hold the take's positions.
    """
    document = _kept_document(take)
    written = load_lines(path)
    kept = document.text
    if (written.codec, written.first) != (kept.codec, kept.first) or len(written.lines) != len(kept.lines):
        raise FormatError(path, "the encoding and the number of lines must be those of the input. Got others.")
    changed = take.changed
    may_differ = changed | (~take.trusted & document.present)
    # 1. All lines are equal, but those of frames with samples that may differ.
    for line, (before, after) in enumerate(zip(kept.lines, written.lines, strict=True)):
        frame = line - document.first_row
        is_frame = 0 <= frame < document.n_frames
        if before != after and not (is_frame and may_differ[frame].any()):
            raise FormatError(path, "what was not filled must stay as it was. Got another line.", line=line + 1)
    # 2. In these lines all bytes are equal outside of the cells of such samples. 3. Changed cells hold the take.
    for frame in np.flatnonzero(may_differ.any(axis=1)).tolist():
        markers = np.flatnonzero(may_differ[frame])
        places = document.places[markers].ravel().tolist()
        old_cells, old_rest = _cells_and_rest(document, document.row(frame), places)
        new_cells, new_rest = _cells_and_rest(document, written.lines[document.first_row + frame], places)
        if new_rest != old_rest or len(new_cells) != len(places):
            raise FormatError(
                path,
                "what was not filled must stay as it was. Got another cell.",
                frame=take.first_frame + frame,
                line=document.first_row + frame + 1,
            )
        for index, marker in enumerate(markers.tolist()):
            own = slice(AXES * index, AXES * (index + 1))
            kept_cells = None if changed[frame, marker] else old_cells[own]
            _check_cells(take, path, frame, marker, new_cells[own], kept_cells)


def _kept_document(take: Take) -> TableDocument:
    """Return the document that a take was read with; raise UsageError if the take no longer fits it."""
    document = take.origin.document if take.origin else None
    if not isinstance(document, TableDocument):
        raise UsageError("a take must come from a table to be written into a copy of it. Got one that does not.")
    if take.trusted.shape != document.present.shape:
        raise UsageError(
            f"a take must keep the {document.present.shape} frames and markers of its file to be written into a copy "
            f"of it. Got {take.trusted.shape}."
        )
    return document


def _check_size(take: Take, path: Path, document: TableDocument, frames: Ints, markers: Ints) -> None:
    """Raise FormatError unless the positions of some samples are finite and not too large for a number of the file."""
    limit = LARGEST_NUMBER * document.factor
    bad = ~(np.abs(take.positions[frames, markers]) <= limit).all(axis=1)
    for index in np.flatnonzero(bad)[:1]:
        raise FormatError(
            path,
            f"a filled position must be finite and within {limit:g} mm. Got "
            f"{take.positions[frames[index], markers[index]].tolist()}.",
            frame=take.first_frame + int(frames[index]),
            marker=take.markers[markers[index]],
        )


def _mark(document: TableDocument) -> bytes:
    """Return the byte order mark of the text, as it is before line 0."""
    return b"\xef\xbb\xbf"[: document.text.first]


def _as_stored(take: Take, positions: Floats, lost: Bools) -> Take:
    """Return a take with the positions as stored, without the samples that would mean missing, with a finding."""
    if not lost.any():
        return replace(take, positions=positions)
    fills = "1 fill" if lost.sum() == 1 else f"{lost.sum()} fills"
    message = f"{fills} would be stored as 0, 0, 0, which means missing, and left out"
    return replace(
        take,
        positions=np.where(lost[..., None], take.positions, positions),
        trusted=take.trusted & ~lost,
        filled=take.filled & ~lost,
        moved=take.moved & ~lost,
        findings=(*take.findings, Finding(rule="write", level="warning", message=message)),
    )


def _cells_and_rest(document: TableDocument, line: bytes, places: list[int]) -> tuple[list[bytes], list[bytes]]:
    """Return the cells of a line at some places, in their order, and the bytes before, between and after them.

    Both are empty if the line has not as many cells.
    """
    try:
        spans = spans_at(line, document.delimiter, places)
    except IndexError:
        return [], []
    rest, at = [], 0
    for start, stop in sorted(spans):
        rest.append(line[at:start])
        at = stop
    return [line[start:stop] for start, stop in spans], [*rest, line[at:]]


def _check_cells(take: Take, path: Path, frame: int, marker: int, cells: list[bytes], kept: list[bytes] | None) -> None:
    """Raise FormatError unless the cells of a sample hold it or, where ``kept`` is given, these cells or the mark."""
    document = _kept_document(take)
    expected = take.positions[frame, marker].tolist()
    if kept is None:
        right = all(map(is_number, cells)) and [document.style.value(c) * document.factor for c in cells] == expected
    else:
        right = cells in (kept, [document.missing] * AXES)
    if not right:
        raise FormatError(
            path,
            f"a sample must read back as {expected} mm or as it was. Got {b', '.join(cells).decode('latin-1')}.",
            frame=take.first_frame + frame,
            marker=take.markers[marker],
        )
