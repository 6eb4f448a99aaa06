"""The points of a C3D file: their names, which of them are markers, their unit and rate."""

import math
import re
from pathlib import Path

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.c3d.header import RELATIVE_TOLERANCE, Header, Parameters
from mocapclean.take import Finding, ReadOptions
from mocapclean.take.names import bare_name, similar_names

NOT_MARKERS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")
"""Parameters of the group POINT that list points which are computed, not captured (C3D user guide, type groups)."""
UNLABELLED = re.compile(r"\*\d+")
"""The name that Vicon software gives to a trajectory without a label."""
MILLIMETRES = ((r"mm|millim.*", 1.0), (r"cm|centim.*", 10.0), (r"m|mete?|met(er|re)s?", 1000.0))
"""Spellings of POINT:UNITS, and the millimetres that they stand for."""
SHOWN_NAMES = 5
"""Names that a message shows of a longer list."""
NAME_SIMILARITY = 0.5
"""The least similarity of a suggestion, from 0 to 1 (difflib). Chosen by hand."""


def point_names(header: Header, n_points: int) -> tuple[list[str], list[Finding]]:
    """Return a distinct name for every point, as stored where possible, and a finding for names that were made up."""
    stored = header.parameters.labels("LABELS")[:n_points]
    stored += [""] * (n_points - len(stored))
    names: list[str] = []
    used, copies, made_up = set(stored), dict[str, int](), []
    seen: set[str] = set()
    for number, label in enumerate(stored, start=1):
        name = label or f"point{number}"
        base = name
        while name in seen or (name != label and name in used):
            copies[base] = copies.get(base, 1) + 1
            name = f"{base}#{copies[base]}"
        if name != label:
            made_up.append(name)
        seen.add(name)
        names.append(name)
    if not made_up:
        return names, []
    message = f"{len(made_up)} of {n_points} labels are empty or repeated and were named {_few(made_up)}."
    return names, [Finding(rule="labels", message=message)]


def choose_markers(
    path: Path, header: Header, names: list[str], options: ReadOptions
) -> tuple[list[int], list[Finding]]:
    """Return the indices of the points that are markers or were asked for, and a finding for the others.

    Unlabelled points count as markers only in a file that has no others. Raises UsageError for a name in
    ``options.points`` that no point has, FormatError when nothing is left.
    """
    _check_asked(path, names, options)
    listed = _listed(header.parameters)
    # A label counts as listed with or without its ``Subject:`` prefix on either side.
    bare = {bare_name(label) for label in listed if ":" in label}
    labels = list(enumerate(header.parameters.labels("LABELS")[: len(names)]))
    other = {i for i, label in labels if {label, bare_name(label)} & listed or (":" not in label and label in bare)}
    unlabelled = {i for i, label in labels if UNLABELLED.fullmatch(bare_name(label))}
    if len(other | unlabelled) < len(names):
        other |= unlabelled
    asked = set(options.points)
    left = [i for i in sorted(other) if names[i] not in asked]
    chosen = sorted(set(range(len(names))).difference(left))
    if not chosen:
        raise FormatError(
            path,
            f"a take must have markers. Got {len(names)} points that are listed as angles, forces or the like. "
            "Name some with --markers to repair them.",
        )
    if not left:
        return chosen, []
    message = (
        f"{len(left)} of {len(names)} points are unlabelled or listed as angles, forces or the like and are "
        f"carried along untouched: {_few([names[i] for i in left])}."
    )
    return chosen, [Finding(rule="points", message=message, advice="name them with --markers to repair them.")]


def _check_asked(path: Path, names: list[str], options: ReadOptions) -> None:
    """Raise UsageError, with names that are near, for a point asked for that the file does not have."""
    known = set(names)
    for wanted in options.points:
        if wanted not in known:
            near = similar_names(wanted, names, cutoff=NAME_SIMILARITY)
            hint = f"Near it: {', '.join(near)}." if near else f"The file has {_few(names)}."
            raise UsageError(f"{path}: points to read must be points of the file. Got {wanted!r}. {hint}")


def millimetres_per_unit(header: Header, options: ReadOptions) -> tuple[float, list[Finding]]:
    """Return the millimetres of POINT:UNITS; the option or else 1, with a finding, when it is blank or unknown."""
    stored = header.parameters.strings("POINT:UNITS")
    unit = next((text for text in stored if text), "")
    for pattern, factor in MILLIMETRES:
        if re.fullmatch(pattern, unit.lower()):
            return factor, []
    fault = f"POINT:UNITS must be mm, cm or m. Got {unit!r}" if unit else "POINT:UNITS is blank or absent"
    finding = Finding(
        rule="units",
        level="warning",
        message=f"{fault}; positions are taken as millimetres.",
        advice="Compare a known distance, such as between two markers on one bone.",
    )
    return options.unit or 1.0, [finding]


def step(header: Header, is_float: bool) -> tuple[float, list[Finding]]:
    """Return the units of length of a step of an integer, 1 for floats, and a finding where two places differ.

    The header comes first, then POINT:SCALE. The sign alone counts for floats: their magnitude is a leftover of the
    integer form.
    """
    if is_float:
        return 1.0, []
    stated = [header.scale, *header.parameters.numbers("POINT:SCALE")[:1]]
    steps = [scale for scale in stated if math.isfinite(scale) and scale > 0]
    if math.isclose(min(steps), max(steps), rel_tol=RELATIVE_TOLERANCE):
        return steps[0], []
    message = f"POINT:SCALE should be the header's scale. Got {steps[1]:g} and {steps[0]:g}, which was used"
    return steps[0], [Finding(rule="scale", level="warning", message=message, advice="compare a known distance")]


def frame_rate(path: Path, header: Header, options: ReadOptions) -> tuple[float, list[Finding]]:
    """Return the frames per second exactly as POINT:RATE, or else the header, has it; a given rate comes first.

    Raises FormatError when neither is finite and positive and no rate was given.
    """
    if options.rate is not None:
        return options.rate, []
    stored = [*header.parameters.numbers("POINT:RATE")[:1], header.rate]
    usable = [rate for rate in stored if math.isfinite(rate) and rate > 0]
    if not usable:
        got = " and ".join(f"{rate:g}" for rate in stored)
        raise FormatError(path, f"the frame rate must be finite and positive. Got {got}. Give one with --rate.")
    if len(usable) == len(stored) and math.isclose(min(usable), max(usable), rel_tol=RELATIVE_TOLERANCE):
        return usable[0], []
    message = f"POINT:RATE and the header's rate should agree. Got {', '.join(f'{rate:g}' for rate in stored)}."
    finding = Finding(rule="rate", level="warning", message=message, advice="If it is wrong, give --rate.")
    return usable[0], [finding] if len(stored) > 1 else []


def _listed(parameters: Parameters) -> set[str]:
    """Return the labels of all points that are listed as something else than captured markers.

    POINT:TYPE_GROUPS holds pairs: the parameter that lists points, and what they are.
    """
    groups = [*NOT_MARKERS, *parameters.strings("POINT:TYPE_GROUPS")[::2]]
    return {label for group in dict.fromkeys(groups) for label in parameters.labels(group.upper())} - {""}


def _few(names: list[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    shown = ", ".join(names[:SHOWN_NAMES])
    return shown if len(names) <= SHOWN_NAMES else f"{shown} and {len(names) - SHOWN_NAMES} more"
