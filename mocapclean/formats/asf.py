"""ASF (Acclaim skeleton file): the bones that an AMC file moves.

A bone's local rotation is C R Cᵀ: R multiplies the turns of its ``dof``, the first listed innermost (the
listed sequence is about fixed axes, so ``rx ry rz`` is Rz Ry Rx), and C is its ``axis``, read likewise. The
root's ``order`` lists its channels in the same sense, its ``orientation`` is its C and its ``position`` is
added to every frame's. A joint is the far end of the bone whose name it bears, ``root`` the root. Lengths
are inches scaled by ``:units length``: 1 unit is 25.4 mm / length (M. Schafer, Acclaim Skeleton File
Definition V1.10, 1994-95).
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from mocapclean.arrays import Floats
from mocapclean.errors import FormatError
from mocapclean.formats.poses import blank, decode, finite, quote
from mocapclean.geometry.skeleton import Channel, Skeleton, turn

INCH = 25.4
_SHORTEST = 1e-6
CMU_LENGTH = 0.45
HEAD = 4096

ORDER = re.compile(r"(?!.*(.).*\1)[xyz]{3}")
Line = tuple[int, list[bytes]]  # its number in the file and its words


@dataclass(frozen=True, kw_only=True)
class Asf:
    """A skeleton, the millimetres of one unit of length in its files, and whether their angles are
    degrees."""

    skeleton: Skeleton
    unit: float
    degrees: bool


@dataclass(frozen=True, kw_only=True)
class _Bone:
    name: str
    reach: Floats
    frame: Floats
    channels: list[tuple[int, bool]]


def looks_like_asf(raw: bytes) -> bool:
    """Whether a text begins as a skeleton does, not as motion."""
    return re.search(rb"(?im)^[ \t]*:(?:units|root|bonedata)\b", raw[:HEAD]) is not None


def parse(path: Path, raw: bytes) -> Asf:
    """Read the text of an .asf file; FormatError if it is not one or has freedoms other than the six of a
    body."""
    sections = _sections(path, raw)
    units = {words[0].lower(): (line, words[1:]) for line, words in sections.get(b":units", []) if words}
    line, words = units.get(b"length", (0, [b"1.0"]))
    length = finite(path, words, 1, ":units length", line)[0]
    words = [word.lower() for word in units.get(b"angle", (0, [b"deg"]))[1]]
    if length < _SHORTEST or words not in ([b"deg"], [b"rad"]):
        got = f"{length:g} and {quote(b' '.join(words))}"
        raise FormatError(path, f":units must have a length of 1e-6 or more and an angle of deg or rad. Got {got}.")
    unit, degrees = INCH / length, words == [b"deg"]
    bones = [_root(path, sections[b":root"], unit, degrees)]
    bones += [_bone(path, block, unit, degrees) for block in _blocks(path, sections[b":bonedata"])]
    return Asf(skeleton=_tree(path, bones, sections[b":hierarchy"]), unit=unit, degrees=degrees)


def text(skeleton: Skeleton, length: float) -> str:
    """The text of an .asf file of a skeleton, angles in degrees; its root is written as ``root``.

    ValueError if ASF cannot express the skeleton: one root that comes first, bones that turn but do not
    move, and names of one word.
    """
    moves = {channel.joint for channel in skeleton.channels if not channel.is_rotation}
    if skeleton.parents[0] != -1 or skeleton.parents.count(-1) != 1 or skeleton.after[0].any():
        raise ValueError("the skeleton must have one root, which comes first and is no bone.")
    if moves - {0} or skeleton.before[1:].any() or any(not re.fullmatch(r"[^\s#(),:]+", n) for n in skeleton.names):
        raise ValueError("bones must have names of one word, reach from their parents' ends, and only turn.")
    unit = INCH / length
    lines = [":version 1.10", ":name mocapclean", ":units", "  mass 1.0", f"  length {length:.12g}", "  angle deg"]
    lines += [":root", f"  order {' '.join(dofs(skeleton, 0)).upper()}", "  axis XYZ"]
    lines += [f"  position {_spell(skeleton.before[0] / unit)}", f"  orientation {_turned(skeleton, 0)}", ":bonedata"]
    for joint in range(1, len(skeleton.names)):
        reach = float(np.linalg.norm(skeleton.after[joint]))
        lines += ["  begin", f"     id {joint}", f"     name {skeleton.names[joint]}"]
        lines += [f"     direction {_spell(skeleton.after[joint] / (reach or 1.0))}"]
        lines += [f"     length {reach / unit:.9g}", f"     axis {_turned(skeleton, joint)} XYZ"]
        lines += [f"    dof {' '.join(dofs(skeleton, joint))}"] if dofs(skeleton, joint) else []
        lines += ["  end"]
    lines += [":hierarchy", "  begin"]
    for parent in range(len(skeleton.names)):
        children = [name for name, own in zip(skeleton.names, skeleton.parents, strict=True) if own == parent]
        if children:
            lines.append(f"    {' '.join([skeleton.names[parent] if parent else 'root', *children])}")
    return "\n".join([*lines, "  end", ""])


def columns(skeleton: Skeleton, joint: int) -> list[int]:
    """A joint's channels in the sequence in which ASF lists and AMC gives them."""
    moves = [i for i, c in enumerate(skeleton.channels) if c.joint == joint and not c.is_rotation]
    turns = [i for i in skeleton.product if skeleton.channels[i].joint == joint]
    return moves + turns[::-1]


def dofs(skeleton: Skeleton, joint: int) -> list[str]:
    """The names of those channels, such as ``tx`` and ``rz``."""
    chosen = [skeleton.channels[index] for index in columns(skeleton, joint)]
    return [("r" if channel.is_rotation else "t") + "xyz"[channel.axis] for channel in chosen]


def _spell(values: Floats) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _turned(skeleton: Skeleton, joint: int) -> str:
    return _spell(Rotation.from_matrix(skeleton.frames[joint]).as_euler("xyz", degrees=True))


def _sections(path: Path, raw: bytes) -> dict[bytes, list[Line]]:
    """The lines that follow each ``:keyword``, what stands behind it on its own line first."""
    found: dict[bytes, list[Line]] = {}
    current: list[Line] = []
    for line, content in enumerate(blank(raw).splitlines(), start=1):
        words = content.split()
        if words and words[0].startswith(b":"):
            current = found.setdefault(words.pop(0).lower(), [])
        if words:
            current.append((line, words))
    for keyword in (b":root", b":bonedata", b":hierarchy"):
        if keyword not in found:
            message = f"an .asf must have a section {decode(keyword)}. Got none; the file may be cut off."
            raise FormatError(path, message)
    return found


def _blocks(path: Path, lines: list[Line]) -> Iterator[list[Line]]:
    """The lines between each ``begin`` and ``end``."""
    block: list[Line] | None = None
    for line, words in lines:
        word = words[0].lower()
        if (word == b"begin") != (block is None):
            raise FormatError(path, f"begin and end must take turns. Got {quote(words[0])} here.", line=line)
        if word == b"end" and block is not None:
            yield block
            block = None
        elif word == b"begin":
            block = []
        elif block is not None:
            block.append((line, words))
    if block is not None:
        raise FormatError(path, "every begin must have its end. Got none; the file may be cut off.")


def _fields(lines: list[Line]) -> dict[bytes, Line]:
    return {words[0].lower(): (line, words[1:]) for line, words in lines}


def _root(path: Path, lines: list[Line], unit: float, degrees: bool) -> _Bone:
    fields = _fields(lines)
    line, words = fields.get(b"order", (0, []))
    channels = _channels(path, words, b"tr", line)
    at, place = fields.get(b"position", (0, [b"0"] * 3))
    turned, angles = fields.get(b"orientation", (0, [b"0"] * 3))
    _, order = fields.get(b"axis", (0, [b"XYZ"]))
    return _Bone(
        name="root",
        reach=np.array(finite(path, place, 3, ":root position", at)) * unit,
        frame=_frame(path, angles + order, degrees, turned),
        channels=channels,
    )


def _bone(path: Path, lines: list[Line], unit: float, degrees: bool) -> _Bone:
    fields = _fields(lines)
    for keyword in (b"name", b"direction", b"length"):
        if keyword not in fields or not fields[keyword][1]:
            line = lines[0][0] if lines else None
            raise FormatError(path, f"a bone must have a {decode(keyword)}. Got none.", line=line)
    name = decode(fields[b"name"][1][0])
    direction = np.array(finite(path, fields[b"direction"][1], 3, "direction", fields[b"direction"][0]))
    length = finite(path, fields[b"length"][1], 1, "length", fields[b"length"][0])[0]
    size = float(np.linalg.norm(direction))
    if length < 0 or (length > 0 and size == 0):
        message = f"bone {name!r} must have a direction and no negative length. Got {length:g}."
        raise FormatError(path, message, line=fields[b"length"][0])
    line, axis = fields.get(b"axis", (0, [b"0", b"0", b"0", b"XYZ"]))
    dof_line, dof = fields.get(b"dof", (0, []))
    return _Bone(
        name=name,
        reach=direction / (size or 1.0) * length * unit,
        frame=_frame(path, axis, degrees, line),
        channels=_channels(path, dof, b"r", dof_line),
    )


def _channels(path: Path, words: list[bytes], kinds: bytes, line: int) -> list[tuple[int, bool]]:
    """Axis and whether it is a rotation of each degree of freedom."""
    tokens = [word.lower() for word in words]
    for token in tokens:
        if len(token) != 2 or token[0] not in kinds or token[1] not in b"xyz":
            allowed = "tx ty tz rx ry rz" if b"t" in kinds else "rx ry rz; bones that stretch or slide are not read"
            raise FormatError(path, f"a degree of freedom must be one of {allowed}. Got {quote(token)}.", line=line)
    if len(set(tokens)) != len(tokens):
        raise FormatError(path, f"a degree of freedom must stand once. Got {quote(b' '.join(words))}.", line=line)
    return [(b"xyz".index(token[1:]), token[:1] == b"r") for token in tokens]


def _frame(path: Path, words: list[bytes], degrees: bool, line: int) -> Floats:
    """C of angles about x, y and z and the sequence of its turns about fixed axes."""
    order = decode(words[3]).lower() if len(words) == 4 else ""
    if not ORDER.fullmatch(order):
        message = f"an axis must be three angles and an order such as XYZ. Got {quote(b' '.join(words))}."
        raise FormatError(path, message, line=line)
    angles = np.array(finite(path, words[:3], 3, "axis", line))
    angles = angles if degrees else np.degrees(angles)
    frame: Floats = np.eye(3)
    for axis in ("xyz".index(letter) for letter in order):
        frame = turn(axis, angles[axis]) @ frame
    return frame


def _tree(path: Path, bones: list[_Bone], hierarchy: list[Line]) -> Skeleton:
    """The bones as joints, each after its parent, depth first."""
    known = {bone.name: bone for bone in bones}
    if len(known) != len(bones):
        raise FormatError(path, "bones must have distinct names, and none the name root. Got one twice.")
    children, parent_of = _families(path, hierarchy, known)
    names, waiting = [], ["root"]
    while waiting:
        names.append(waiting.pop())
        waiting += reversed(children.get(names[-1], []))
    if len(names) != len(bones):
        loose = min(known.keys() - set(names))
        raise FormatError(path, f"every bone must hang on the root. Got {loose!r} that does not.")
    place = {name: joint for joint, name in enumerate(names)}
    channels = [
        Channel(joint=joint, axis=axis, is_rotation=is_rotation)
        for joint, name in enumerate(names)
        for axis, is_rotation in known[name].channels
    ]
    reach = np.array([known[name].reach for name in names])
    bone = np.arange(len(names))[:, None] > 0
    turns = [index for index, channel in enumerate(channels) if channel.is_rotation]
    return Skeleton(
        names=tuple(names),
        parents=tuple(place[parent_of[name]] if name in parent_of else -1 for name in names),
        before=np.where(bone, 0.0, reach),
        after=np.where(bone, reach, 0.0),
        frames=np.array([known[name].frame for name in names]),
        channels=tuple(channels),
        product=tuple(sorted(turns, key=lambda index: (channels[index].joint, -index))),
    )


def _families(
    path: Path, hierarchy: list[Line], known: dict[str, _Bone]
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """The children of each bone and the parent of each but the root."""
    children: dict[str, list[str]] = {}
    parent_of: dict[str, str] = {}
    for line, words in (entry for block in _blocks(path, hierarchy) for entry in block):
        parent, *own = map(decode, words)
        for name in (parent, *own):
            if name not in known:
                raise FormatError(path, f"the hierarchy must name bones of :bonedata. Got {name[:40]!r}.", line=line)
        for name in own:
            if name in parent_of or name == "root":
                raise FormatError(path, f"a bone must have one parent. Got a second for {name!r}.", line=line)
            parent_of[name] = parent
        children.setdefault(parent, []).extend(own)
    return children, parent_of
