"""Where the samples of a C3D file are, and the raw words of its frames.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapter on 3D data: every frame is four
words a point (x, y, z, residual) followed by its analog samples. A residual of 0 marks an interpolated point, -1 an
invalid point.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BufferedRandom, BufferedReader
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.errors import FormatError
from mocapclean.formats.c3d.words import Raw, Words

CHUNK_BYTES = 1 << 18
"""Bytes that are read at a time: bounds the memory. Chosen by hand; no sweep was kept."""
WORDS_PER_POINT = 4  # x, y, z and the residual (C3D user guide, 3D data)
RESIDUAL = 3
"""Index of the residual among the words of a point."""


@dataclass(frozen=True, kw_only=True)
class C3dDocument:
    """Where the samples are in a file, and the bytes before them.

    size: bytes of the file. head: the bytes before the first frame. words: the encoding of the points. data_start:
    byte of frame 0. n_words: words per frame. columns: indices of the markers among the points, as a slice where they
    adjoin. factor: millimetres per stored unit. names: of all points. computed, quantities: indices of the points, no
    markers, that are computed from others: places, and angles, forces or the like.
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
    names: tuple[str, ...] = ()
    computed: tuple[int, ...] = ()
    quantities: tuple[int, ...] = ()

    @property
    def carried(self) -> tuple[str, ...]:
        """The names of the points that are no markers."""
        markers = set(self.marker_points().tolist())
        return tuple(name for i, name in enumerate(self.names) if i not in markers)

    @property
    def others(self) -> tuple[str, ...]:
        """What the file has beside the positions of its points, in words."""
        n_analog = self.n_words - WORDS_PER_POINT * self.n_points
        analog = (f"{n_analog} analog samples per frame",) if n_analog else ()
        return (*analog, "residuals and cameras of the samples", "parameters other than names, rate and unit")

    @property
    def stride(self) -> int:
        """Bytes per frame."""
        return self.n_words * self.words.raw.itemsize

    @property
    def data_stop(self) -> int:
        """The byte after the last frame."""
        return self.data_start + self.n_frames * self.stride

    def spans(self) -> Iterator[tuple[int, int]]:
        """Yield consecutive runs of frames (start, stop) of about a quarter of a megabyte."""
        step = max(1, CHUNK_BYTES // self.stride)
        for start in range(0, self.n_frames, step):
            yield start, min(start + step, self.n_frames)

    def load(self, file: BufferedReader | BufferedRandom, start: int, stop: int) -> Raw:
        """Return the raw words (stop - start, n_words) of some frames."""
        raw = np.empty((stop - start, self.n_words), self.words.raw)
        file.seek(self.data_start + start * self.stride)
        if file.readinto(raw.view(np.uint8).data) != raw.nbytes:
            raise FormatError(self.path, "the file must not change while it is read. Got fewer bytes than before.")
        return raw

    def points(self, raw: Raw) -> Raw:
        """Return the view (frames, n_points, 4) of the raw words of all points."""
        return raw[:, : WORDS_PER_POINT * self.n_points].reshape(len(raw), self.n_points, WORDS_PER_POINT)

    def samples(self, raw: Raw) -> NDArray[Any]:
        """Return the stored numbers (frames, markers, 4) of the markers."""
        return self.words.decode(self.points(raw)[:, self.columns])

    def marker_points(self) -> NDArray[np.intp]:
        """Return the indices (markers,) of the markers among the points."""
        return np.arange(self.n_points)[self.columns]
