"""What the points of a C3D file are: captured markers, unlabelled trajectories, or what a model computed.

A C3D file stores everything as points: markers, trajectories that nobody labelled, outputs of gait models, angles,
forces. Only captured markers are to be judged and filled. A computed point follows its markers exactly. As a neighbour
of one of them it would repeat an error of it, and would make every check of a fill look better than it is.

Names decide first, then the positions of what is left. Sources of names: the manuals of Vicon Plug-in Gait, of the
Oxford Foot Model and of the makers named in the table, and the labels of the shared captures.
"""

import re
from collections.abc import Sequence
from enum import Enum

import numpy as np

from mocapclean.arrays import Bools, Floats, evenly_spaced
from mocapclean.formats.c3d.header import Parameters
from mocapclean.numerics.robust import nan_median
from mocapclean.take.names import bare_name


class Kind(Enum):
    """What a point is; the value is the phrase of reports."""

    CAPTURED = "captured"
    UNLABELLED = "without a label"
    LISTED = "listed as angles, forces or the like"
    QUANTITY = "named as angles, forces or the like"
    MODEL_OUTPUT = "named as outputs of a model"
    COMPUTED = "exact functions of other points"
    NEVER_SEEN = "never seen"


PLACES = frozenset({Kind.MODEL_OUTPUT, Kind.COMPUTED})
"""Kinds of points that are places computed from markers or from force plates."""
QUANTITY_KINDS = frozenset({Kind.LISTED, Kind.QUANTITY})
"""Kinds of points that hold angles, forces or the like."""
MOVES_ALONE = QUANTITY_KINDS | {Kind.UNLABELLED}
"""Kinds of points that no other point bears out."""

NOT_MARKERS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters of the group POINT that list points which are computed, not captured (C3D user guide, type groups)."""

NUMBER = r"(?:[ _\-:.*#]*\d+)?"
"""The number behind the word for a trajectory without a label, with whatever is between them."""
UNLABELLED = (
    ("Vicon", r"\*\d+"),
    ("Vicon Nexus, in .trc files", r"C_\d+"),
    ("Qualisys", rf"|(?:unidentified|new \d{{4}}){NUMBER}"),
    ("OptiTrack", rf"(?:unlabell?ed|unassigned){NUMBER}"),
    ("Mokka and BTK", rf"uname{NUMBER}"),
    ("Motion Analysis", rf"U_\d+|unnamed{NUMBER}"),
    ("others", rf"(?:untitled|unknown|undefined|no[ _]?name|no[ _]?label|ghost|traj(?:ectory)?){NUMBER}"),
)
"""Makers, and how they name a trajectory that nobody labelled; the case is ignored. Qualisys leaves the name empty."""

AXES = "OALP"
"""The last letters of the four points of a segment's axes: origin, anterior, lateral, proximal (Plug-in Gait)."""
SEGMENTS = re.compile(r"PEL|TRX|THX|HED|SPI|[LR](?:FE|TI|TB|FO|TO|CL|HU|RA|HN)")
"""Segments of Plug-in Gait, of which two points of the axes are enough; of any other name all four are needed."""
FOOT_MODEL = re.compile(r"[LR](?:HDF|FOF)0")
"""Origins of the hindfoot and the forefoot, by which files with outputs of the Oxford Foot Model are known."""
FOOT_OUTPUTS = re.compile(r"[LR](?:HDF|FOF|HLX|TIB|D1M|HE|ANK)\d|[LR](?:PROXFF|HFplantar)|PEL0")
"""Outputs of the Oxford Foot Model; LTIB1 and the like can be markers in other files."""
MODEL_OUTPUTS = re.compile(
    "|".join(
        (
            r"(?i:.*cent(?:er|re)[ _]?of[ _]?(?:mass|gravity|pressure).*)",
            r"(?i:(?:.*[ _.]|wholebody)?[lr]?co[mgp][ _]?(?:\d+|[lr]|floor)?)|.*[a-z]CO[MGP]\d?",
            r".*JC\d?",
            r"[LR][HKASEW]JC\w*",
            r"(?i:.*(?:hip|knee|ankle|shoulder|elbow|wrist|joint)[ _.]*(?:joint[ _.]*)?cent(?:er|re).*)",
            r"(?i:.*(?:hip|knee|ankle|shoulder|elbow|wrist)[ _.]*joint.*)",
            r"(?i:virtual.*)",
            r"AXIS[XYZ]\w+|ORIGIN\w+|[oxyz]_Global",
            r"proj[LR][A-Z]\w+|[LR]?ViconLegLength|[LR]?ArchHeight(?:Index)?",
        )
    )
)
"""Centres of mass and pressure, joint centres, axes, projections: points that a model computes."""
QUANTITIES = re.compile(
    r"(?i:.*(?:(?<!tri)(?<!rect)angles?|moments?|powers?|torques?)(?:[ _]?(?:\d+|[xyzlr]))?"
    r"|.*(?:force(?!.?plate)|grf|grm).*)"
)
"""Names of what is no place at all; TRIANGLE and a corner of a force plate are places."""

EXACT = 0.02
"""mm from its median, within which a distance is constant. Chosen by hand: markers never keep a distance as exactly as
that while they move, computed points do. Some of the shared captures do so at rest; see LEAST_MOTION."""
EXACT_SHARE = 0.9
"""Share of the frames in which a constant distance is so. Chosen by hand: in some a marker may have been repaired after
the point was computed."""
LEAST_MOTION = 10.0
"""mm, RMS distance of a point from its mean position, below which a constant distance proves nothing. Chosen by hand:
markers at rest on the shared captures keep a distance within 0.01 mm and move by less than 6 mm."""
LEAST_SEEN = 20
"""Frames in which two points must be seen for their distance to count, and a point for a constant coordinate.
Chosen by hand."""
TRIED_FRAMES = 600
"""Frames from which the SD of a distance is computed. Chosen for speed."""
MOST_EXACT = 0.5
"""Share of the points above which constant distances show nothing, because all belong to one skeleton: by the meaning
of a majority."""


def kinds_by_name(labels: Sequence[str], parameters: Parameters) -> list[Kind]:
    """Return the kind of every point by what the file lists and by its label; "" is a label that was left empty.

    A label counts as listed with or without its ``Subject:`` prefix on either side. Labels that are all empty show
    nothing.
    """
    listed = _listed(parameters)
    bare_listed = {bare_name(label) for label in listed if ":" in label}
    names = {bare_name(label) for label in labels}
    has_labels = any(labels)

    def kind(label: str) -> Kind:
        if {label, bare_name(label)} & listed or (":" not in label and label in bare_listed):
            return Kind.LISTED
        return kind_by_label(label, names) if label or has_labels else kind_by_name(label, names)

    return [kind(label) for label in labels]


def kind_by_label(label: str, names: set[str]) -> Kind:
    """Return the kind of a point by its label, which may be that of an unlabelled trajectory; names: see below."""
    return Kind.UNLABELLED if is_unlabelled(label) else kind_by_name(label, names)


def kind_by_name(label: str, names: set[str]) -> Kind:
    """Return the kind of a labelled point, given the names of all points without their subjects."""
    name = bare_name(label)
    if is_model_output(name, names):
        return Kind.MODEL_OUTPUT
    return Kind.QUANTITY if QUANTITIES.fullmatch(name) else Kind.CAPTURED


def is_unlabelled(label: str) -> bool:
    """Whether a label is one that a maker's program gives to a trajectory that nobody labelled."""
    return any(
        re.fullmatch(pattern, text, re.IGNORECASE)
        for _, pattern in UNLABELLED
        for text in {label.strip(), bare_name(label).strip()}
    )


def is_model_output(name: str, names: set[str]) -> bool:
    """Whether a model computes the point of this name, given the names of all points; without ``Subject:``."""
    if MODEL_OUTPUTS.fullmatch(name):
        return True
    if FOOT_OUTPUTS.fullmatch(name) and any(FOOT_MODEL.fullmatch(other) for other in names):
        return True
    segment, letter = name[:-1], name[-1:]
    if not letter or letter not in AXES:
        return False
    n_axes = sum(segment + end in names for end in AXES)
    return n_axes == len(AXES) or (n_axes > 1 and SEGMENTS.fullmatch(segment) is not None)


def computed_by_position(positions: Floats, trusted: Bools, among: Bools) -> Bools:
    """Return which points (M,) are exact functions of others, by positions (F, M, 3) and trust (F, M).

    Their distance to an earlier point is constant while both move, or one coordinate of theirs is constant while the
    others change, as of points on the floor. Nothing is one where most points would be: in a take of a skeleton, or in
    two dimensions. A point in the place of an earlier one is a copy of it in any case. among: (M,), the points to
    compare; no other is one.
    """
    frames, columns = evenly_spaced(len(trusted), TRIED_FRAMES), np.flatnonzero(among)
    positions, trusted = positions[frames][:, columns], trusted[frames][:, columns]
    computed = np.zeros_like(among)
    is_copy, keeps_distance = _follows(positions, trusted)
    computed[columns[is_copy]] = True
    for found in (keeps_distance, _has_constant_coordinate(positions, trusted)):
        if (found & ~is_copy).sum() < MOST_EXACT * (~is_copy).sum():
            computed[columns[found]] = True
    return computed


def _follows(positions: Floats, trusted: Bools) -> tuple[Bools, Bools]:
    """Return the points (M,) in the place of an earlier point, and those whose distance to one is constant."""
    moving = np.flatnonzero(_motion(positions, trusted) >= LEAST_MOTION)
    is_copy, follows = np.zeros((2, trusted.shape[1]), dtype=bool)
    for place, column in enumerate(moving):
        later = moving[place + 1 :]
        shared = trusted[:, later] & trusted[:, [column]]
        distance = np.linalg.norm(positions[:, later] - positions[:, [column]], axis=2)
        middle = nan_median(np.where(shared, distance, np.nan))
        is_exact = shared & (np.abs(distance - middle) < EXACT)
        count = shared.sum(axis=0)
        is_constant = (count >= LEAST_SEEN) & (is_exact.sum(axis=0) >= EXACT_SHARE * count)
        follows[later[is_constant]] = True
        is_copy[later[is_constant & (middle < EXACT)]] = True
    return is_copy, follows


def _has_constant_coordinate(positions: Floats, trusted: Bools) -> Bools:
    """Return the points (M,) of which one coordinate is always the same number while another one changes."""
    flat = np.zeros(trusted.shape[1], dtype=bool)
    for column in np.flatnonzero(trusted.sum(axis=0) >= LEAST_SEEN):
        spread = np.ptp(positions[trusted[:, column], column], axis=0)
        flat[column] = spread.min() == 0.0 and spread.max() >= LEAST_MOTION
    return flat


def _motion(positions: Floats, trusted: Bools) -> Floats:
    """Return the RMS distance (M,) of each point from its mean position, mm."""
    seen = trusted[..., None]
    count = np.maximum(trusted.sum(axis=0), 1)[:, None]
    known = np.where(seen, positions, 0.0)
    offsets = np.where(seen, known - known.sum(axis=0) / count, 0.0)
    return np.asarray(np.sqrt((offsets**2).sum(axis=(0, 2)) / count[:, 0]))


def _listed(parameters: Parameters) -> set[str]:
    """Return the labels of all points that are listed as something else than captured markers.

    POINT:TYPE_GROUPS holds pairs: the parameter that lists points, and what they are.
    """
    groups = [*NOT_MARKERS, *parameters.strings("POINT:TYPE_GROUPS")[::2]]
    return {label for group in dict.fromkeys(groups) for label in parameters.labels(group.upper())} - {""}
