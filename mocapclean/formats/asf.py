"""ASF (Acclaim skeleton file): the bones that an AMC file moves.

Source: M. Schafer, Acclaim Skeleton File Definition V1.10 (1994-95).

A bone's local rotation is C R Cᵀ. R is the product of the rotations of its ``dof``, and C is the rotation of its
``axis``. Both lists are rotations about fixed axes, so the first listed is the innermost factor: ``rx ry rz`` is
Rz Ry Rx. The root's ``order`` lists its channels in the same sense. Its ``orientation`` is its C, and its ``position``
is added to that of every frame. A joint is the far end of the bone of the same name; ``root`` is the root itself.
Lengths are inches scaled by ``:units length``: 1 unit is 25.4 mm / length.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.text import blank, decode, finite, load, quote
from mocapclean.geometry.skeleton import Channel, Skeleton, turn

SUFFIX = ".asf"
ROOT = "root"
"""The name of the root in every ASF and AMC file."""
INCH = 25.4
"""Millimetres."""
SMALLEST_LENGTH = 1e-6
"""The smallest ``:units length`` that is read. Chosen by hand: below it a unit exceeds 25 km and numbers overflow."""
CMU_LENGTH = 0.45
"""The ``:units length`` of the CMU motion capture database, and of files that are created here."""
CMU_UNIT = INCH / CMU_LENGTH
"""Millimetres per unit of length in the CMU database: 56.44."""
SEARCHED_BYTES = 4096
"""Bytes in which a keyword of ASF shows that a text is a skeleton: comments may come before it. Chosen by hand."""

SECTIONS = (b":root", b":bonedata", b":hierarchy")
ORDER = re.compile(r"(?!.*(.).*\1)[xyz]{3}")
"""The three axes, each once, in any order."""
BONE_NAME = re.compile(r"[^\s#(),:]+")
"""A word without the characters that ASF gives a meaning to."""
Line = tuple[int, list[bytes]]
"""The number of a line in the file, and its words."""


@dataclass(frozen=True, kw_only=True)
class Asf:
    """A skeleton, the millimetres per unit of length in its files, and whether their angles are degrees."""

    skeleton: Skeleton
    unit: float
    degrees: bool


@dataclass(frozen=True, kw_only=True)
class _Bone:
    """A bone: its vector (3,) in millimetres, the rotation C (3, 3) of its axes, (axis, is_rotation) per channel."""

    name: str
    vector: Floats
    frame: Floats
    channels: list[tuple[int, bool]]


def read_skeleton(path: Path) -> Skeleton:
    """Return the joints of an .asf file, in millimetres."""
    return parse(path, load(path)).skeleton


def is_skeleton_text(raw: bytes) -> bool:
    """Whether a text begins as a skeleton, not as motion."""
    return re.search(rb"(?im)^[ \t]*:(?:units|root|bonedata)\b", raw[:SEARCHED_BYTES]) is not None


def parse(path: Path, raw: bytes) -> Asf:
    """Return the skeleton in the text of an .asf file.

    Raises FormatError with the line if the text is not ASF, or if a bone stretches or slides.
    """
    sections = _sections(path, raw)
    units = {words[0].lower(): (line, words[1:]) for line, words in sections.get(b":units", []) if words}
    line, words = units.get(b"length", (0, [b"1.0"]))
    length = finite(path, words, 1, ":units length", line)[0]
    words = [word.lower() for word in units.get(b"angle", (0, [b"deg"]))[1]]
    if length < SMALLEST_LENGTH or words not in ([b"deg"], [b"rad"]):
        got = f"{length:g} and {quote(b' '.join(words))}"
        raise FormatError(path, f":units must have a length of 1e-6 or more and an angle of deg or rad. Got {got}.")
    unit, degrees = INCH / length, words == [b"deg"]
    bones = [_root(path, sections[b":root"], unit, degrees)]
    bones += [_bone(path, block, unit, degrees) for block in _blocks(path, sections[b":bonedata"])]
    return Asf(skeleton=_tree(path, bones, sections[b":hierarchy"]), unit=unit, degrees=degrees)


def text(skeleton: Skeleton) -> str:
    """Return the text of an .asf file of a skeleton, in CMU units and degrees; its root is named ``root``.

    Raises UsageError if ASF cannot express the skeleton: it needs one root that comes first and is no bone, bones that
    turn but do not slide, and names of one word.
    """
    _check_expressible(skeleton)
    lines = [":version 1.10", ":name mocapclean", ":units", "  mass 1.0", f"  length {CMU_LENGTH:.12g}", "  angle deg"]
    lines += [":root", f"  order {' '.join(dofs(skeleton, 0)).upper()}", "  axis XYZ"]
    lines += [f"  position {_spell(skeleton.before[0] / CMU_UNIT)}", f"  orientation {_axis_angles(skeleton, 0)}"]
    lines += [":bonedata"]
    for joint in range(1, len(skeleton.names)):
        reach = float(np.linalg.norm(skeleton.after[joint]))
        lines += ["  begin", f"     id {joint}", f"     name {skeleton.names[joint]}"]
        lines += [f"     direction {_spell(skeleton.after[joint] / (reach or 1.0))}"]
        lines += [f"     length {reach / CMU_UNIT:.9g}", f"     axis {_axis_angles(skeleton, joint)} XYZ"]
        lines += [f"    dof {' '.join(dofs(skeleton, joint))}"] if dofs(skeleton, joint) else []
        lines += ["  end"]
    lines += [":hierarchy", "  begin"]
    for parent in range(len(skeleton.names)):
        children = [name for name, own in zip(skeleton.names, skeleton.parents, strict=True) if own == parent]
        if children:
            lines.append(f"    {' '.join([skeleton.names[parent] if parent else ROOT, *children])}")
    return "\n".join([*lines, "  end", ""])


def _check_expressible(skeleton: Skeleton) -> None:
    """Raise UsageError unless ASF can express the skeleton."""
    shifted = {channel.joint for channel in skeleton.channels if not channel.is_rotation}
    if skeleton.parents[0] != -1 or skeleton.parents.count(-1) != 1 or skeleton.after[0].any():
        raise UsageError("an .asf skeleton must have one root, which comes first and is no bone.")
    if shifted - {0} or skeleton.before[1:].any() or any(not BONE_NAME.fullmatch(name) for name in skeleton.names):
        raise UsageError(
            "the bones of an .asf skeleton must have names of one word, start at the ends of their parents, "
            "and only turn."
        )


def columns(skeleton: Skeleton, joint: int) -> list[int]:
    """Return a joint's channels in the order of its ``dof``, the innermost rotation first, after its shifts."""
    shifts = [i for i, c in enumerate(skeleton.channels) if c.joint == joint and not c.is_rotation]
    turns = [i for i in skeleton.product if skeleton.channels[i].joint == joint]
    return shifts + turns[::-1]


def dofs(skeleton: Skeleton, joint: int) -> list[str]:
    """Return the names of a joint's channels, such as ``tx`` and ``rz``, in the order of ``columns``."""
    chosen = [skeleton.channels[index] for index in columns(skeleton, joint)]
    return [("r" if channel.is_rotation else "t") + "xyz"[channel.axis] for channel in chosen]


def _spell(values: Floats) -> str:
    """Return numbers with nine significant digits, a micrometre in a kilometre."""
    return " ".join(f"{value:.9g}" for value in values)


def _axis_angles(skeleton: Skeleton, joint: int) -> str:
    """Return the angles of a joint's C about the fixed axes x, y and z, in degrees."""
    from scipy.spatial.transform import Rotation  # takes long to import, and only new files need it

    return _spell(Rotation.from_matrix(skeleton.frames[joint]).as_euler("xyz", degrees=True))


def _sections(path: Path, raw: bytes) -> dict[bytes, list[Line]]:
    """Return the lines of each section, by its ``:keyword``; words after the keyword are the section's first line."""
    sections: dict[bytes, list[Line]] = {}
    current: list[Line] = []
    for line, content in enumerate(blank(raw).splitlines(), start=1):
        words = content.split()
        if words and words[0].startswith(b":"):
            current = sections.setdefault(words.pop(0).lower(), [])
        if words:
            current.append((line, words))
    for keyword in SECTIONS:
        if keyword not in sections:
            message = f"an .asf must have a section {decode(keyword)}. Got none; the file may be cut off."
            raise FormatError(path, message)
    return sections


def _blocks(path: Path, lines: list[Line]) -> Iterator[list[Line]]:
    """Yield the lines between each ``begin`` and its ``end``."""
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
    """Return line number and values of each field, by its keyword."""
    return {words[0].lower(): (line, words[1:]) for line, words in lines}


def _root(path: Path, lines: list[Line], unit: float, degrees: bool) -> _Bone:
    """Return the root as a bone whose vector is its ``position``."""
    fields = _fields(lines)
    line, words = fields.get(b"order", (0, []))
    channels = _channels(path, words, b"tr", line)
    position_line, position = fields.get(b"position", (0, [b"0"] * 3))
    orientation_line, angles = fields.get(b"orientation", (0, [b"0"] * 3))
    _, order = fields.get(b"axis", (0, [b"XYZ"]))
    return _Bone(
        name=ROOT,
        vector=np.array(finite(path, position, 3, ":root position", position_line)) * unit,
        frame=_frame(path, angles + order, degrees, orientation_line),
        channels=channels,
    )


def _bone(path: Path, lines: list[Line], unit: float, degrees: bool) -> _Bone:
    """Return a bone; raise FormatError if it lacks a name, a direction or a length."""
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
        vector=direction / (size or 1.0) * length * unit,
        frame=_frame(path, axis, degrees, line),
        channels=_channels(path, dof, b"r", dof_line),
    )


def _channels(path: Path, words: list[bytes], allowed: bytes, line: int) -> list[tuple[int, bool]]:
    """Return (axis, is_rotation) of each degree of freedom; allowed: ``t`` for translations, ``r`` for rotations."""
    tokens = [word.lower() for word in words]
    for token in tokens:
        if len(token) != 2 or token[0] not in allowed or token[1] not in b"xyz":
            names = "tx ty tz rx ry rz" if b"t" in allowed else "rx ry rz; bones that stretch or slide are not read"
            raise FormatError(path, f"a degree of freedom must be one of {names}. Got {quote(token)}.", line=line)
    if len(set(tokens)) != len(tokens):
        raise FormatError(path, f"a degree of freedom must stand once. Got {quote(b' '.join(words))}.", line=line)
    return [(b"xyz".index(token[1:]), token[:1] == b"r") for token in tokens]


def _frame(path: Path, words: list[bytes], degrees: bool, line: int) -> Floats:
    """Return the rotation C of an ``axis``: angles about x, y and z, then the order of the turns about fixed axes."""
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
    """Return the bones as the joints of a skeleton, each after its parent, depth first."""
    known = {bone.name: bone for bone in bones}
    if len(known) != len(bones):
        raise FormatError(path, "bones must have distinct names, and none the name root. Got one twice.")
    children, parent_of = _families(path, hierarchy, known)
    # Depth first with a stack of our own: a chain of thousands of bones is no recursion.
    names, stack = [], [ROOT]
    while stack:
        names.append(stack.pop())
        stack += reversed(children.get(names[-1], []))
    if len(names) != len(bones):
        loose = min(known.keys() - set(names))
        raise FormatError(path, f"every bone must be connected to the root. Got {loose!r} that is not.")
    joint_of = {name: joint for joint, name in enumerate(names)}
    channels = [
        Channel(joint=joint, axis=axis, is_rotation=is_rotation)
        for joint, name in enumerate(names)
        for axis, is_rotation in known[name].channels
    ]
    # The root's vector is an offset before it; a bone's vector reaches from its start to the joint at its end.
    vectors = np.array([known[name].vector for name in names])
    is_bone = np.arange(len(names))[:, None] > 0
    # The first listed rotation is the innermost factor: within a joint the product runs against the list.
    turns = [index for index, channel in enumerate(channels) if channel.is_rotation]
    return Skeleton(
        names=tuple(names),
        parents=tuple(joint_of[parent_of[name]] if name in parent_of else -1 for name in names),
        before=np.where(is_bone, 0.0, vectors),
        after=np.where(is_bone, vectors, 0.0),
        frames=np.array([known[name].frame for name in names]),
        channels=tuple(channels),
        product=tuple(sorted(turns, key=lambda index: (channels[index].joint, -index))),
    )


def _families(
    path: Path, hierarchy: list[Line], known: dict[str, _Bone]
) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return the children of each bone, and the parent of each bone but the root."""
    children: dict[str, list[str]] = {}
    parent_of: dict[str, str] = {}
    for line, words in (entry for block in _blocks(path, hierarchy) for entry in block):
        parent, *own = map(decode, words)
        for name in (parent, *own):
            if name not in known:
                raise FormatError(path, f"the hierarchy must name bones of :bonedata. Got {name[:40]!r}.", line=line)
        for name in own:
            if name in parent_of or name == ROOT:
                raise FormatError(path, f"a bone must have one parent. Got a second for {name!r}.", line=line)
            parent_of[name] = parent
        children.setdefault(parent, []).extend(own)
    return children, parent_of
