"""New tables of text: rows of numbers below the header of a maker, read back and compared with the take."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.tables.document import AXES
from mocapclean.formats.text import LARGEST_NUMBER
from mocapclean.take import ReadOptions, Take

DECIMALS = 6
"""Decimals of a millimetre: float32, as in C3D files, has no finer steps from 8 mm on."""
CREATED_MM = 0.5 * 10**-DECIMALS + 1e-9
"""Millimetres between a coordinate of the take and of the new file: half a step of the last decimal, and rounding."""
UNFIT = '\t\r\n",;'
"""Characters that a name in a table must not have, because they delimit cells."""

FirstCells = Callable[[int], Sequence[str]]
"""A function of a frame's index, which returns the cells before its first coordinate."""
Read = Callable[[Path, ReadOptions], Take]


def create_table(
    take: Take,
    path: Path,
    header: Sequence[str],
    first_cells: FirstCells,
    read: Read,
    *,
    delimiter: str,
    missing: str = "",
) -> None:
    """Write a header and a row for each frame, in millimetres, and read the file back.

    missing: the cell of a number of a sample that is neither trusted nor filled. Raises UsageError for a name that no
    cell can hold, FormatError if a position is too large or the file does not read back as the take.
    """
    known = take.trusted | take.filled
    _check(take, path)
    lines = list(header)
    form = delimiter.join([f"%.{DECIMALS}f"] * AXES)
    missing_cells = delimiter.join([missing] * AXES)
    for frame, (row, there) in enumerate(zip(take.positions, known.tolist(), strict=True)):
        samples = zip(row.tolist(), there, strict=True)
        cells = (form % tuple(position) if is_known else missing_cells for position, is_known in samples)
        lines.append(delimiter.join([*first_cells(frame), *cells]))
    path.write_bytes("\n".join([*lines, ""]).encode())
    stored = read(path, ReadOptions(points=take.markers))
    same = stored.markers == take.markers and np.array_equal(stored.trusted, known)
    if not same or not (np.abs(stored.positions - take.positions)[known] <= CREATED_MM).all():
        raise FormatError(path, "a new table must read back as it was written. Got other markers or positions.")


def name_of(take: Take) -> str:
    """Return the name of a take as a header has it: its own file's without suffix, "take" where it has none."""
    stem = take.origin.path.stem if take.origin else "take"
    return "".join(" " if character in UNFIT else character for character in stem)


def _check(take: Take, path: Path) -> None:
    """Raise an error unless a table can hold the names and the known positions of a take."""
    if not take.trusted.size:
        raise UsageError(f"a new table must have frames and markers. Got {take.trusted.shape}.")
    for name in take.markers:
        if name != name.strip() or set(name) & set(UNFIT):
            raise UsageError(f"a name in a table must have no delimiter and no padding. Got {name!r}.")
    outside = (take.trusted | take.filled) & ~(np.abs(take.positions) <= LARGEST_NUMBER).all(axis=2)
    for frame, marker in np.argwhere(outside)[:1]:
        raise FormatError(
            path,
            f"a position must be finite and within {LARGEST_NUMBER:g} mm.",
            frame=take.first_frame + int(frame),
            marker=take.markers[marker],
        )
