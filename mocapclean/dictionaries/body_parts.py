"""The five parts of a body, and the markers that say where it is: by name, or as the user says."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mocapclean.errors import UsageError
from mocapclean.take.bones import subject_of

PARTS = ("TO", "LA", "RA", "LL", "RL")
LANDMARKS = ("origin", "right", "left", "top")

_SIDES = {"left": "L", "right": "R", "l": "L", "r": "R"}
_ARM = frozenset(
    """
    clavicle humerus radius wrist hand fingers thumb
    collar shoulder arm uparm forearm lowarm elbow handend handthumb wristend fingerbase
    sho upa elb frm wra wrb wri fin
    """.split()  # noqa: SIM905
)
_LEG = frozenset(
    """
    hipjoint femur tibia foot toes
    hip upleg leg lowleg knee ankle toe toebase
    thi kne kd1 kd2 shn tib ank mak hee mt5
    """.split()  # noqa: SIM905
)
_TORSO = frozenset(
    """
    root lowerback upperback thorax lowerneck upperneck head
    hips spine spine1 spine2 spine3 chest chest2 chest3 chest4 neck neck1
    lfhd rfhd lbhd rbhd c7 t10 clav strn rbac rbak lfwt rfwt lbwt rbwt lasi rasi lpsi rpsi sacr
    """.split()  # noqa: SIM905
)
_FINGER = re.compile(r"(in)?hand(thumb|index|middle|ring|pinky)\d?")

# Origin, right hip, left hip, neck: the first line whose markers a take has.
_FRAMES = (
    ("root", "rhipjoint", "lhipjoint", "thorax"),
    ("Hips", "RightUpLeg", "LeftUpLeg", "Neck"),
    ("Hips", "RightUpLeg", "LeftUpLeg", "Head"),
    ("Hips", "RightHip", "LeftHip", "Neck"),
    ("LFWT RFWT LBWT RBWT", "RFWT RBWT", "LFWT LBWT", "C7 CLAV"),
    ("LASI RASI LPSI RPSI", "RASI RPSI", "LASI LPSI", "C7 CLAV"),
    ("LASI RASI SACR", "RASI", "LASI", "C7 CLAV"),
    ("LASI RASI SACR", "RASI", "LASI", "LSHO RSHO"),
)
_NEAR_TORSO = frozenset(
    """
    rhipjoint lhipjoint rclavicle lclavicle RightUpLeg LeftUpLeg RightHip LeftHip
    RightShoulder LeftShoulder RightCollar LeftCollar RSHO LSHO
    """.split()  # noqa: SIM905
)


@dataclass(frozen=True, kw_only=True)
class BodyParts:
    """Which markers make up a body and its frame.

    parts: markers of TO (torso and head), LA, RA (arms), LL, RL (legs); every marker in one part. origin, right, left,
    top: markers whose mean is the root, the right and left hip, and the neck. torso: markers that tell where those are
    when they are lost.
    """

    parts: Mapping[str, tuple[str, ...]]
    origin: tuple[str, ...]
    right: tuple[str, ...]
    left: tuple[str, ...]
    top: tuple[str, ...]
    torso: tuple[str, ...]

    @property
    def markers(self) -> tuple[str, ...]:
        """All markers, part after part."""
        return tuple(name for part in PARTS for name in self.parts[part])

    @property
    def landmarks(self) -> tuple[tuple[str, ...], ...]:
        """Origin, right hip, left hip, neck."""
        return self.origin, self.right, self.left, self.top

    def as_mapping(self) -> dict[str, Any]:
        """What ``from_mapping`` reads."""
        frame = {name: list(getattr(self, name)) for name in (*LANDMARKS, "torso")}
        return {**{part: list(self.parts[part]) for part in PARTS}, "frame": frame}


def bare_names(markers: Iterable[str]) -> tuple[str, ...]:
    """Marker names without their subject; raises UsageError where two become the same."""
    names = tuple(subject_of(marker)[1] for marker in markers)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"a dictionary is of one body: markers must have distinct names. Got {_list(twice)} twice.")
    return names


def known_parts(markers: Iterable[str]) -> BodyParts:
    """The parts of a marker set by name: CMU joints, common marker sets, joints as common BVH exporters call them.

    Raises UsageError with the markers that no part is known for, or when the hips and the neck cannot be told.
    """
    names = bare_names(markers)
    found = {name: _part_of(name) for name in names}
    unknown = [name for name, part in found.items() if part is None]
    if unknown:
        raise UsageError(
            f"every marker must belong to a part of the body. Got {_list(unknown)}; assign them with --body-parts, or "
            "leave them out with --exclude."
        )
    frame = next((f for f in (tuple(map(str.split, line)) for line in _FRAMES) if set().union(*f) <= set(names)), None)
    if frame is None:
        raise UsageError(
            "the hips and the neck must be known by name for a frame that travels with the body. Give --body-parts "
            "with a frame: origin, right, left and top."
        )
    torso = [name for name in names if found[name] == "TO" or name in _NEAR_TORSO or name in set().union(*frame)]
    return BodyParts(
        parts={part: tuple(name for name in names if found[name] == part) for part in PARTS},
        **{key: tuple(group) for key, group in zip(LANDMARKS, frame, strict=True)},
        torso=tuple(torso),
    )


def _part_of(name: str) -> str | None:
    plain = name.replace("_", "").lower()
    if plain in _TORSO:
        return "TO"
    for prefix, side in _SIDES.items():
        stem = plain.removeprefix(prefix)
        if stem != plain:
            if stem in _ARM or _FINGER.fullmatch(stem):
                return f"{side}A"
            if stem in _LEG:
                return f"{side}L"
    return None


def from_mapping(mapping: Any, source: str) -> BodyParts:
    """The parts that a user wrote down: lists of names under TO, LA, RA, LL, RL, and ``frame``.

    frame: lists of names under origin, right, left and top; and torso, else the markers of TO and of the frame.
    source: what to call it in a message. Raises UsageError for what is unknown, missing or given twice.
    """
    tree = _section(mapping, source, (*PARTS, "frame"))
    frame = _section(tree.get("frame"), f"{source}: frame", (*LANDMARKS, "torso"))
    parts = {part: _names(tree.get(part, []), f"{source}: {part}") for part in PARTS}
    groups = {name: _names(frame.get(name, []), f"{source}: frame.{name}") for name in LANDMARKS}
    markers = [name for part in PARTS for name in parts[part]]
    used = [name for group in groups.values() for name in group]
    torso = _names(frame.get("torso", []), f"{source}: frame.torso") or parts["TO"]
    twice = sorted({name for name in markers if markers.count(name) > 1})
    if twice:
        raise UsageError(f"{source}: a marker must belong to one part. Got {_list(twice)} twice.")
    empty = [name for name in LANDMARKS if not groups[name]]
    if empty:
        raise UsageError(f"{source}: frame must name the markers of {', '.join(LANDMARKS)}. Got none for {empty[0]}.")
    stray = [name for name in (*used, *torso) if name not in markers]
    if stray:
        raise UsageError(f"{source}: the markers of the frame must belong to parts. Got {_list(stray)}.")
    return BodyParts(parts=parts, **groups, torso=tuple(dict.fromkeys((*torso, *used))))


def _section(tree: Any, source: str, keys: tuple[str, ...]) -> Mapping[str, Any]:
    if not isinstance(tree, Mapping):
        raise UsageError(f"{source} must be a mapping of {', '.join(keys)} to names of markers. Got {tree!r}.")
    unknown = [str(key) for key in tree if key not in keys]
    if unknown:
        raise UsageError(f"{source}: keys must be among {', '.join(keys)}. Got {_list(unknown)}.")
    return tree


def _names(value: Any, source: str) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
        raise UsageError(f"{source} must be a list of names of markers. Got {value!r}.")
    return tuple(value)


def _list(names: Iterable[str]) -> str:
    kept = list(names)
    return ", ".join(kept[:12]) + (f" and {len(kept) - 12} more" if len(kept) > 12 else "")
