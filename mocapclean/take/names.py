"""Names of markers, joints and channels: subjects, patterns with wildcards, and names that are nearly alike."""

from collections.abc import Sequence
from difflib import get_close_matches
from fnmatch import fnmatchcase

from mocapclean.geometry.skeleton import Skeleton

# Characters that make a name a pattern for ``matching_columns``.
WILDCARDS = frozenset("*?[")
# Most names that a message suggests; chosen by hand.
MOST_SUGGESTIONS = 3
# The end of a pattern that is a joint with all below it.
SUBTREE = "/*"
# Names for several channels of a joint.
KINDS = {"rotation": "?rotation", "translation": "?position", "position": "?position"}


def split_subject(marker: str) -> tuple[str, str]:
    """Return the subject and the bare name of ``Subject:NAME``; the subject of a name without a colon is ""."""
    subject, _, name = marker.rpartition(":")
    return subject, name


def bare_name(marker: str) -> str:
    """Return the name of a marker without its subject."""
    return split_subject(marker)[1]


def is_pattern(name: str) -> bool:
    """Whether a name has wildcards: ``*``, ``?`` or ``[``."""
    return bool(set(name) & WILDCARDS)


def matching_columns(pattern: str, markers: Sequence[str]) -> list[int]:
    """Return the columns of the markers that a pattern matches, with or without their subjects.

    ``*``, ``?`` and ``[...]`` are wildcards as in ``fnmatch``, and case counts. A marker whose name is the pattern
    itself always matches.
    """
    return [
        column
        for column, marker in enumerate(markers)
        if marker == pattern or fnmatchcase(marker, pattern) or fnmatchcase(bare_name(marker), pattern)
    ]


def similar_names(name: str, markers: Sequence[str], *, cutoff: float = 0.6) -> list[str]:
    """Return up to 3 markers whose names are most like a name, best first; none below the ``cutoff``.

    Names that differ in case only, with or without their subject, come first. cutoff: the least ratio of
    ``difflib.SequenceMatcher`` without regard to case, from 0 to 1.
    """
    folded = name.casefold()
    same = [marker for marker in markers if folded in (marker.casefold(), bare_name(marker).casefold())]
    spelled: dict[str, list[str]] = {}
    for marker in markers:
        spelled.setdefault(marker.casefold(), []).append(marker)
    near = get_close_matches(folded, spelled, n=MOST_SUGGESTIONS, cutoff=cutoff)
    return list(dict.fromkeys([*same, *(marker for text in near for marker in spelled[text])]))[:MOST_SUGGESTIONS]


def matching_joints(pattern: str, skeleton: Skeleton) -> list[int]:
    """Return the joints of a skeleton that a pattern matches, as ``matching_columns`` does.

    ``LeftArm/*`` is the joint with all joints below it. A pattern with a subject that no joint has, such as
    ``mixamorig:Hips``, also matches joints that have no subject.
    """
    columns = matching_columns(pattern, skeleton.names)
    if not columns and pattern.endswith(SUBTREE):
        return _with_all_below(matching_joints(pattern.removesuffix(SUBTREE), skeleton), skeleton)
    subject, name = split_subject(pattern)
    if not columns and subject:
        subjects = [split_subject(joint)[0] for joint in skeleton.names]
        if not any(fnmatchcase(own, subject) for own in subjects if own):
            columns = [joint for joint in matching_columns(name, skeleton.names) if not subjects[joint]]
    return columns


def _with_all_below(joints: list[int], skeleton: Skeleton) -> list[int]:
    """Return joints and all that hang on them; a joint comes after its parent."""
    inside = set(joints)
    for joint, parent in enumerate(skeleton.parents):
        if parent in inside:
            inside.add(joint)
    return sorted(inside)


def matching_channels(pattern: str, skeleton: Skeleton) -> list[int]:
    """Return the channels that a pattern names: those of the joints it matches, or single ones.

    ``LeftFoot.Zrotation`` is a channel, ``LeftFoot.*rotation`` and ``LeftFoot.rotation`` are three. The case of the
    channel does not count. The joint before the last dot is a pattern of ``matching_joints``, a subtree too. A joint
    whose own name has a dot comes first.
    """
    joints = set(matching_joints(pattern, skeleton))
    if joints:
        return [index for index, channel in enumerate(skeleton.channels) if channel.joint in joints]
    joint, dot, word = pattern.rpartition(".")
    word = word.lower()
    joints = set(matching_joints(joint, skeleton)) if dot and word else set()
    return [
        index
        for index, channel in enumerate(skeleton.channels)
        if channel.joint in joints and fnmatchcase(channel.name.lower(), KINDS.get(word, word))
    ]
