"""AMC (Acclaim motion capture): joint angles in text, frame by frame, for the bones of an ASF skeleton.

Source: M. Schafer, Acclaim Skeleton File Definition V1.10 (1994-95), which defines ASF and AMC together. A frame is its
number on a line, then a line for the root and each bone that turns, with the bone's channels in the order of its
``dof``. The .asf is found beside the file (``skeleton_files.find_skeleton``) or given in ``ReadOptions.skeleton``. AMC
has no frame rate: ``ReadOptions.rate`` gives it, else 120 Hz is assumed.
"""

from dataclasses import dataclass
from itertools import count, pairwise
from pathlib import Path

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.errors import FormatError
from mocapclean.formats import asf as skeletons
from mocapclean.formats import poses as kept
from mocapclean.formats.alike import MOST_DIGITS, frames_alike
from mocapclean.formats.asf import Asf, columns
from mocapclean.formats.declarations import AMC_RATE, ASF_SUFFIX
from mocapclean.formats.poses import PoseDocument
from mocapclean.formats.skeleton_files import find_skeleton, is_named_for
from mocapclean.formats.text import BYTE_ORDER_MARK, blank, decode, load, numbers, positive, quick_table, quote
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Finding, Origin, ReadOptions, Take
from mocapclean.take.posed import posed, posed_take

CREATED_DECIMALS = 6
"""Decimals of a created file's numbers, degrees and ASF units. Chosen by hand, as the BVH files have them."""

Words = list[bytes]

write, prove = kept.write, kept.prove


@dataclass(frozen=True, kw_only=True)
class AmcDocument(PoseDocument):
    """An AMC text with the ASF skeleton of its bones and the number of its first frame."""

    asf: Asf
    first_frame: int


def sniff(head: bytes) -> bool:
    """Whether a file's first bytes can begin Acclaim text: a comment, a keyword or a frame number."""
    start = head.removeprefix(BYTE_ORDER_MARK).lstrip()
    return start[:1] in (b"#", b":") or start[:1].isdigit()


def read(path: Path, options: ReadOptions) -> Take:
    """Return the take of an AMC file: joint positions (F, J, 3) in millimetres, and the poses.

    Raises FormatError with the line where the text is not AMC or the text of its skeleton is not ASF, and where no
    skeleton is found.
    """
    raw = load(path)
    if path.suffix.lower() == ASF_SUFFIX or skeletons.is_skeleton_text(raw):
        raise FormatError(path, "the file must be a take. Got a skeleton (.asf); give the .amc that moves it.")
    asf_path = options.skeleton or find_skeleton(path, ASF_SUFFIX)
    document = _parse(path, raw, skeletons.parse(asf_path, load(asf_path)), asf_path.name)
    rate = AMC_RATE if options.rate is None else positive(options.rate, "the rate")
    return posed_take(
        document.skeleton,
        document.poses,
        rate,
        first_frame=document.first_frame,
        findings=(
            Finding(
                rule="rate",
                message=f"an AMC file has no frame rate; it is taken as {rate:g} Hz",
                advice="" if options.rate else "give the rate (--rate) if it is another",
            ),
            *([] if options.skeleton or is_named_for(asf_path, path) else [_guessed_skeleton(asf_path)]),
        ),
        origin=Origin(path=path, format="amc", options=options, document=document),
    )


def _guessed_skeleton(asf_path: Path) -> Finding:
    """Return the finding that a take has the skeleton of another name, which is the only one in its folder."""
    return Finding(
        rule="skeleton",
        message=f"no .asf has the name of the take; {asf_path.name} is taken, the only one in the folder",
        advice="give the skeleton (--skeleton) if it is another subject's",
    )


def create(take: Take, path: Path) -> None:
    """Write a new AMC file of a take's poses, in degrees, and read it back; NaN is written as ``nan``.

    The file goes with the text that ``asf.text`` makes of the take's skeleton; ``formats.write`` stores that beside it.
    Raises UsageError for a take without poses or with a skeleton that ASF cannot express, FormatError if the file does
    not read back as the take.
    """
    skeleton, poses = posed(take)
    asf = skeletons.parse(path, skeletons.text(skeleton).encode())
    scale = np.array([1.0 if channel.is_rotation else skeletons.CMU_UNIT for channel in skeleton.channels])
    rows = [
        (skeletons.ROOT if joint == 0 else name, own)
        for joint, name in enumerate(skeleton.names)
        if (own := columns(skeleton, joint))
    ]
    lines = ["#!OML:ASF", ":FULLY-SPECIFIED", ":DEGREES"]
    for frame, pose in enumerate((poses / scale).tolist(), start=1):
        lines.append(str(frame))
        lines += [f"{name} {' '.join(f'{pose[column]:.{CREATED_DECIMALS}f}' for column in own)}" for name, own in rows]
    path.write_bytes("\n".join([*lines, ""]).encode())
    created = _parse(path, load(path), asf, "its skeleton")
    kept.prove_created(take, path, created.poses, created.skeleton)


def _parse(path: Path, raw: bytes, asf: Asf, asf_name: str) -> AmcDocument:
    """Return the document of a file; raise FormatError with the line unless every frame has all bones that turn."""
    text = blank(raw)
    layouts = _Layouts(path, asf.skeleton, asf_name)
    frames = _alike(path, text, asf, layouts) or _line_by_line(path, text, asf, layouts)
    scale = np.array(
        [(1.0 if frames.degrees else 180.0 / np.pi) if c.is_rotation else asf.unit for c in asf.skeleton.channels]
    )
    poses = frames.table
    poses *= scale
    return AmcDocument(
        raw=raw,
        skeleton=asf.skeleton,
        scale=scale,
        poses=poses,
        starts=np.append(frames.starts, len(raw)),
        places=frames.places,
        asf=asf,
        first_frame=frames.first,
    )


@dataclass(frozen=True, kw_only=True)
class _Frames:
    """The frames of a text.

    table: (F, C) numbers in the skeleton's order. starts: (F,) bytes. places: (F, C) tokens, see ``PoseDocument``.
    first: the number of the first frame. degrees: whether the angles are degrees.
    """

    table: Floats
    starts: Ints
    places: Ints
    first: int
    degrees: bool


def _alike(path: Path, text: bytes, asf: Asf, layouts: "_Layouts") -> _Frames | None:
    """Return the frames of a text in which all look like the first, or None for any other text."""
    alike = frames_alike(text)
    if alike is None:
        return None
    header = [line.split() for line in text[: alike.starts[0]].splitlines()]
    degrees = _degrees(path, [words[0] if words else b"" for words in header], asf.degrees)
    layout = layouts.of(alike.names, alike.widths, len(header) + 2)
    table = quick_table(alike.rows, layout.places.tolist())
    if table is None:
        return None
    return _Frames(
        table=table,
        starts=alike.starts,
        places=np.broadcast_to(layout.places, table.shape),
        first=alike.first_frame,
        degrees=degrees,
    )


def _line_by_line(path: Path, text: bytes, asf: Asf, layouts: "_Layouts") -> _Frames:
    """Return the frames of any text; raise FormatError with the line of the first fault."""
    lines = text.splitlines(keepends=True)
    rows = [line.split() for line in lines]
    names = [row.pop(0) if row else b"" for row in rows]
    # A frame begins at a line that holds a whole number alone.
    starts = [index for index, name in enumerate(names) if name.isdigit() and not rows[index]]
    if not starts:
        raise FormatError(path, "an AMC file must have frames, each under its number. Got none.")
    degrees = _degrees(path, names[: starts[0]], asf.degrees)
    first_frame = _first_frame(path, names, starts)
    widths = list(map(len, rows))
    bodies = pairwise([*starts, len(rows)])
    frames = [layouts.of(names[at + 1 : stop], widths[at + 1 : stop], at + 2) for at, stop in bodies]
    values = numbers(path, rows[starts[0] :], range(starts[0] + 1, len(rows) + 1))
    # Bones may come in any order, even in another one in each frame: bring the numbers into the skeleton's order.
    order = np.array([layout.order for layout in frames])
    begins = np.cumsum([0, *map(len, lines)])
    return _Frames(
        table=np.take_along_axis(values.reshape(order.shape), order, axis=1),
        starts=begins[starts],
        places=np.array([layout.places for layout in frames]),
        first=first_frame,
        degrees=degrees,
    )


def _first_frame(path: Path, names: Words, starts: list[int]) -> int:
    """Return the number of the first frame; raise FormatError unless the others follow it without a gap."""
    stored = [int(names[start]) if len(names[start]) <= MOST_DIGITS else -1 for start in starts]
    for number, start, value in zip(count(max(stored[0], 0)), starts, stored, strict=False):
        if value != number:
            message = f"frame numbers must be consecutive, here {number}. Got {quote(names[start])}."
            raise FormatError(path, message, line=start + 1)
    return stored[0]


def _degrees(path: Path, header: Words, asf_degrees: bool) -> bool:
    """Whether the angles are degrees: by the last :DEGREES or :RADIANS of the header, else by the .asf."""
    degrees = asf_degrees
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
    """The layouts of a file's frames, nearly always a single one, each worked out once.

    expected: the channels of each bone that turns, in the order in which the .asf lists them.
    """

    def __init__(self, path: Path, skeleton: Skeleton, asf_name: str) -> None:
        self.path, self.asf_name = path, asf_name
        self.expected: dict[str, list[int]] = {}
        for index, channel in enumerate(skeleton.channels):
            self.expected.setdefault(skeleton.names[channel.joint], []).append(index)
        self.known: dict[tuple[tuple[bytes, ...], tuple[int, ...]], _Layout] = {}

    def of(self, names: Words, widths: list[int], line: int) -> _Layout:
        """Return the layout of a frame that begins at a line: first words of its lines, and numbers after each."""
        shape = tuple(names), tuple(widths)
        if shape not in self.known:
            self.known[shape] = self._work_out(names, widths, line)
        return self.known[shape]

    def _work_out(self, names: Words, widths: list[int], first_line: int) -> _Layout:
        """Return the layout of a frame; raise FormatError unless it has every bone that turns once."""
        n_channels = sum(map(len, self.expected.values()))
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
        missing = [name for name, own in self.expected.items() if order[own[0]] < 0]
        if missing:
            message = (
                f"a frame must have all {len(self.expected)} bones that turn in {self.asf_name}. Got none of "
                f"{missing[0]!r}; the file may be cut off, or the .asf another subject's."
            )
            raise FormatError(self.path, message, line=first_line - 1)
        return _Layout(order=order, places=places)

    def _channels_of(self, word: bytes, width: int, line: int) -> list[int]:
        """Return the channels of a bone; raise FormatError if it does not turn or has not ``width`` channels."""
        name = decode(word)
        if name not in self.expected:
            message = f"a bone must be one that turns in {self.asf_name}. Got {quote(word)}; give this subject's .asf."
            raise FormatError(self.path, message, line=line)
        if width != len(self.expected[name]):
            message = (
                f"{name!r} must have {len(self.expected[name])} numbers, as in {self.asf_name}. Got {width}; "
                f"the file may be cut off, or the .asf another subject's."
            )
            raise FormatError(self.path, message, line=line)
        return self.expected[name]
