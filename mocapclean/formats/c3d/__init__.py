"""C3D: the point block of a file read in place, repaired by patching a copy of it, or made anew.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org).
"""

from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import FormatError
from mocapclean.formats.c3d.document import RESIDUAL, WORDS_PER_POINT, C3dDocument
from mocapclean.formats.c3d.header import (
    BLOCK,
    MAGIC,
    MOST_COUNT,
    halves,
    read_header,
)
from mocapclean.formats.c3d.layout import find_layout
from mocapclean.formats.c3d.patching import prove, write
from mocapclean.formats.c3d.points import choose_markers, frame_rate, millimetres_per_unit, point_names, step
from mocapclean.formats.c3d.words import INTEL, Words, present
from mocapclean.formats.contract import Declaration
from mocapclean.take import Finding, Origin, ReadOptions, Take

__all__ = ["DECLARATION", "C3dDocument", "create", "prove", "read", "sniff", "write"]

MOST_NAME_BYTES = 255
"""The longest label: the length of a parameter's text is one byte."""

DECLARATION = Declaration(
    suffixes=(".c3d",), columns="markers", stores="positions", marks_missing=True, lists_points=True
)


def sniff(head: bytes) -> bool:
    """Whether a file's first 512 bytes can be a C3D header."""
    return len(head) >= BLOCK and head[1] == MAGIC and b"\0" in head


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a C3D file, in millimetres.

    Raises FormatError when the file is none, is cut off, or has no markers or frames; UsageError when
    ``options.points`` names a point that it does not have.
    """
    header = read_header(path)
    layout, layout_findings = find_layout(path, header)
    names, name_findings = point_names(header, layout.n_points)
    columns, point_findings = choose_markers(path, header, names, options)
    rate, rate_findings = frame_rate(path, header, options)
    unit, unit_findings = millimetres_per_unit(header, options)
    scale, scale_findings = step(header, layout.words.is_float)
    document = C3dDocument(
        path=path,
        size=header.size,
        head=header.head[: layout.data_start],
        words=layout.words,
        data_start=layout.data_start,
        n_points=layout.n_points,
        n_words=layout.n_words,
        n_frames=layout.n_frames,
        columns=_as_slice(columns),
        factor=scale * unit,
    )
    positions, trusted = _read_samples(document, len(columns))
    if not trusted.any():
        message = f"All {trusted.size} samples are marked missing, so there is nothing to trust."
        name_findings.append(Finding(rule="missing", level="warning", message=message))
    return Take(
        positions=positions,
        trusted=trusted,
        markers=tuple(names[i] for i in columns),
        rate=rate,
        first_frame=layout.first_frame,
        findings=(*layout_findings, *rate_findings, *unit_findings, *scale_findings, *name_findings, *point_findings),
        origin=Origin(
            path=path, format="c3d", options=options, document=document, largest=document.words.limit * document.factor
        ),
    )


def create(take: Take, path: Path) -> None:
    """Write a new C3D file of floats, in millimetres, and read it back; samples neither trusted nor filled are missing.

    Raises FormatError when there are more than 65535 frames, or a name or position does not fit.
    """
    known = take.trusted | take.filled
    known_positions = np.where(known[..., None], take.positions, 0.0)
    _check_new(take, known_positions, path)
    import ezc3d  # takes long to import, and only new files need it

    n_frames, n_markers = known.shape
    points = np.ones((WORDS_PER_POINT, n_markers, n_frames))
    points[:RESIDUAL] = known_positions.transpose(2, 1, 0)
    first = max(take.first_frame, 1)
    last = first + n_frames - 1
    file: Any = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = first - 1
    file["parameters"]["POINT"]["RATE"]["value"] = [take.rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(take.markers)
    if last > MOST_COUNT:  # the header's 16 bits do not hold the numbers of these frames
        file.add_parameter("TRIAL", "ACTUAL_START_FIELD", halves(first))
        file.add_parameter("TRIAL", "ACTUAL_END_FIELD", halves(last))
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.where(known, 0.0, -1.0).T[None]
    try:
        file.write(str(path))
    except (RuntimeError, ValueError, TypeError, KeyError, IndexError) as fault:
        raise FormatError(path, f"ezc3d cannot write the new file: {str(fault).splitlines()[0]}") from None
    stored = read(path, ReadOptions(points=take.markers))
    if stored.markers != take.markers or not np.array_equal(stored.positions, known_positions.astype(np.float32)):
        raise FormatError(path, "a new C3D file must read back as it was written. Got other markers or positions.")


def _check_new(take: Take, positions: Floats, path: Path) -> None:
    """Raise FormatError unless a new file can hold the frames, the names and the positions (F, M, 3)."""
    n_frames, n_markers = take.trusted.shape
    if not (0 < n_frames <= MOST_COUNT and n_markers > 0):
        got = f"{n_frames} frames of {n_markers} markers"
        raise FormatError(path, f"a new C3D file must have 1 to {MOST_COUNT} frames and some markers. Got {got}.")
    for name in take.markers:
        if name != name.strip() or not 0 < len(name.encode()) <= MOST_NAME_BYTES or "\0" in name:
            message = f"a marker's name must be 1 to {MOST_NAME_BYTES} bytes without padding. Got {name!r}."
            raise FormatError(path, message)
    limit = Words(machine=INTEL, is_float=True).limit
    outside = np.argwhere(~(np.abs(positions) <= limit))
    if len(outside):
        frame, marker, axis = outside[0]
        raise FormatError(
            path,
            f"a position must be finite and within {limit:g} mm. Got {positions[frame, marker, axis]}.",
            frame=take.first_frame + int(frame),
            marker=take.markers[marker],
        )


def _as_slice(columns: list[int]) -> Any:
    """Return ascending indices as a slice where they adjoin, which numpy reads as a view, else as an array."""
    adjoin = columns == list(range(columns[0], columns[-1] + 1))
    return slice(columns[0], columns[-1] + 1) if adjoin else np.array(columns)


def _read_samples(document: C3dDocument, n_markers: int) -> tuple[Floats, Bools]:
    """Return the positions (F, M, 3) in millimetres and the trust (F, M) of the markers."""
    positions = np.empty((document.n_frames, n_markers, 3))
    trusted = np.empty((document.n_frames, n_markers), dtype=bool)
    with document.path.open("rb") as file, np.errstate(invalid="ignore"):
        for start, stop in document.spans():
            samples = document.samples(document.load(file, start, stop))
            for axis in range(3):
                positions[start:stop, :, axis] = samples[..., axis]
            if document.factor != 1.0:
                positions[start:stop] *= document.factor
            trusted[start:stop] = present(samples)
    return positions, trusted
