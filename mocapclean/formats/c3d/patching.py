"""Repair of a C3D file: a copy in which only the words of changed samples differ, and the proof of it."""

import shutil
from dataclasses import replace
from io import BufferedRandom, BufferedReader
from pathlib import Path

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.c3d.document import CHUNK_BYTES, RESIDUAL, WORDS_PER_POINT, C3dDocument
from mocapclean.formats.c3d.words import Raw, present
from mocapclean.take import Finding, Take

INVALID = np.array(-1.0)
"""The residual of an invalid point (C3D user guide, chapter on 3D data)."""


def write(take: Take, path: Path, *, invalidate: bool = False) -> Take:
    """Write a copy of the take's own file in which only the words of changed samples differ; return it as stored.

    A filled sample gets residual 0, the mark of an interpolated point. A moved sample keeps its residual word, because
    it is still measured; that of an exchanged sample goes with it. With ``invalidate``, samples neither trusted nor
    filled keep their coordinates and get the residual -1. Raises FormatError when a filled position does not fit the
    file's numbers or the original file has changed; UsageError when the take has not the frames and markers with which
    it was read.
    """
    document = _kept_document(take)
    shutil.copyfile(document.path, path)
    positions, changed = take.positions.copy(), take.changed
    invalid = ~(take.trusted | take.filled) if invalidate else np.zeros_like(changed)
    with path.open("r+b") as file:
        _check_unchanged(document, file)
        for start, stop in document.spans():
            span = slice(start, stop)
            if changed[span].any() or invalid[span].any():
                raw = document.load(file, start, stop)
                _exchange_residuals(take, document, raw, start)
                _patch(take, document, raw, start, positions[span], changed[span])
                _mark_invalid(document, raw, invalid[span])
                file.seek(document.data_start + start * document.stride)
                file.write(raw.view(np.uint8).data)
    # ``changed`` now lacks the samples that would have been stored as missing.
    lost = take.changed & ~changed
    if not lost.any():
        return replace(take, positions=positions)
    fills = "1 fill" if lost.sum() == 1 else f"{lost.sum()} fills"
    message = f"{fills} would be stored as 0, 0, 0, which means missing, and left out"
    finding = Finding(rule="write", level="warning", message=message)
    return replace(
        take,
        positions=positions,
        trusted=take.trusted & ~lost,
        filled=take.filled & ~lost,
        moved=take.moved & ~lost,
        findings=(*take.findings, finding),
    )


def prove(take: Take, path: Path) -> None:
    """Raise FormatError unless ``path`` is the take's own file except for changed and invalidated samples.

    take: the return of ``write``.
    """
    document = _kept_document(take)
    with document.path.open("rb") as before, path.open("rb") as after:
        _check_unchanged(document, before)
        _check_unchanged(document, after)
        for start, stop in document.spans():
            old, new = document.load(before, start, stop), document.load(after, start, stop)
            # 1. Changed samples hold the take's positions. 2. All other words of the frames are as they were, except
            # that the residual words of exchanged samples are exchanged.
            _check_changed(take, document, path, new, start, stop)
            _exchange_residuals(take, document, old, start)
            _allow_differences(take, document, old, new, start)
            if not np.array_equal(old, new):
                frame, word = (int(i[0]) for i in np.nonzero(old != new))
                at = document.data_start + (start + frame) * document.stride + word * old.itemsize
                raise FormatError(path, "what was not filled must stay as it was. Got another value.", byte=at)
        # 3. The bytes before the first and after the last frame are as they were.
        _check_same_bytes(before, after, len(document.head), document.data_start)
        _check_same_bytes(before, after, document.data_stop, document.size)


def _kept_document(take: Take) -> C3dDocument:
    """Return the document that a take was read with; raise UsageError if the take no longer fits it."""
    document = take.origin.document if take.origin else None
    if not isinstance(document, C3dDocument):
        raise UsageError("a take must come from a C3D file to be written into a copy of it. Got one that does not.")
    shape = document.n_frames, len(document.marker_points())
    if take.trusted.shape != shape:
        raise UsageError(
            f"{document.path}: a take must keep the {shape} frames and markers of its file to be written into a "
            f"copy of it. Got {take.trusted.shape}."
        )
    return document


def _check_unchanged(document: C3dDocument, file: BufferedReader | BufferedRandom) -> None:
    """Raise FormatError unless a file has the size and the head of the file that was read."""
    size = file.seek(0, 2)
    file.seek(0)
    if size != document.size or file.read(len(document.head)) != document.head:
        raise FormatError(
            file.name,
            "the header and size must be those of the file that was read. Got others; read it again.",
        )


def _check_same_bytes(before: BufferedReader, after: BufferedReader, start: int, stop: int) -> None:
    """Raise FormatError unless two files have the same bytes from ``start`` to ``stop``."""
    before.seek(start)
    after.seek(start)
    for at in range(start, stop, CHUNK_BYTES):
        size = min(CHUNK_BYTES, stop - at)
        if before.read(size) != after.read(size):
            raise FormatError(after.name, "what is not a sample must stay as it was. Got other bytes.", byte=at)


def _patch(take: Take, document: C3dDocument, raw: Raw, start: int, positions: Floats, changed: Bools) -> None:
    """Store the changed samples of a run of frames, and set ``positions`` and ``changed`` to the stored values."""
    frames, markers = np.nonzero(changed)
    numbers = positions[frames, markers] / document.factor
    bad = ~(np.abs(numbers) <= document.words.limit).all(axis=-1)
    if bad.any():
        first = int(np.argmax(bad))
        stored_as = "floats" if document.words.is_float else "integers"
        raise FormatError(
            document.path,
            f"a filled position must be finite and within {document.words.limit * document.factor:g} mm, the "
            f"range of the file's {stored_as}. Got {positions[frames[first], markers[first]].tolist()}. "
            "Leave this gap unfilled or export the take to a new file.",
            frame=take.first_frame + start + int(frames[first]),
            marker=take.markers[markers[first]],
        )
    patch = np.zeros((len(numbers), WORDS_PER_POINT), document.words.raw)
    patch[:, :RESIDUAL] = document.words.encode(numbers)
    # A position that rounds to 0, 0, 0 would be read as missing: it is not stored.
    storable = present(document.words.decode(patch))
    changed[frames, markers] = storable
    points, columns = document.points(raw), document.marker_points()[markers]
    moved = (take.moved & ~take.filled)[start + frames, markers]
    patch[moved, RESIDUAL] = points[frames[moved], columns[moved], RESIDUAL]
    points[frames[storable], columns[storable]] = patch[storable]
    stored = document.words.decode(points[frames, columns])
    positions[frames, markers] = stored[:, :RESIDUAL].astype(np.float64) * document.factor


def _mark_invalid(document: C3dDocument, raw: Raw, invalid: Bools) -> None:
    """Set the residual of samples (f, M) to -1, where they are not missing already."""
    frames, markers = np.nonzero(invalid & present(document.samples(raw)))
    document.points(raw)[frames, document.marker_points()[markers], RESIDUAL] = document.words.encode(INVALID)


def _check_changed(take: Take, document: C3dDocument, path: Path, raw: Raw, start: int, stop: int) -> None:
    """Raise FormatError unless the changed samples of a run of frames are stored as the take has them."""
    frames, markers = np.nonzero(take.changed[start:stop])
    stored = document.words.decode(document.points(raw)[frames, document.marker_points()[markers]])
    positions = stored[:, :RESIDUAL].astype(np.float64) * document.factor
    expected = take.positions[start:stop][frames, markers]
    moved = (take.moved & ~take.filled)[start:stop][frames, markers]
    bad = ~((positions == expected).all(axis=-1) & present(stored) & (moved | (stored[:, RESIDUAL] == 0)))
    if bad.any():
        first = int(np.argmax(bad))
        raise FormatError(
            path,
            f"a filled sample must read back as {expected[first].tolist()}. Got {positions[first].tolist()}.",
            frame=take.first_frame + start + int(frames[first]),
            marker=take.markers[markers[first]],
        )


def _exchange_residuals(take: Take, document: C3dDocument, raw: Raw, start: int) -> None:
    """Exchange the residual words of exchanged samples in a run of frames that begins at ``start``, in place."""
    points, columns = document.points(raw), document.marker_points()
    for pair in take.exchanged:
        both = columns[[take.markers.index(pair.first), take.markers.index(pair.second)]]
        frames = slice(max(pair.start - start, 0), max(pair.stop - start, 0))
        points[frames, both, RESIDUAL] = points[frames, both[::-1], RESIDUAL]


def _allow_differences(take: Take, document: C3dDocument, old: Raw, new: Raw, start: int) -> None:
    """Make ``old`` equal ``new`` where they may differ in a run of frames that begins at ``start``.

    These are the words of filled samples, the coordinates of moved ones, and residuals of -1 of untrusted ones.
    """
    span, columns = slice(start, start + len(old)), document.marker_points()
    before, after = document.points(old), document.points(new)
    filled, moved = take.filled[span], take.moved[span]
    frames, markers = np.nonzero(filled)
    before[frames, columns[markers]] = after[frames, columns[markers]]
    frames, markers = np.nonzero(moved & ~filled)
    before[frames, columns[markers], :RESIDUAL] = after[frames, columns[markers], :RESIDUAL]
    is_marked = after[:, document.columns, RESIDUAL] == document.words.encode(INVALID)
    frames, markers = np.nonzero(~(take.trusted[span] | filled) & is_marked)
    before[frames, columns[markers], RESIDUAL] = after[frames, columns[markers], RESIDUAL]
