"""The bones of a take: those of its skeleton, or the pairs of its markers that keep their distance."""

from collections import defaultdict

import numpy as np

from mocapclean.errors import UsageError
from mocapclean.geometry.distances import robust_distances
from mocapclean.geometry.skeleton import Bone, Skeleton, settled
from mocapclean.take import Take
from mocapclean.take.names import bare_name, split_subject

# What makes a pair of markers rigid; chosen by hand, no sweep was kept.
_FEWEST_FRAMES = 30  # frames in which both markers must be trusted
_LARGEST_SD = 3.0  # mm, robust SD of the distance
_LARGEST_DISTANCE = 800.0  # mm, longer than any segment of a body
_PARTNERS = 3  # most pairs that each marker contributes
_SD_PER_DISTANCE = 0.01  # mm of SD that weigh as much as 1 mm of distance in the order of a marker's pairs


def bones_of(take: Take) -> tuple[str, tuple[Bone, ...]]:
    """Return "skeleton" or "rigid pairs", the source of the take's bones, and the bones by marker name.

    Of a take with poses, joints whose position channels never change have bones, those whose channels change have none.
    """
    if take.skeleton is not None:
        skeleton = take.skeleton
        if take.poses is not None and take.known is not None:
            skeleton = settled(skeleton, np.where(take.known, take.poses, np.nan))
        return "skeleton", known_bones(take.markers, skeleton)
    return "rigid pairs", rigid_pairs(take)


def known_bones(markers: tuple[str, ...], skeleton: Skeleton) -> tuple[Bone, ...]:
    """Return the skeleton's bones between markers with the names of its joints, for every subject.

    A marker ``Subject:NAME`` is that subject's joint NAME.
    """
    subjects: dict[str, dict[str, str]] = defaultdict(dict)
    for marker in markers:
        subject, name = split_subject(marker)
        subjects[subject][name] = marker
        subjects[subject].setdefault(marker, marker)
    return tuple(
        Bone(start=own[bone.start], end=own[bone.end], length=bone.length)
        for own in subjects.values()
        for bone in skeleton.bones()
        if bone.start in own and bone.end in own
    )


def check_names(markers: tuple[str, ...], skeleton: Skeleton) -> None:
    """Raise UsageError when no marker has the name of a joint of the skeleton."""
    names = {bare_name(marker) for marker in markers} | set(markers)
    if not names & set(skeleton.names):
        raise UsageError(
            f"the skeleton must share names with the take. Its joints are {_some(skeleton.names)}; "
            f"the take has {_some(markers)}."
        )


def _some(names: tuple[str, ...]) -> str:
    """Return the first names as text, and the number of the others."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def rigid_pairs(take: Take) -> tuple[Bone, ...]:
    """Return the pairs of markers whose distance has a robust SD of at most 3 mm, up to 3 for each marker.

    Length and spread are the median and the robust SD of the distance, over up to 300 evenly spaced frames. Both
    markers must be trusted in at least 30 of these, and at most 800 mm apart.
    """
    if len(take.trusted) < 2:  # one frame has no variation to measure
        return ()
    median, spread = robust_distances(take.positions, take.trusted, _FEWEST_FRAMES)
    rigid = (spread <= _LARGEST_SD) & (median <= _LARGEST_DISTANCE) & (median > 0)
    chosen = set()
    for marker in range(len(take.markers)):
        partners = np.flatnonzero(rigid[marker])
        looseness = spread[marker, partners] + _SD_PER_DISTANCE * median[marker, partners]
        best = partners[np.argsort(looseness, kind="stable")]
        chosen |= {(min(marker, int(p)), max(marker, int(p))) for p in best[:_PARTNERS]}
    return tuple(
        Bone(start=take.markers[a], end=take.markers[b], length=float(median[a, b]), spread=float(spread[a, b]))
        for a, b in sorted(chosen)
    )
