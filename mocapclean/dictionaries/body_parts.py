"""The five parts of a body and the markers of its frame of reference, by their names or from the user."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mocapclean.errors import UsageError
from mocapclean.take.names import bare_name

# Torso and head, left and right arm, left and right leg: Z. Wang et al., 2016.
PARTS = ("TO", "LA", "RA", "LL", "RL")
# Root, right hip, left hip, neck.
LANDMARKS = ("origin", "right", "left", "top")

# Names of markers and joints, in lower case and without underscores; those of arms and legs also without their side.
# The first line of each set has the joints of the CMU Graphics Lab's skeletons, the second those of common BVH
# exporters, the third the markers of the Vicon and Plug-in Gait full-body sets.
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

# Markers of the landmarks for a known skeleton or marker set; the first line whose markers a take has is used. Two hips
# that BVH exporters call differently, and two sets of pelvis markers, have a line each.
_LANDMARK_SETS = (
    ("root", "rhipjoint", "lhipjoint", "thorax"),
    ("Hips", "RightUpLeg", "LeftUpLeg", "Neck"),
    ("Hips", "RightUpLeg", "LeftUpLeg", "Head"),
    ("Hips", "RightHip", "LeftHip", "Neck"),
    ("LFWT RFWT LBWT RBWT", "RFWT RBWT", "LFWT LBWT", "C7 CLAV"),
    ("LASI RASI LPSI RPSI", "RASI RPSI", "LASI LPSI", "C7 CLAV"),
    ("LASI RASI SACR", "RASI", "LASI", "C7 CLAV"),
    ("LASI RASI SACR", "RASI", "LASI", "LSHO RSHO"),
)
# Joints of the arms and legs that lie on the torso, and so help to locate it.
_TORSO_NEIGHBOURS = frozenset(
    """
    rhipjoint lhipjoint rclavicle lclavicle RightUpLeg LeftUpLeg RightHip LeftHip
    RightShoulder LeftShoulder RightCollar LeftCollar RSHO LSHO
    """.split()  # noqa: SIM905
)


@dataclass(frozen=True, kw_only=True)
class BodyParts:
    """The markers of a body's parts and of its frame of reference.

    parts: markers of TO (torso and head), LA, RA (arms), LL, RL (legs); every marker is in one part. origin, right,
    left, top: markers whose mean is the root, the right hip, the left hip and the neck. torso: markers that locate
    these landmarks where they are missing.
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
        """Return the mapping that ``from_mapping`` reads."""
        frame = {name: list(getattr(self, name)) for name in (*LANDMARKS, "torso")}
        return {**{part: list(self.parts[part]) for part in PARTS}, "frame": frame}


def distinct_bare_names(markers: Iterable[str]) -> tuple[str, ...]:
    """Return the marker names without their subjects; raise UsageError where two are then the same."""
    names = tuple(bare_name(marker) for marker in markers)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise UsageError(f"a dictionary is of one body: markers must have distinct names. Got {_list(twice)} twice.")
    return names


def known_parts(markers: Iterable[str]) -> BodyParts:
    """Return the parts of a marker set by name: CMU joints, common marker sets, and the joints of BVH exporters.

    Raises UsageError with the markers whose part is unknown, or when no set of hip and neck markers is complete.
    """
    names = distinct_bare_names(markers)
    part_of = {name: _part_of(name) for name in names}
    unknown = [name for name, part in part_of.items() if part is None]
    if unknown:
        raise UsageError(
            f"every marker must belong to a part of the body. Got {_list(unknown)}; assign them with --body-parts, or "
            "leave them out with --exclude."
        )
    landmarks = next(
        (groups for line in _LANDMARK_SETS if set().union(*(groups := tuple(map(str.split, line)))) <= set(names)), None
    )
    if landmarks is None:
        raise UsageError(
            "the hips and the neck must be known by name for a frame that travels with the body. Give --body-parts "
            "with a frame: origin, right, left and top."
        )
    used = set().union(*landmarks)
    torso = [name for name in names if part_of[name] == "TO" or name in _TORSO_NEIGHBOURS or name in used]
    return BodyParts(
        parts={part: tuple(name for name in names if part_of[name] == part) for part in PARTS},
        **{key: tuple(group) for key, group in zip(LANDMARKS, landmarks, strict=True)},
        torso=tuple(torso),
    )


def _part_of(name: str) -> str | None:
    """Return the part of a known marker or joint; None if it is unknown."""
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
    """Return the parts that a user's mapping gives: lists of names under TO, LA, RA, LL, RL, and ``frame``.

    frame: lists of names under origin, right, left and top; and under torso, by default the markers of TO and of the
    frame. source: the name of the mapping in messages. Raises UsageError for unknown keys, missing landmarks, and
    markers that are given twice or in no part.
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
    """Return the tree if it is a mapping with no other keys than these; raise UsageError otherwise."""
    if not isinstance(tree, Mapping):
        raise UsageError(f"{source} must be a mapping of {', '.join(keys)} to names of markers. Got {tree!r}.")
    unknown = [str(key) for key in tree if key not in keys]
    if unknown:
        raise UsageError(f"{source}: keys must be among {', '.join(keys)}. Got {_list(unknown)}.")
    return tree


def _names(value: Any, source: str) -> tuple[str, ...]:
    """Return a list of names as a tuple; raise UsageError for anything else."""
    if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
        raise UsageError(f"{source} must be a list of names of markers. Got {value!r}.")
    return tuple(value)


def _list(names: Iterable[str]) -> str:
    """Return the first 12 names as text, and the number of the others."""
    kept = list(names)
    return ", ".join(kept[:12]) + (f" and {len(kept) - 12} more" if len(kept) > 12 else "")
