"""The bones of a take: from its skeleton, or the pairs of markers that the take itself shows to be rigid."""

from collections import defaultdict

import numpy as np

from mocapclean.errors import UsageError
from mocapclean.geometry.distances import robust_distances
from mocapclean.geometry.skeleton import Bone, Skeleton
from mocapclean.take import Take

_FEWEST_TOGETHER = 30
_LARGEST_SPREAD = 3.0
_LONGEST = 800.0
_PARTNERS = 3


def subject_of(marker: str) -> tuple[str, str]:
    """Split ``Subject:NAME`` into the subject ("" without one) and the bare name."""
    subject, _, name = marker.rpartition(":")
    return subject, name


def bones_of(take: Take) -> tuple[str, tuple[Bone, ...]]:
    """The take's bones by marker name, and where they come from: "skeleton" or "rigid pairs"."""
    if take.skeleton is not None:
        return "skeleton", known_bones(take.markers, take.skeleton)
    return "rigid pairs", rigid_pairs(take)


def known_bones(markers: tuple[str, ...], skeleton: Skeleton) -> tuple[Bone, ...]:
    """The skeleton's bones between markers that bear its joints' names, for every subject (``Subject:`` prefix)."""
    subjects: dict[str, dict[str, str]] = defaultdict(dict)
    for marker in markers:
        subject, name = subject_of(marker)
        subjects[subject][name] = marker
        subjects[subject].setdefault(marker, marker)
    return tuple(
        Bone(start=own[bone.start], end=own[bone.end], length=bone.length)
        for own in subjects.values()
        for bone in skeleton.bones()
        if bone.start in own and bone.end in own
    )


def check_names(markers: tuple[str, ...], skeleton: Skeleton) -> None:
    """Raise UsageError when no marker bears the name of a joint of the skeleton."""
    names = {subject_of(marker)[1] for marker in markers} | set(markers)
    if not names & set(skeleton.names):
        raise UsageError(
            f"the skeleton must share names with the take. Its joints are {_some(skeleton.names)}; "
            f"the take has {_some(markers)}."
        )


def _some(names: tuple[str, ...]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def rigid_pairs(take: Take) -> tuple[Bone, ...]:
    """Pairs of markers whose distance stays within 3 mm (robust SD) over the take, up to 3 for each marker.

    Length and spread are the median and the robust SD of the distance over up to 300 frames in which both are trusted;
    at least 30 such frames, and a distance of 800 mm at most, are asked for.
    """
    if len(take.trusted) < 2:  # one frame shows no distance to be constant
        return ()
    median, spread = robust_distances(take.positions, take.trusted, _FEWEST_TOGETHER)
    good = (spread <= _LARGEST_SPREAD) & (median <= _LONGEST) & (median > 0)
    chosen = set()
    for marker in range(len(take.markers)):
        partners = np.flatnonzero(good[marker])
        nearest = partners[np.argsort(spread[marker, partners] + 0.01 * median[marker, partners], kind="stable")]
        chosen |= {(min(marker, int(p)), max(marker, int(p))) for p in nearest[:_PARTNERS]}
    return tuple(
        Bone(start=take.markers[a], end=take.markers[b], length=float(median[a, b]), spread=float(spread[a, b]))
        for a, b in sorted(chosen)
    )
