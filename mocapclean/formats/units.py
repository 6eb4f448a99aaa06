"""The unit of length of a skeleton whose file states none, by the size that each unit would give its body.

A body is known by the names of its joints or, without telling names, by two pairs of equal limbs. Its stature follows
from the path from an ankle to the head, which no pose changes. Of the units that captures are published in, the one is
taken that makes stature and unit likeliest together. A hand alone, a prop or an animal has no known scale.
"""

import math
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.numerics.robust import median
from mocapclean.take.names import bare_name

UNITS = {
    "cm": (10.0, 0.60),
    "m": (1000.0, 0.12),
    "in": (25.4, 0.10),
    "CMU's unit": (25.4 / 0.45, 0.08),
    "mm": (1.0, 0.06),
    "dm": (100.0, 0.03),
    "ft": (304.8, 0.01),
}
"""Millimetres of each unit, and its share of published BVH files. The shares are chosen by hand: they decide only
between units that both give a human stature."""
STATURE = 1700.0
"""Millimetres: the stature of a typical adult (NCD-RisC, 2016, doi:10.7554/eLife.13410: 1.6 m and 1.7 m)."""
SHORTER, TALLER = 0.25, 0.12
"""Standard deviations of ln(stature) below and above: children and game characters are short, giants rare. By hand."""
SMALLEST, LARGEST = 800.0, 2400.0
"""Millimetres: statures that are human, from a child of two years to the tallest people. Chosen by hand."""
PER_PATH = 1.1
"""Stature per path from an ankle to the head joint: the ankle and the skull are beyond its ends, its turn at the hips
takes some of that back. Chosen by hand from the proportions of D. Winter, Biomechanics, 2009, figure 4.1."""
PER_DIAMETER = 0.78
"""Stature per longest path between two joints, from a hand to a foot. As above."""
AMBIGUOUS = 0.1
"""Likelihood of the second unit per that of the first from which the note names both. Chosen by hand."""
EQUAL_LIMBS = 0.05
"""Relative difference of the lengths of two limbs that are a pair. Chosen by hand: exporters make them equal."""
LIMB_BONES = 2
"""Bones that a limb has at least below its first joint. Chosen by hand: a forearm and a hand, a shin and a foot."""
LIMB_SHARE = 0.2
"""Least length of a limb per longest path between two joints. Chosen by hand: an arm has a quarter."""

ANKLE = re.compile(r"foot|ankle|talus")
LEG = re.compile(r"leg|thigh|knee|shin|calf|tibia|femur|hip_?joint|foot|ankle")
ARM = re.compile(r"arm(?!ature)|elbow|hand|wrist|humerus|radius|shoulder|clavicle|collar")
HEAD = re.compile(r"head|skull")
NECK = re.compile(r"neck")
TRUNK = re.compile(r"spine|chest|abdomen|torso|pelvis|hips|\bhip\b|waist|thorax")
FINGER = re.compile(r"finger|thumb|index|pinky|metacarp")
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""A word within a name in camel case or with other marks between."""
ANIMAL = {"tail", "wing", "hoof", "paw", "tentacle", "antenna", "pincer", "claw", "snout", "beak", "hind", "fetlock"}
WORN = {"pony", "pig", "hair", "braid", "coat", "cape", "dress", "skirt", "shirt"}
"""Words beside which a tail is no animal's."""


@dataclass(frozen=True, kw_only=True)
class BodyScale:
    """The unit of length of a skeleton.

    millimetres: of one unit. is_known: whether the user gave it or a body shows it; else lengths in millimetres mean
    nothing. reason: why, as a note has it. stature: estimated, mm; None without a body.
    """

    millimetres: float
    is_known: bool
    reason: str
    stature: float | None = None


def given_scale(unit: float) -> BodyScale:
    """Return the scale of a unit that the user gave."""
    return BodyScale(millimetres=unit, is_known=True, reason="as given")


def body_scale(names: Sequence[str], parents: Sequence[int], offsets: Floats, default: float) -> BodyScale:
    """Return the unit of length of a skeleton that states none.

    names, parents: of J joints, -1 for the parent of a root. offsets: (J, 3) from the parent, in the file's unit.
    default: millimetres, taken where no unit makes the skeleton a human body.
    """
    lengths = [0.0 if parent < 0 else float(np.linalg.norm(offsets[j])) for j, parent in enumerate(parents)]
    bodies = [size for tree in _trees(parents) if (size := _stature(tree, names, parents, lengths)) is not None]
    if not bodies:
        reason = "the skeleton is not known as that of a human body, so that its scale is unknown"
        return BodyScale(millimetres=default, is_known=False, reason=reason)
    size = median(np.array(bodies))
    fitting = {name: unit for name, (unit, _) in UNITS.items() if SMALLEST <= size * unit <= LARGEST}
    if not fitting:
        reason = f"no usual unit gives its body of {size:.3g} units a human size, so that its scale is unknown"
        return BodyScale(millimetres=default, is_known=False, reason=reason)
    first, *others = sorted(fitting, key=lambda name: _likelihood(name, size), reverse=True)
    unit = fitting[first]
    reason = f"the body is then about {size * unit / 1e3:.2f} m tall ({first})"
    if others and _likelihood(others[0], size) > AMBIGUOUS * _likelihood(first, size):
        reason += f", likelier than {size * fitting[others[0]] / 1e3:.2f} m ({others[0]})"
    return BodyScale(millimetres=unit, is_known=True, reason=reason, stature=size * unit)


def _likelihood(name: str, size: float) -> float:
    """Return the likelihood of a unit and the stature of so many units: the unit's share times a skew log-normal."""
    unit, share = UNITS[name]
    off = math.log(size * unit / STATURE)
    return share * math.exp(-0.5 * (off / (SHORTER if off < 0 else TALLER)) ** 2)


def _trees(parents: Sequence[int]) -> list[list[int]]:
    """Return the joints below each root, the root first; a joint comes after its parent."""
    trees: dict[int, list[int]] = {}
    root_of: list[int] = []
    for joint, parent in enumerate(parents):
        root_of.append(joint if parent < 0 else root_of[parent])
        trees.setdefault(root_of[joint], []).append(joint)
    return list(trees.values())


def _stature(tree: list[int], names: Sequence[str], parents: Sequence[int], lengths: list[float]) -> float | None:
    """Return the stature of a tree in the file's unit, or None if the tree is no human body."""
    words = {joint: bare_name(names[joint]).lower() for joint in tree}

    def named(pattern: re.Pattern[str]) -> list[int]:
        return [joint for joint in tree if pattern.search(words[joint])]

    if any(_is_animal(bare_name(names[joint])) for joint in tree):
        return None
    heads, ankles = named(HEAD) or named(NECK), named(ANKLE)
    legs, arms, trunk = named(LEG), named(ARM), named(TRUNK)
    pairs = _paired_limbs(tree, parents, lengths)
    # Without arms it is a body if it has two legs and, beside a head, no other limbs: with four it is an animal.
    two_legged = legs and trunk and (pairs == 1 or (pairs > 1 and not heads))
    is_body = bool((arms and (legs or (heads and trunk))) or two_legged)
    # Of each side the first joint of the name counts: below it are toes, eyes and ends.
    paths = [_path(heads[0], ankle, parents, lengths) for ankle in ankles if heads and parents[ankle] not in ankles]
    if is_body and paths and max(paths) > 0:
        return PER_PATH * median(np.array(paths))
    tells_nothing = not (legs or arms or trunk or heads or named(FINGER))
    if is_body or (tells_nothing and pairs >= 2):
        return PER_DIAMETER * _diameter(tree, parents, lengths) or None
    return None


def _is_animal(name: str) -> bool:
    """Whether a joint's name is that of a part which people do not have."""
    words = {word.lower() for word in WORD.findall(name)}
    return bool((words | {word.removesuffix("s") for word in words}) & ANIMAL) and not words & WORN


def _path(first: int, second: int, parents: Sequence[int], lengths: list[float]) -> float:
    """Return the length of the path between two joints of a tree."""
    total = 0.0
    # The joint that comes later in the file cannot be an ancestor of the other.
    while first != second:
        later = max(first, second)
        total += lengths[later]
        first, second = min(first, second), parents[later]
    return total


def _reach(tree: list[int], parents: Sequence[int], lengths: list[float]) -> tuple[dict[int, float], dict[int, int]]:
    """Return for each joint the length of the longest path down from it, and the number of bones of the deepest."""
    reach, depth = dict.fromkeys(tree, 0.0), dict.fromkeys(tree, 0)
    for joint in reversed(tree[1:]):
        reach[parents[joint]] = max(reach[parents[joint]], lengths[joint] + reach[joint])
        depth[parents[joint]] = max(depth[parents[joint]], 1 + depth[joint])
    return reach, depth


def _diameter(tree: list[int], parents: Sequence[int], lengths: list[float]) -> float:
    """Return the length of the longest path between two joints of a tree."""
    reach, _ = _reach(tree, parents, lengths)
    arms: dict[int, list[float]] = defaultdict(lambda: [0.0, 0.0])
    for joint in tree[1:]:
        arms[parents[joint]].append(lengths[joint] + reach[joint])
    return max((sum(sorted(own)[-2:]) for own in arms.values()), default=0.0)


def _paired_limbs(tree: list[int], parents: Sequence[int], lengths: list[float]) -> int:
    """Return the number of joints that hold a pair of equally long limbs."""
    reach, depth = _reach(tree, parents, lengths)
    shortest = LIMB_SHARE * _diameter(tree, parents, lengths)
    limbs: dict[int, list[float]] = defaultdict(list)
    for joint in tree[1:]:
        if depth[joint] >= LIMB_BONES and reach[joint] > shortest:
            limbs[parents[joint]].append(reach[joint])
    return sum(
        any(longer - shorter <= EQUAL_LIMBS * longer for shorter, longer in pairwise(own))
        for own in map(sorted, limbs.values())
    )
