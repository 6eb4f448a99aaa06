"""C3D: the point block of a file read in place, and repaired by patching a copy of it.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapter on 3D data: every frame is
four words a point (x, y, z, residual) followed by its analog samples. A residual of 0 marks an interpolated point,
-1 an invalid one.
"""

import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from io import BufferedRandom, BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.c3d.header import BLOCK, MAGIC, Header, read_header
from mocapclean.formats.c3d.points import choose_markers, count_frames, frame_rate, millimetres_per_unit, point_names
from mocapclean.formats.c3d.words import INTEL, Raw, Words, present
from mocapclean.formats.contract import Declaration
from mocapclean.take import Finding, Origin, ReadOptions, Take

DECLARATION = Declaration(
    suffixes=(".c3d",), columns="markers", stores="positions", marks_missing=True, lists_points=True
)
CHUNK = 1 << 18


@dataclass(frozen=True, kw_only=True)
class C3dDocument:
    """Where the samples are in the file, and the bytes before them.

    data_start: byte of frame 0. n_words: words per frame. columns: the markers' places among the points, as a
    slice where they adjoin. factor: millimetres per stored unit.
    """

    path: Path
    size: int
    head: bytes = field(repr=False)
    words: Words
    data_start: int
    n_points: int
    n_words: int
    n_frames: int
    columns: slice | NDArray[np.intp]
    factor: float

    @property
    def stride(self) -> int:
        """Bytes per frame."""
        return self.n_words * self.words.raw.itemsize

    def spans(self) -> Iterator[tuple[int, int]]:
        """Consecutive runs of frames (start, stop) of about a quarter of a megabyte."""
        step = max(1, CHUNK // self.stride)
        for start in range(0, self.n_frames, step):
            yield start, min(start + step, self.n_frames)

    def load(self, file: BufferedReader | BufferedRandom, start: int, stop: int) -> Raw:
        """The raw words (stop - start, n_words) of some frames."""
        raw = np.empty((stop - start, self.n_words), self.words.raw)
        file.seek(self.data_start + start * self.stride)
        if file.readinto(raw.view(np.uint8).data) != raw.nbytes:
            raise FormatError(self.path, "the file must not change while it is read. Got fewer bytes than before.")
        return raw

    def points(self, raw: Raw) -> Raw:
        """The view (frames, n_points, 4) of the raw words of all points."""
        return raw[:, : 4 * self.n_points].reshape(len(raw), self.n_points, 4)

    def samples(self, raw: Raw) -> NDArray[Any]:
        """The stored numbers (frames, markers, 4) of the markers."""
        return self.words.decode(self.points(raw)[:, self.columns])

    def places(self) -> NDArray[np.intp]:
        """The markers' places among the points."""
        return np.arange(self.n_points)[self.columns]


def sniff(head: bytes) -> bool:
    """Whether a file's first 512 bytes can be a C3D header."""
    return len(head) >= BLOCK and head[1] == MAGIC and b"\0" in head


def read(path: Path, options: ReadOptions) -> Take:
    """The markers of a C3D file, in millimetres.

    Raises FormatError when the file is none, is cut off, or has no markers or frames; UsageError when
    ``options.points`` names a point that it does not have.
    """
    header = read_header(path)
    if header.n_points == 0:
        raise FormatError(path, "a take must have points. Got none: the file has no points, only analog channels.")
    names, findings = point_names(header)
    columns, others = choose_markers(path, header, names, options)
    rate, told_rate = frame_rate(path, header, options)
    unit, told_unit = millimetres_per_unit(header, options)
    scale, told_scale = _scale(path, header)
    words = Words(machine=header.machine, is_float=scale < 0)
    n_words = 4 * header.n_points + header.n_analog
    n_frames, first_frame, told_frames = count_frames(path, header, n_words * words.raw.itemsize)
    is_run = columns == list(range(columns[0], columns[-1] + 1))
    document = C3dDocument(
        path=path,
        size=header.size,
        head=header.head,
        words=words,
        data_start=header.data_start,
        n_points=header.n_points,
        n_words=n_words,
        n_frames=n_frames,
        columns=slice(columns[0], columns[-1] + 1) if is_run else np.array(columns),
        factor=unit if words.is_float else scale * unit,
    )
    if document.data_start <= header.section < document.data_start + n_frames * document.stride:
        message = f"the point data must not lie over the parameter section. It starts at byte {document.data_start}."
        raise FormatError(path, message, byte=header.section)
    positions, trusted = _read_samples(document, len(columns))
    if not trusted.any():
        message = f"All {trusted.size} samples are marked missing, so there is nothing to trust."
        findings.append(Finding(rule="missing", level="warning", message=message))
    return Take(
        positions=positions,
        trusted=trusted,
        markers=tuple(names[i] for i in columns),
        rate=rate,
        first_frame=first_frame,
        findings=(*told_frames, *told_rate, *told_unit, *told_scale, *findings, *others),
        origin=Origin(
            path=path, format="c3d", options=options, document=document, largest=document.words.limit * document.factor
        ),
    )


def write(take: Take, path: Path, *, invalidate: bool = False) -> Take:
    """A copy of the take's own file at ``path`` in which only the four words of filled samples differ.

    A moved sample keeps its fourth word, because it is still a measured one.
    With ``invalidate``, samples neither trusted nor filled keep their coordinates and get the residual word -1.
    Raises FormatError when a filled position does not fit the file's numbers or the original file has changed;
    UsageError when the take has not the frames and markers it was read with.
    """
    document = _document(take)
    shutil.copyfile(document.path, path)
    positions, changed = take.positions.copy(), take.changed
    doubted = ~(take.trusted | take.filled) if invalidate else np.zeros_like(changed)
    with path.open("r+b") as file:
        _check_unchanged(document, file)
        for start, stop in document.spans():
            span = slice(start, stop)
            if changed[span].any() or doubted[span].any():
                raw = document.load(file, start, stop)
                _patch(take, document, raw, start, positions[span], changed[span])
                _invalidate(document, raw, doubted[span])
                file.seek(document.data_start + start * document.stride)
                file.write(raw.view(np.uint8).data)
    lost = take.changed & ~changed
    if not lost.any():
        return replace(take, positions=positions)
    message = f"{lost.sum()} fills would be stored as 0, 0, 0, which means missing, and were left out."
    finding = Finding(rule="write", level="warning", message=message)
    trusted = take.trusted & ~lost
    findings = (*take.findings, finding)
    filled, moved = take.filled & ~lost, take.moved & ~lost
    return replace(take, positions=positions, trusted=trusted, filled=filled, moved=moved, findings=findings)


def prove(take: Take, path: Path) -> None:
    """Raise FormatError unless ``path`` is the take's own file except for filled and invalidated samples."""
    document = _document(take)
    with document.path.open("rb") as before, path.open("rb") as after:
        _check_unchanged(document, before)
        _check_unchanged(document, after)
        for start, stop in document.spans():
            old, new = document.load(before, start, stop), document.load(after, start, stop)
            span = slice(start, stop)
            _check_filled(take, document, path, new, start, stop)
            _forgive(document, old, new, take.changed[span], ~(take.trusted[span] | take.filled[span]))
            if not np.array_equal(old, new):
                frame, word = (int(i[0]) for i in np.nonzero(old != new))
                at = document.data_start + (start + frame) * document.stride + word * old.itemsize
                raise FormatError(path, "what was not filled must stay as it was. Got another value.", byte=at)
        _check_same(before, after, len(document.head), document.data_start)
        _check_same(before, after, document.data_start + document.n_frames * document.stride, document.size)


def create(take: Take, path: Path) -> None:
    """A brand-new float C3D file, in millimetres, of the trusted or filled samples; the others are missing in it.

    Raises FormatError when there are more than 65535 frames, or a name or position does not fit.
    """
    known = take.trusted | take.filled
    known_positions = np.where(known[..., None], take.positions, 0.0)
    _check_new(take, known_positions, path)
    import ezc3d  # takes long to import, and only new files need it

    n_frames, n_markers = known.shape
    points = np.ones((4, n_markers, n_frames))
    points[:3] = known_positions.transpose(2, 1, 0)
    first = max(take.first_frame, 1)
    last = first + n_frames - 1
    file: Any = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = first - 1
    file["parameters"]["POINT"]["RATE"]["value"] = [take.rate]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(take.markers)
    if last > 65535:
        file.add_parameter("TRIAL", "ACTUAL_START_FIELD", [first % 65536, first // 65536])
        file.add_parameter("TRIAL", "ACTUAL_END_FIELD", [last % 65536, last // 65536])
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
    n_frames, n_markers = take.trusted.shape
    if not (0 < n_frames <= 65535 and n_markers > 0):
        got = f"{n_frames} frames of {n_markers} markers"
        raise FormatError(path, f"a new C3D file must have 1 to 65535 frames and some markers. Got {got}.")
    for name in take.markers:
        if name != name.strip() or not 0 < len(name.encode()) <= 255 or "\0" in name:
            raise FormatError(path, f"a marker's name must be 1 to 255 bytes without padding. Got {name!r}.")
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


def _scale(path: Path, header: Header) -> tuple[float, list[Finding]]:
    """The header's scale factor, negative for floats, or else POINT:SCALE."""
    listed = header.parameters.numbers("POINT:SCALE")[:1]
    usable = [scale for scale in (header.scale, *listed) if math.isfinite(scale) and scale != 0]
    if not usable:
        raise FormatError(path, f"the scale factor must be finite and not 0. Got {header.scale:g}.", byte=12)
    if usable[0] < 0 or not listed or math.isclose(usable[0], listed[0], rel_tol=1e-5):
        return usable[0], []
    message = f"POINT:SCALE should be the header's scale. Got {listed[0]:g} and {usable[0]:g}, which was used."
    advice = "Compare a known distance."
    return usable[0], [Finding(rule="scale", level="warning", message=message, advice=advice)]


def _read_samples(document: C3dDocument, n_markers: int) -> tuple[Floats, Bools]:
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


def _document(take: Take) -> C3dDocument:
    document = take.origin.document if take.origin else None
    if not isinstance(document, C3dDocument):
        raise UsageError("a take must come from a C3D file to be written into a copy of it. Got one that does not.")
    shape = document.n_frames, len(document.places())
    if take.trusted.shape != shape:
        raise UsageError(
            f"{document.path}: a take must keep the {shape} frames and markers of its file to be written into a "
            f"copy of it. Got {take.trusted.shape}."
        )
    return document


def _check_unchanged(document: C3dDocument, file: BufferedReader | BufferedRandom) -> None:
    size = file.seek(0, 2)
    file.seek(0)
    if size != document.size or file.read(len(document.head)) != document.head:
        raise FormatError(
            file.name,
            "the header and size must be those of the file that was read. Got others; read it again.",
        )


def _check_same(before: BufferedReader, after: BufferedReader, start: int, stop: int) -> None:
    """Raise FormatError unless two files have the same bytes from ``start`` to ``stop``."""
    before.seek(start)
    after.seek(start)
    for at in range(start, stop, CHUNK):
        size = min(CHUNK, stop - at)
        if before.read(size) != after.read(size):
            raise FormatError(after.name, "what is not a sample must stay as it was. Got other bytes.", byte=at)


def _patch(take: Take, document: C3dDocument, raw: Raw, start: int, positions: Floats, changed: Bools) -> None:
    """Store the changed samples of a run of frames, and set ``positions`` and ``changed`` to what was stored."""
    frames, markers = np.nonzero(changed)
    numbers = positions[frames, markers] / document.factor
    bad = ~(np.abs(numbers) <= document.words.limit).all(axis=-1)
    if bad.any():
        first = int(np.argmax(bad))
        kind = "floats" if document.words.is_float else "integers"
        raise FormatError(
            document.path,
            f"a filled position must be finite and within {document.words.limit * document.factor:g} mm, the "
            f"range of the file's {kind}. Got {positions[frames[first], markers[first]].tolist()}. "
            "Leave this gap unfilled or export the take to a new file.",
            frame=take.first_frame + start + int(frames[first]),
            marker=take.markers[markers[first]],
        )
    patch = np.zeros((len(numbers), 4), document.words.raw)
    patch[:, :3] = document.words.encode(numbers)
    kept = present(document.words.decode(patch))
    changed[frames, markers] = kept
    points, places = document.points(raw), document.places()[markers]
    still = take.moved[start + frames, markers]
    patch[still, 3] = points[frames[still], places[still], 3]
    points[frames[kept], places[kept]] = patch[kept]
    stored = document.words.decode(points[frames, places])
    positions[frames, markers] = stored[:, :3].astype(np.float64) * document.factor


def _invalidate(document: C3dDocument, raw: Raw, doubted: Bools) -> None:
    frames, markers = np.nonzero(doubted & present(document.samples(raw)))
    document.points(raw)[frames, document.places()[markers], 3] = document.words.encode(np.array(-1.0))


def _check_filled(take: Take, document: C3dDocument, path: Path, raw: Raw, start: int, stop: int) -> None:
    """Raise FormatError unless the filled samples of a run of frames are stored as the take has them."""
    frames, markers = np.nonzero(take.changed[start:stop])
    stored = document.words.decode(document.points(raw)[frames, document.places()[markers]])
    positions = stored[:, :3].astype(np.float64) * document.factor
    expected = take.positions[start:stop][frames, markers]
    measured = take.moved[start:stop][frames, markers]
    bad = ~((positions == expected).all(axis=-1) & present(stored) & (measured | (stored[:, 3] == 0)))
    if bad.any():
        first = int(np.argmax(bad))
        raise FormatError(
            path,
            f"a filled sample must read back as {expected[first].tolist()}. Got {positions[first].tolist()}.",
            frame=take.first_frame + start + int(frames[first]),
            marker=take.markers[markers[first]],
        )


def _forgive(document: C3dDocument, old: Raw, new: Raw, filled: Bools, doubted: Bools) -> None:
    """Make ``old`` equal ``new`` where they may differ: filled samples, and -1 residuals of doubted ones."""
    places = document.places()
    before, after = document.points(old), document.points(new)
    frames, markers = np.nonzero(filled)
    before[frames, places[markers]] = after[frames, places[markers]]
    is_marked = after[:, document.columns, 3] == document.words.encode(np.array(-1.0))
    frames, markers = np.nonzero(doubted & is_marked)
    before[frames, places[markers], 3] = after[frames, places[markers], 3]
