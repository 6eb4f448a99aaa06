"""C3D: the point block of a file read in place, repaired by patching a copy of it, or made anew.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import FormatError
from mocapclean.formats.c3d.document import RESIDUAL, WORDS_PER_POINT, C3dDocument
from mocapclean.formats.c3d.events import SECONDS_PER_MINUTE, events
from mocapclean.formats.c3d.header import BLOCK, MAGIC, MOST_COUNT, halves, read_header
from mocapclean.formats.c3d.layout import find_layout
from mocapclean.formats.c3d.outdated import outdated
from mocapclean.formats.c3d.patching import prove, write
from mocapclean.formats.c3d.point_kinds import MOVES_ALONE, kinds_by_name
from mocapclean.formats.c3d.points import frame_rate, millimetres_per_unit, named_markers, point_names, step
from mocapclean.formats.c3d.selection import as_columns, select_markers
from mocapclean.formats.c3d.words import INTEL, Words
from mocapclean.formats.declarations import FIRST_FRAME
from mocapclean.take import Event, Origin, ReadOptions, Take
from mocapclean.take.names import split_subject

__all__ = ["C3dDocument", "create", "events", "outdated", "prove", "read", "sniff", "write"]

MOST_NAME_BYTES = 255
"""The longest label: the length of a parameter's text is one byte."""


def sniff(head: bytes) -> bool:
    """Whether a file's first 512 bytes can be a C3D header."""
    return len(head) >= BLOCK and head[1] == MAGIC and b"\0" in head


def read(path: Path, options: ReadOptions) -> Take:
    """Return the markers of a C3D file, in millimetres.

    Raises FormatError when the file is none, is cut off, or has no markers or frames; UsageError when
    ``options.points`` names a point that it does not have.
    """
    header = read_header(path)
    layout, findings = find_layout(path, header)
    labels, names, name_findings = point_names(header, layout.n_points)
    kinds = kinds_by_name(labels, header.parameters)
    columns = named_markers(path, names, kinds, options)
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
        columns=as_columns(columns),
        factor=scale * unit,
        names=tuple(names),
    )
    markers = select_markers(document, kinds, asked=options.points)
    samples, columns = markers.samples, markers.columns
    findings += [*rate_findings, *unit_findings, *scale_findings, *name_findings, *markers.findings]
    return Take(
        positions=samples.positions,
        trusted=samples.trusted,
        markers=tuple(names[i] for i in columns),
        detached=np.array([markers.kinds[i] in MOVES_ALONE for i in columns]),
        rate=rate,
        first_frame=layout.first_frame,
        findings=tuple(findings),
        origin=Origin(
            path=path,
            format="c3d",
            options=options,
            document=markers.document,
            largest=document.words.limit * document.factor,
        ),
    )


def create(take: Take, path: Path, happened: Sequence[Event] = ()) -> None:
    """Write a new C3D file of floats, in millimetres, and read it back; samples neither trusted nor filled are missing.

    Subjects that the names have as prefixes are listed in the group SUBJECTS, events in the group EVENT.
    Raises FormatError when there are more than 65535 frames, or a name or position does not fit.
    """
    known = take.trusted | take.filled
    known_positions = np.where(known[..., None], take.positions, 0.0)
    _check_new(take, known_positions, path)
    import ezc3d  # takes long to import, and only new files need it

    n_frames, n_markers = known.shape
    points = np.ones((WORDS_PER_POINT, n_markers, n_frames))
    points[:RESIDUAL] = known_positions.transpose(2, 1, 0)
    first = max(take.first_frame, FIRST_FRAME)
    last = first + n_frames - 1
    file: Any = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = first - 1
    file["parameters"]["POINT"]["RATE"]["value"] = [take.rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(take.markers)
    if last > MOST_COUNT:  # the header's 16 bits do not hold the numbers of these frames
        file.add_parameter("TRIAL", "ACTUAL_START_FIELD", halves(first))
        file.add_parameter("TRIAL", "ACTUAL_END_FIELD", halves(last))
    _add_subjects(file, take.markers)
    _add_events(file, first, take.rate, happened)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.where(known, 0.0, -1.0).T[None]
    try:
        file.write(str(path))
    except (RuntimeError, ValueError, TypeError, KeyError, IndexError) as fault:
        raise FormatError(path, f"ezc3d cannot write the new file: {str(fault).splitlines()[0]}") from None
    stored = read(path, ReadOptions(points=take.markers))
    if stored.markers != take.markers or not np.array_equal(stored.positions, known_positions.astype(np.float32)):
        raise FormatError(path, "a new C3D file must read back as it was written. Got other markers or positions.")


def _add_subjects(file: Any, markers: Sequence[str]) -> None:
    """List in a new file the subjects that markers have as prefixes (C3D user guide, the group SUBJECTS)."""
    subjects = [subject for subject in dict.fromkeys(split_subject(name)[0] for name in markers) if subject]
    if subjects:
        file.add_parameter("SUBJECTS", "IS_STATIC", [0])
        file.add_parameter("SUBJECTS", "USES_PREFIXES", [1])
        file.add_parameter("SUBJECTS", "USED", [len(subjects)])
        file.add_parameter("SUBJECTS", "NAMES", subjects)
        file.add_parameter("SUBJECTS", "LABEL_PREFIXES", [f"{subject}:" for subject in subjects])


def _add_events(file: Any, first_frame: int, rate: float, happened: Sequence[Event]) -> None:
    """Add events to a new file, with minutes and seconds from frame 1 on (C3D user guide, the group EVENT)."""
    if not happened:
        return
    seconds = np.array([(event.frame + first_frame - 1) / rate for event in happened])
    file.add_parameter("EVENT", "USED", [len(happened)])
    file.add_parameter("EVENT", "TIMES", np.stack([seconds // SECONDS_PER_MINUTE, seconds % SECONDS_PER_MINUTE]))
    file.add_parameter("EVENT", "LABELS", [event.label for event in happened])
    file.add_parameter("EVENT", "CONTEXTS", [event.context for event in happened])


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
