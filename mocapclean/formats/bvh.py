"""BVH (Biovision hierarchy): a tree of joints in text, and one row of channel values per frame.

Source: M. Meredith and S. Maddock, "Motion capture file formats explained", University of Sheffield, Department of
Computer Science, report CS-01-11 (2001), section on BVH. Rotations are multiplied in the order in which the channels
are listed. A joint's position channels replace its OFFSET, axis by axis, as MotionBuilder and Blender read them. End
Sites are not joints. BVH names no unit of length: ``ReadOptions.unit`` gives it, else the size of the body does
(``units.body_scale``); a centimetre is assumed where there is no body.
"""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.arrays import Floats, evenly_spaced
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import poses as kept
from mocapclean.formats.declarations import CENTIMETRE
from mocapclean.formats.poses import PoseDocument
from mocapclean.formats.text import (
    BYTE_ORDER_MARK,
    NUMBER,
    decode,
    finite,
    is_plain,
    line_at,
    load,
    numbers,
    positive,
    quick_table,
    quote,
)
from mocapclean.formats.units import BodyScale, body_scale, given_scale
from mocapclean.geometry.skeleton import Channel, Skeleton
from mocapclean.numerics.robust import median
from mocapclean.take import Finding, Origin, ReadOptions, Take
from mocapclean.take.posed import posed, posed_take

CREATED_DECIMALS = 6
"""Decimals of a created file's numbers, degrees and centimetres. As BVH exporters write them; chosen by hand."""

STATEMENT = re.compile(rb"(?P<word>[{}]|[^\s{}]+)(?P<rest>[^\r\n{}]*)")
MOTION = re.compile(rb"(?:^|[\r\n])[ \t]*MOTION[ \t]*(?=[\r\n]|$)", re.IGNORECASE)
FRAMES = re.compile(rb"\s*Frames[ \t]*:[ \t]*(\S+)", re.IGNORECASE)
FRAME_TIME = re.compile(rb"\s*Frame[ \t]+Time[ \t]*:[ \t]*(\S+)[ \t]*(?=[\r\n]|$)", re.IGNORECASE)
FRAME_COUNT = re.compile(rb"0*[1-9]\d{0,8}")
CHANNEL = re.compile(rb"([XYZ])(position|rotation)", re.IGNORECASE)
UNIT_FRAMES = 60
"""Frames, evenly spaced, in which offsets that change are measured for the unit. Chosen by hand."""
END_SITE = -2
"""Stands for an End Site among indices of joints; -1 is the parent of a root."""

write, prove = kept.write, kept.prove


@dataclass(frozen=True, kw_only=True)
class BvhDocument(PoseDocument):
    """A BVH text with the unit of length that was taken for it."""

    unit: BodyScale


def sniff(head: bytes) -> bool:
    """Whether a file's first bytes can begin a BVH file."""
    return head.removeprefix(BYTE_ORDER_MARK).lstrip()[:9].upper() == b"HIERARCHY"


def read(path: Path, options: ReadOptions) -> Take:
    """Return the take of a BVH file: joint positions (F, J, 3) in millimetres, and the poses.

    Raises FormatError with the line where the text is not BVH.
    """
    raw = load(path)
    motion = _motion(path, raw)
    document = _parse(path, raw, motion, options.unit)
    assumed = Finding(
        rule="units",
        message=f"a BVH file names no unit of length; 1 unit is taken as {document.unit.millimetres:g} mm: "
        f"{document.unit.reason}",
        advice="" if options.unit else "give the unit (--unit) if lengths look wrong",
    )
    return posed_take(
        document.skeleton,
        document.poses,
        _rate(path, motion, options),
        findings=(assumed,),
        origin=Origin(path=path, format="bvh", options=options, document=document),
    )


def read_skeleton(path: Path, unit: float | None = None) -> Skeleton:
    """Return the joints of a BVH file, in millimetres; its motion is not read.

    unit: millimetres per unit; None takes the one that its offsets show.
    """
    raw = load(path)
    motion = MOTION.search(raw)
    hierarchy = _Hierarchy(path, raw[: motion.start()] if motion else raw)
    taken = _unit(hierarchy.skeleton(1.0), hierarchy.offsets(), unit)
    return hierarchy.skeleton(taken.millimetres, is_scaled=taken.is_known)


def create(take: Take, path: Path) -> None:
    """Write a new BVH file of a take's poses, in centimetres, and read it back; NaN is written as ``nan``.

    Raises UsageError for a take without poses or with a skeleton that BVH cannot express: it needs one root, offsets
    before the joints only and axes that are not turned. Raises FormatError if the file does not read back as the take.
    """
    skeleton, poses = posed(take)
    if skeleton.parents.count(-1) != 1 or skeleton.after.any() or (skeleton.frames != np.eye(3)).any():
        raise UsageError(
            "a BVH skeleton must have one root, bones that start at their joints and axes that are not turned."
        )
    columns = _columns(skeleton)
    root, order = _bvhio_tree(skeleton, columns)
    scale = _scale(skeleton, CENTIMETRE)
    tree, time = _bvhio_header(root, skeleton.names, take.rate, path)
    rows = io.StringIO()
    np.savetxt(rows, (poses / scale)[:, order], fmt=f"%.{CREATED_DECIMALS}f")
    path.write_text(f"{tree}Frames: {len(poses)}\n{time}{rows.getvalue()}", encoding="utf-8", newline="\n")
    raw = load(path)
    created = _parse(path, raw, _motion(path, raw), CENTIMETRE)
    kept.prove_created(take, path, created.poses, created.skeleton)


def _bvhio_tree(skeleton: Skeleton, columns: list[list[int]]) -> tuple[Any, list[int]]:
    """Return bvhio's root joint of a skeleton, and the channels in the order of its rows."""
    import bvhio  # takes long to import, and only new files need it

    nodes = [bvhio.BvhJoint(f"joint{number}") for number in range(len(skeleton.names))]
    for joint, parent in enumerate(skeleton.parents):
        node = nodes[joint]
        node.Offset = type(node.Offset)(*(skeleton.before[joint] / CENTIMETRE))
        node.EndSite = node.Offset * 0
        node.Channels = [skeleton.channels[column].name for column in columns[joint]]
        if parent >= 0:
            nodes[parent].Children.append(node)
    root = nodes[skeleton.parents.index(-1)]
    return root, [column for node, _, _ in root.layout() for column in columns[nodes.index(node)]]


def _bvhio_header(root: Any, names: Sequence[str], rate: float, path: Path) -> tuple[str, str]:
    """Return the text of a file before ``Frames:`` and the line of the frame time, as bvhio writes them.

    bvhio writes no motion here: it would pass the angles through quaternions and lose their spelling. It writes in the
    encoding of the system, so that it gets numbered joints, which get their names here.
    """
    import bvhio

    bvhio.writeBvh(str(path), bvhio.BvhContainer(root, 0, 1 / rate), CREATED_DECIMALS)
    tree, _, time = path.read_text(encoding="ascii").rpartition("Frames: 0\n")
    return re.sub(r"(ROOT|JOINT) joint(\d+)", lambda found: f"{found[1]} {names[int(found[2])]}", tree), time


def _unit(skeleton: Skeleton, offsets: Floats, unit: float | None) -> BodyScale:
    """Return the unit of length: the user's, else the one that the skeleton's offsets (J, 3) show.

    Raises UsageError for a unit that is not positive and finite.
    """
    if unit is not None:
        return given_scale(positive(unit, "the unit"))
    return body_scale(skeleton.names, skeleton.parents, offsets, CENTIMETRE)


def _stored_offsets(skeleton: Skeleton, offsets: Floats, table: Floats) -> Floats:
    """Return the offsets (J, 3) of joints from their parents, in the file's unit.

    offsets: (J, 3) OFFSETs. Of a joint whose OFFSET is zero the position channels hold them: then the median in up to
    60 frames of the table (F, C) is taken.
    """
    stored = offsets.copy()
    frames = evenly_spaced(len(table), UNIT_FRAMES)
    for index, channel in enumerate(skeleton.channels):
        values = table[frames, index]
        values = values[np.isfinite(values)]
        if not channel.is_rotation and values.size and not offsets[channel.joint].any():
            stored[channel.joint, channel.axis] = median(values)
    return stored


def _scale(skeleton: Skeleton, unit: float) -> Floats:
    """Return the degrees or millimetres (C,) per number of the file."""
    return np.array([1.0 if channel.is_rotation else unit for channel in skeleton.channels])


def _columns(skeleton: Skeleton) -> list[list[int]]:
    """Return each joint's channels as BVH lists them: positions, then rotations in the order of multiplication."""
    columns: list[list[int]] = [[] for _ in skeleton.names]
    shifts = [index for index, channel in enumerate(skeleton.channels) if not channel.is_rotation]
    for index in [*shifts, *skeleton.product]:
        columns[skeleton.channels[index].joint].append(index)
    return columns


@dataclass(frozen=True, kw_only=True)
class _Motion:
    """The header of the MOTION section.

    start: byte of the section. rows: byte after the header. frames: the count declared. time: the frame time in
    seconds as spelled. time_line: the line of it.
    """

    start: int
    rows: int
    frames: int
    time: bytes
    time_line: int


def _motion(path: Path, raw: bytes) -> _Motion:
    """Return the header of the MOTION section; raise FormatError with the line if it is not complete."""
    motion = MOTION.search(raw)
    if not motion:
        raise FormatError(path, "a BVH file must have a MOTION section. Got none; it may be cut off.")
    frames = FRAMES.match(raw, motion.end())
    time = FRAME_TIME.match(raw, frames.end()) if frames else None
    if not frames or not time:
        what, byte = ("Frame Time:", frames.end()) if frames else ("Frames:", motion.end())
        raise FormatError(path, f"{what} and a number must follow. Got something else.", line=line_at(raw, byte))
    if not FRAME_COUNT.fullmatch(frames[1]):
        line = line_at(raw, frames.start(1))
        raise FormatError(path, f"Frames: must be a whole number from 1. Got {quote(frames[1])}.", line=line)
    return _Motion(
        start=motion.start(),
        rows=time.end(),
        frames=int(frames[1]),
        time=time[1],
        time_line=line_at(raw, time.start(1)),
    )


def _rate(path: Path, motion: _Motion, options: ReadOptions) -> float:
    """Return the frames per second: one over the frame time, or the user's rate where the frame time is no time."""
    seconds = float(motion.time) if NUMBER.fullmatch(motion.time) else np.nan
    if 0 < seconds < np.inf and 1 / seconds < np.inf:
        return 1 / seconds
    if options.rate is not None:
        return positive(options.rate, "the rate")
    message = f"Frame Time: must be a positive number of seconds. Got {quote(motion.time)}; give the rate."
    raise FormatError(path, message, line=motion.time_line)


def _parse(path: Path, raw: bytes, motion: _Motion, unit: float | None) -> BvhDocument:
    """Return the document of a file; raise FormatError with the line unless it has the rows that it declares."""
    hierarchy = _Hierarchy(path, raw[: motion.start])
    skeleton = hierarchy.skeleton(1.0)
    n_channels, first = len(skeleton.channels), line_at(raw, motion.rows)
    text = raw[motion.rows :]
    lines = text.splitlines(keepends=True)
    rows = [index for index, line in enumerate(lines) if not line.isspace()]
    table = quick_table([lines[index] for index in rows]) if rows and is_plain(text) else None
    if table is None or table.shape != (motion.frames, n_channels):
        table = _table(path, lines, first, motion.frames, n_channels)
    taken = _unit(skeleton, _stored_offsets(skeleton, hierarchy.offsets(), table), unit)
    skeleton = hierarchy.skeleton(taken.millimetres, is_scaled=taken.is_known)
    scale = _scale(skeleton, taken.millimetres)
    table *= scale
    begins = motion.rows + np.cumsum([0, *map(len, lines)])
    return BvhDocument(
        raw=raw,
        unit=taken,
        skeleton=skeleton,
        scale=scale,
        poses=table,
        starts=np.append(begins[rows], len(raw)),
        places=np.broadcast_to(np.arange(n_channels), (len(rows), n_channels)),
    )


def _table(path: Path, lines: list[bytes], first: int, n_frames: int, n_channels: int) -> Floats:
    """Return the numbers (F, C) of the motion's lines, of which the first has this number, word by word.

    Raises FormatError with the line unless there are as many rows and numbers as declared.
    """
    rows = [(number, tokens) for number, line in enumerate(lines, start=first) if (tokens := line.split())]
    for number, tokens in rows:
        if len(tokens) != n_channels:
            message = f"a row of motion must have {n_channels} numbers. Got {len(tokens)}."
            raise FormatError(path, message, line=number)
    if len(rows) != n_frames:
        why = "the file may be cut off" if len(rows) < n_frames else "correct the count"
        message = f"the motion must have {n_frames} rows, as Frames: declares. Got {len(rows)}; {why}."
        raise FormatError(path, message, line=first + len(lines) - 1)
    values = numbers(path, [tokens for _, tokens in rows], [number for number, _ in rows])
    return values.reshape(n_frames, n_channels)


@dataclass
class _Joint:
    """A joint while its braces are read."""

    name: str
    parent: int
    offset: list[float] | None = None
    channels: list[Channel] | None = None


class _Hierarchy:
    """The HIERARCHY section, read statement by statement and without recursion.

    joints: in the order of the file. inside: the joints, or END_SITE, whose braces are open. named: the joint, or
    END_SITE, whose brace must open next. at: byte of the statement, for errors.
    """

    def __init__(self, path: Path, text: bytes) -> None:
        self.path, self.text, self.at = path, text, 0
        self.joints: list[_Joint] = []
        self.inside: list[int] = []
        self.named: int | None = None
        read = {b"{": self._open, b"}": self._close, b"ROOT": self._joint, b"JOINT": self._joint}
        read |= {b"END": self._end_site, b"OFFSET": self._offset, b"CHANNELS": self._channels}
        read |= {b"HIERARCHY": self._hierarchy}
        for match in STATEMENT.finditer(text, len(BYTE_ORDER_MARK) if text.startswith(BYTE_ORDER_MARK) else 0):
            self.at, word = match.start(), match["word"].upper()
            if word not in read:
                raise self._error(f"a statement must be a word of BVH. Got {quote(match['word'])}.")
            if self.named is not None and word != b"{":
                raise self._error(f"a brace must open after a joint's name. Got {quote(match['word'])}.")
            read[word](word, match["rest"].strip())
        if self.inside or self.named is not None or not self.joints:
            raise self._error("every joint must be closed by a brace. Got the end; the file may be cut off.")

    def skeleton(self, unit: float, *, is_scaled: bool = True) -> Skeleton:
        """Return the joints in millimetres, true ones if ``is_scaled``.

        Raises FormatError if a joint has no OFFSET or none has CHANNELS.
        """
        joints = self.joints
        channels = tuple(channel for joint in joints for channel in joint.channels or ())
        unplaced = [joint.name for joint in joints if joint.offset is None]
        if unplaced or not channels:
            what = f"joint {unplaced[0]!r} must have an OFFSET" if unplaced else "a joint must have CHANNELS"
            raise FormatError(self.path, f"{what}. Got none.")
        before = np.array([joint.offset for joint in joints]) * unit
        # A position channel replaces the offset on its axis.
        for channel in channels:
            if not channel.is_rotation:
                before[channel.joint, channel.axis] = 0.0
        return Skeleton(
            names=_distinct([joint.name for joint in joints]),
            parents=tuple(joint.parent for joint in joints),
            before=before,
            after=np.zeros_like(before),
            frames=np.broadcast_to(np.eye(3), (len(joints), 3, 3)),
            channels=channels,
            product=tuple(index for index, channel in enumerate(channels) if channel.is_rotation),
            is_scaled=is_scaled,
        )

    def offsets(self) -> Floats:
        """Return the OFFSETs (J, 3) of the joints in the file's unit, position channels or not."""
        return np.array([joint.offset for joint in self.joints], dtype=np.float64)

    def _error(self, message: str) -> FormatError:
        """Return an error with the line of the current statement."""
        return FormatError(self.path, message, line=line_at(self.text, self.at))

    def _hierarchy(self, word: bytes, rest: bytes) -> None:
        """Check that HIERARCHY comes first and alone."""
        if rest or self.joints:
            raise self._error("HIERARCHY must stand alone before the joints. Got it elsewhere.")

    def _joint(self, word: bytes, rest: bytes) -> None:
        """Add the joint that ROOT or JOINT names, below the innermost open one."""
        if not rest:
            raise self._error(f"{decode(word)} must be followed by a name. Got none.")
        if (word == b"ROOT") == bool(self.inside) or self.inside[-1:] == [END_SITE]:
            raise self._error(f"a ROOT must stand outside of joints, a JOINT inside of one. Got {decode(word)}.")
        self.named = len(self.joints)
        self.joints.append(_Joint(decode(rest), self.inside[-1] if self.inside else -1))

    def _end_site(self, word: bytes, rest: bytes) -> None:
        """Expect the braces of an End Site."""
        if not self.inside or self.inside[-1] == END_SITE or not rest.upper().startswith(b"SITE"):
            raise self._error("an End Site must stand inside of a joint. Got it elsewhere.")
        self.named = END_SITE

    def _open(self, word: bytes, rest: bytes) -> None:
        """Open the braces of the joint that was named last."""
        if self.named is None or rest:
            raise self._error("a brace must open on its own after a joint's name. Got it elsewhere.")
        self.inside.append(self.named)
        self.named = None

    def _close(self, word: bytes, rest: bytes) -> None:
        """Close the innermost open braces."""
        if not self.inside or rest:
            raise self._error("a brace must close an open one, on its own. Got one too many.")
        self.inside.pop()

    def _offset(self, word: bytes, rest: bytes) -> None:
        """Set the offset of the innermost open joint; that of an End Site is checked alone."""
        offset = finite(self.path, rest.split(), 3, "OFFSET", line_at(self.text, self.at))
        if not self.inside:
            raise self._error("OFFSET must stand inside of a joint. Got it outside.")
        if self.inside[-1] != END_SITE:
            if self.joints[self.inside[-1]].offset is not None:
                raise self._error("a joint must have one OFFSET. Got a second.")
            self.joints[self.inside[-1]].offset = offset

    def _channels(self, word: bytes, rest: bytes) -> None:
        """Set the channels of the innermost open joint."""
        if not self.inside or self.inside[-1] == END_SITE or self.joints[self.inside[-1]].channels is not None:
            raise self._error("CHANNELS must stand once and inside of a joint. Got them elsewhere.")
        count, *names = rest.split() or [b"no number"]
        if not count.isdigit() or count.lstrip(b"0") != str(len(names)).encode().lstrip(b"0"):
            raise self._error(f"CHANNELS must give the number of its names, {len(names)}. Got {quote(count)}.")
        matches = [CHANNEL.fullmatch(name) for name in names]
        unknown = [name for name, match in zip(names, matches, strict=True) if not match]
        if unknown:
            raise self._error(f"a channel must be X, Y or Z and position or rotation. Got {quote(unknown[0])}.")
        channels = [
            Channel(
                joint=self.inside[-1],
                axis=b"XYZ".index(match[1].upper()),
                is_rotation=match[2].lower() == b"rotation",
            )
            for match in matches
            if match
        ]
        shifted = [channel.axis for channel in channels if not channel.is_rotation]
        if len(set(shifted)) != len(shifted):
            raise self._error("a joint must have one position channel per axis. Got one twice.")
        self.joints[self.inside[-1]].channels = channels


def _distinct(names: list[str]) -> tuple[str, ...]:
    """Return the names, with #2, #3, ... after a name that an earlier joint has."""
    distinct: dict[str, None] = {}
    repeats: dict[str, int] = {}
    for name in names:
        candidate = name
        while candidate in distinct:
            repeats[name] = repeats.get(name, 1) + 1
            candidate = f"{name}#{repeats[name]}"
        distinct[candidate] = None
    return tuple(distinct)
