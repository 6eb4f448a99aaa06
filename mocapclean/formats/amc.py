"""AMC (Acclaim motion capture): joint angles in text, frame by frame, for the bones of an .asf.

The .asf is found beside the file: ``05_13.asf`` or ``05.asf`` for ``05_13.amc``, or the only one in the
folder, or it is given in ``ReadOptions.skeleton``. AMC has no frame rate: ``ReadOptions.rate`` says it, else
120 Hz is assumed.
"""

from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Floats
from mocapclean.errors import FormatError
from mocapclean.formats import asf as skeletons
from mocapclean.formats import poses as kept
from mocapclean.formats.asf import Asf, columns
from mocapclean.formats.poses import MARK, Document, blank, decode, load, numbers, positive, quote
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Finding, Origin, ReadOptions, Take

SUFFIXES = (".amc",)
RATE = 120.0

Ints = NDArray[np.int64]
Words = list[bytes]
write = kept.write


@dataclass(frozen=True, kw_only=True)
class AmcDocument(Document):
    """An AMC text with the skeleton that it moves and the number of its first frame."""

    asf: Asf
    first_frame: int


def sniff(head: bytes) -> bool:
    """Whether a file's first bytes look like Acclaim text."""
    start = head.removeprefix(MARK).lstrip()
    return start[:1] in (b"#", b":") or start[:1].isdigit()


def read(path: Path, options: ReadOptions) -> Take:
    """Read an AMC file as joint positions (F, J, 3) in millimetres; FormatError if it, or its .asf, is
    none."""
    raw = load(path)
    if path.suffix.lower() == ".asf" or skeletons.looks_like_asf(raw):
        raise FormatError(path, "the file must be a take. Got a skeleton (.asf); give the .amc that moves it.")
    place = options.skeleton or find_asf(path)
    document = _parse(path, raw, skeletons.parse(place, load(place)), place.name)
    positions, trusted = kept.joints(document)
    rate = RATE if options.rate is None else positive(options.rate, "the rate")
    return Take(
        positions=positions,
        trusted=trusted,
        markers=document.skeleton.names,
        rate=rate,
        first_frame=document.first_frame,
        skeleton=document.skeleton,
        findings=(
            Finding(
                rule="rate",
                message=f"an AMC file has no frame rate; it is taken as {rate:g} Hz",
                advice="" if options.rate else "give the rate if it is another",
            ),
        ),
        origin=Origin(path=path, format="amc", options=options, document=document),
    )


def read_skeleton(path: Path) -> Skeleton:
    """The joints of an .asf file, in millimetres."""
    return skeletons.parse(path, load(path)).skeleton


def find_asf(path: Path) -> Path:
    """The .asf that belongs to an .amc; FormatError if none in its folder does."""
    try:
        found = {p.stem.lower(): p for p in sorted(path.parent.iterdir()) if p.suffix.lower() == ".asf"}
    except OSError as error:
        raise FormatError(path, f"its folder must be readable. Got {error.strerror}.") from error
    stem = path.stem.lower()
    while stem not in found and "_" in stem:
        stem = stem.rpartition("_")[0]
    if stem not in found and len(found) == 1:
        return next(iter(found.values()))
    if stem not in found:
        raise FormatError(path, f"the skeleton (.asf) must lie beside it. Got {len(found)} others; give it.")
    return found[stem]


def prove(take: Take, path: Path) -> None:
    """Raise FormatError unless ``path`` holds what ``take``, the return of ``write``, says and nothing else
    new."""
    if take.origin is None or not isinstance(take.origin.document, AmcDocument):
        raise ValueError("take must have been read from an AMC file. Got another.")
    asf = take.origin.document.asf
    kept.prove(take, path, lambda raw: _parse(path, raw, asf, "its skeleton"))


def create(skeleton: Skeleton, poses: Floats, path: Path, asf: Path, *, length: float = skeletons.CMU_LENGTH) -> None:
    """Write a new AMC file and its .asf, of poses (F, C) in degrees and millimetres.

    length: the .asf's ``:units length``; 1 unit is 25.4 mm / length. NaN is written as ``nan``. ValueError
    if the skeleton is none that ASF can express.
    """
    asf.write_bytes(skeletons.text(skeleton, length).encode())
    unit = skeletons.INCH / length
    scale = np.array([1.0 if channel.is_rotation else unit for channel in skeleton.channels])
    rows = [
        ("root" if joint == 0 else name, own)
        for joint, name in enumerate(skeleton.names)
        if (own := columns(skeleton, joint))
    ]
    lines = ["#!OML:ASF", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame, pose in enumerate((poses / scale).tolist(), start=1):
        lines.append(str(frame))
        lines += [f"{name} {' '.join(f'{pose[column]:.6f}' for column in own)}" for name, own in rows]
    path.write_bytes("\n".join([*lines, ""]).encode())


def _parse(path: Path, raw: bytes, asf: Asf, asf_name: str) -> AmcDocument:
    lines = blank(raw).splitlines(keepends=True)
    rows = [line.split() for line in lines]
    names = [row.pop(0) if row else b"" for row in rows]
    starts = [index for index, name in enumerate(names) if name.isdigit() and not rows[index]]
    if not starts:
        raise FormatError(path, "an AMC file must have frames, each under its number. Got none.")
    degrees = _degrees(path, names[: starts[0]], asf.degrees)
    first_frame = _first_frame(path, names, starts)
    layouts, widths = _Layouts(path, asf.skeleton, asf_name), list(map(len, rows))
    bodies = pairwise([*starts, len(rows)])
    found = [layouts.of(names[at + 1 : stop], widths[at + 1 : stop], at + 2) for at, stop in bodies]
    values = numbers(path, rows[starts[0] :], range(starts[0] + 1, len(rows) + 1))
    channels = asf.skeleton.channels
    scale = np.array([(1.0 if degrees else 180.0 / np.pi) if c.is_rotation else asf.unit for c in channels])
    order = np.array([layout.order for layout in found])
    table = np.take_along_axis(values.reshape(len(starts), len(channels)), order, axis=1)
    begins = np.cumsum([0, *map(len, lines)])
    return AmcDocument(
        raw=raw,
        skeleton=asf.skeleton,
        scale=scale,
        poses=table * scale,
        starts=np.append(begins[starts], len(raw)),
        places=np.array([layout.places for layout in found]),
        asf=asf,
        first_frame=first_frame,
    )


def _first_frame(path: Path, names: Words, starts: list[int]) -> int:
    """The number of the first frame; FormatError unless the others follow it without a gap."""
    found = [int(names[start]) if len(names[start]) <= 9 else -1 for start in starts]
    for number, start, value in zip(count(max(found[0], 0)), starts, found, strict=False):
        if value != number:
            message = f"frame numbers must be consecutive, here {number}. Got {quote(names[start])}."
            raise FormatError(path, message, line=start + 1)
    return found[0]


def _degrees(path: Path, header: Words, usual: bool) -> bool:
    """Whether the angles are degrees: as the header's last word of it says, else as the .asf does."""
    degrees = usual
    for line, word in enumerate(header, start=1):
        if word and not word.startswith(b":"):
            message = f"a line before the first frame must be a comment or begin with a colon. Got {quote(word)}."
            raise FormatError(path, message, line=line)
        if word.lower() in (b":degrees", b":radians"):
            degrees = word.lower() == b":degrees"
    return degrees


@dataclass(frozen=True, kw_only=True)
class _Layout:
    """Where a frame's block holds the channels: (C,) among its numbers, and (C,) among its tokens."""

    order: Ints
    places: Ints


class _Layouts:
    """The layouts of a file's frames, nearly always one, each worked out once."""

    def __init__(self, path: Path, skeleton: Skeleton, asf_name: str) -> None:
        self.path, self.asf_name = path, asf_name
        self.wanted: dict[str, list[int]] = {}
        for index, channel in enumerate(skeleton.channels):  # in the sequence in which the .asf lists them
            self.wanted.setdefault(skeleton.names[channel.joint], []).append(index)
        self.known: dict[tuple[tuple[bytes, ...], tuple[int, ...]], _Layout] = {}

    def of(self, names: Words, widths: list[int], line: int) -> _Layout:
        """The layout of a frame with these first words, and so many numbers after them, from this line on."""
        shape = tuple(names), tuple(widths)
        if shape not in self.known:
            self.known[shape] = self._work_out(names, widths, line)
        return self.known[shape]

    def _work_out(self, names: Words, widths: list[int], first_line: int) -> _Layout:
        n_channels = sum(map(len, self.wanted.values()))
        order, places = np.full(n_channels, -1), np.full(n_channels, -1)
        value, token = 0, 1  # the frame's own number is the first token
        for line, (name, width) in enumerate(zip(names, widths, strict=True), start=first_line):
            if not name:
                continue
            own = self._channels_of(name, width, line)
            if (order[own] >= 0).any():
                raise FormatError(self.path, f"a frame must have each bone once. Got {quote(name)} again.", line=line)
            order[own] = np.arange(value, value + width)
            places[own] = np.arange(token + 1, token + 1 + width)
            value, token = value + width, token + 1 + width
        missing = [name for name, own in self.wanted.items() if order[own[0]] < 0]
        if missing:
            message = (
                f"a frame must have all {len(self.wanted)} bones that turn in {self.asf_name}. Got none of "
                f"{missing[0]!r}; the file may be cut off, or the .asf another subject's."
            )
            raise FormatError(self.path, message, line=first_line - 1)
        return _Layout(order=order, places=places)

    def _channels_of(self, word: bytes, width: int, line: int) -> list[int]:
        name = decode(word)
        if name not in self.wanted:
            message = f"a bone must be one that turns in {self.asf_name}. Got {quote(word)}; give this subject's .asf."
            raise FormatError(self.path, message, line=line)
        if width != len(self.wanted[name]):
            message = (
                f"{name!r} must have {len(self.wanted[name])} numbers, as in {self.asf_name}. Got {width}; "
                f"the file may be cut off, or the .asf another subject's."
            )
            raise FormatError(self.path, message, line=line)
        return self.wanted[name]
