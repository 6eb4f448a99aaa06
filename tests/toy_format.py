"""A format of a few lines of text, which keeps the contract of all formats and is made for tests alone.

The first line holds the rate and the number of the first frame, the second the names. Every other line is a frame: a
triple x,y,z in millimetres, or ? where the sample is missing, for each marker.
"""

from dataclasses import replace

import numpy as np

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.contract import Declaration
from mocapclean.take import Origin, Take

MISSING = "?"


class ToyFormat:
    """The functions of a format module, as methods."""

    DECLARATION = Declaration(suffixes=(".toy",), columns="markers", stores="positions", marks_missing=True)

    def sniff(self, head):
        return head.startswith(b"TOY ")

    def read(self, path, options):
        lines = path.read_text().splitlines()
        _, rate, first_frame = lines[0].split()
        names = tuple(lines[1].split())
        cells = [line.split() for line in lines[2:]]
        if any(len(row) != len(names) for row in cells):
            raise FormatError(path, f"a frame must have {len(names)} samples.")
        trusted = np.array([[cell != MISSING for cell in row] for row in cells])
        positions = np.array([[position(cell) for cell in row] for row in cells])
        origin = Origin(path=path, format="toy", options=options, document=path.read_text())
        return Take(
            positions=positions,
            trusted=trusted,
            markers=names,
            rate=float(rate),
            first_frame=int(first_frame),
            origin=origin,
        )

    def write(self, take, path, *, invalidate=False):
        header, cells = self._kept(take)
        positions = take.positions.copy()
        for frame, marker in np.argwhere(take.changed):
            cells[frame][marker] = spelled(positions[frame, marker])
            positions[frame, marker] = position(cells[frame][marker])
        for frame, marker in np.argwhere(~take.trusted & ~take.changed & invalidate):
            cells[frame][marker] = MISSING
        path.write_text("\n".join([*header, *map(" ".join, cells), ""]))
        return replace(take, positions=positions)

    def prove(self, take, path):
        header, cells = self._kept(take)
        lines = path.read_text().splitlines()
        if lines[:2] != header or len(lines) != 2 + len(cells):
            raise FormatError(path, "the header and the number of frames must stay as they were.")
        for frame, line in enumerate(lines[2:]):
            for marker, cell in enumerate(line.split()):
                expected = (
                    spelled(take.positions[frame, marker]) if take.changed[frame, marker] else cells[frame][marker]
                )
                if cell != expected and (cell != MISSING or take.trusted[frame, marker]):
                    raise FormatError(path, "only changed samples must differ.", frame=take.first_frame + frame)

    def create(self, take, path):
        if not len(take.positions):
            raise UsageError("a take must have frames.")
        known = take.trusted | take.filled
        rows = [
            " ".join(spelled(p) if k else MISSING for p, k in zip(row, there, strict=True))
            for row, there in zip(take.positions, known, strict=True)
        ]
        path.write_text("\n".join([f"TOY {take.rate!r} {take.first_frame}", " ".join(take.markers), *rows, ""]))

    def _kept(self, take):
        lines = take.origin.document.splitlines()
        return lines[:2], [line.split() for line in lines[2:]]


def position(cell):
    return [np.nan] * 3 if cell == MISSING else [float(number) for number in cell.split(",")]


def spelled(place):
    return ",".join(f"{number:.4f}" for number in place)
