"""The points of a C3D file: their names, those that are markers by name, their unit and rate."""

import math
import re
from pathlib import Path

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.c3d.header import RELATIVE_TOLERANCE, Header
from mocapclean.formats.c3d.point_kinds import Kind
from mocapclean.take import Finding, ReadOptions
from mocapclean.take.names import similar_names

MILLIMETRES = (
    (r"mm|millim.*", 1.0),
    (r"cm|centim.*", 10.0),
    (r"dm|decim.*", 100.0),
    (r"m|mete?|met(er|re)s?", 1000.0),
    (r"in\.?|inch(es)?|\"", 25.4),
    (r"ft\.?|foot|feet|'", 304.8),
    (r"yd\.?|yards?", 914.4),
)
"""Spellings of POINT:UNITS, and the millimetres that they stand for; the inch is 25.4 mm by definition."""
SHOWN_NAMES = 5
"""Names that a message shows of a longer list."""
NAME_SIMILARITY = 0.5
"""The least similarity of a suggestion, from 0 to 1 (difflib). Chosen by hand."""


def point_names(header: Header, n_points: int) -> tuple[list[str], list[str], list[Finding]]:
    """Return the labels and a distinct name for every point, and a finding for names that were made up.

    A name is the label where possible. A point beyond the list of labels has its name as label.
    """
    labels = header.parameters.labels("LABELS")[:n_points]
    stored = labels + [""] * (n_points - len(labels))
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
    labels += names[len(labels) :]
    if not made_up:
        return labels, names, []
    are = "is" if len(made_up) == 1 else "are"
    message = f"{len(made_up)} of {n_points} labels {are} empty or repeated and got a new name: {_few(made_up)}"
    return labels, names, [Finding(rule="labels", message=message)]


def named_markers(path: Path, names: list[str], kinds: list[Kind], options: ReadOptions) -> list[int]:
    """Return the indices of the points that are markers by their names, or that were asked for.

    Unlabelled points count as markers only in a file that has no others, outputs of a model in one that has not even
    those. Raises UsageError for a name in ``options.points`` that no point has, FormatError when nothing is left.
    """
    _check_asked(path, names, options)
    asked = {i for i, name in enumerate(names) if name in options.points}
    for kind in (Kind.CAPTURED, Kind.UNLABELLED, Kind.MODEL_OUTPUT):
        found = {i for i, other in enumerate(kinds) if other is kind}
        if found:
            return sorted(found | asked)
    if not asked:
        raise FormatError(
            path,
            f"a take must have markers. Got {len(names)} points that are listed as angles, forces or the like. "
            "Name some with --markers to repair them.",
        )
    return sorted(asked)


def carried_points(names: list[str], kinds: list[Kind], columns: list[int]) -> list[Finding]:
    """Return a finding that counts and names the points that are no markers."""
    left = sorted(set(range(len(names))).difference(columns))
    if not left:
        return []
    groups = {kind: [names[i] for i in left if kinds[i] is kind] for kind in Kind}
    parts = [f"{len(group)} {kind.value} ({_few(group)})" for kind, group in groups.items() if group]
    are = "is" if len(left) == 1 else "are"
    message = f"{len(left)} of {len(names)} points {are} carried along untouched: {', '.join(parts)}"
    return [Finding(rule="points", message=message, advice="name those to repair with --markers")]


def unlabelled_take(n_points: int) -> Finding:
    """Return the finding for a take without any label."""
    message = f"none of the {n_points} points has a label, so each is judged and filled by its own motion only"
    return Finding(rule="unlabelled", level="warning", message=message, advice="label them first to use the others")


def _check_asked(path: Path, names: list[str], options: ReadOptions) -> None:
    """Raise UsageError, with names that are near, for a point asked for that the file does not have."""
    known = set(names)
    for wanted in options.points:
        if wanted not in known:
            near = similar_names(wanted, names, cutoff=NAME_SIMILARITY)
            hint = f"Near it: {', '.join(near)}." if near else f"The file has {_few(names)}."
            raise UsageError(f"{path}: points to read must be points of the file. Got {wanted!r}. {hint}")


def millimetres_per_unit(header: Header, options: ReadOptions) -> tuple[float, list[Finding]]:
    """Return the millimetres of a unit of length, and a finding where that is in doubt.

    The option comes first, then POINT:UNITS, then millimetres.
    """
    stored = header.parameters.strings("POINT:UNITS")
    unit = next((text for text in stored if text), "")
    known = next((factor for pattern, factor in MILLIMETRES if re.fullmatch(pattern, unit.lower())), None)
    if options.unit is not None:
        if not unit or known == options.unit:
            return options.unit, []
        message = f"POINT:UNITS is {unit!r}, but a unit of {options.unit:g} mm was given (--unit), which was used"
        return options.unit, [Finding(rule="units", level="warning", message=message)]
    if known is not None:
        return known, []
    fault = f"POINT:UNITS must be a unit of length. Got {unit!r}" if unit else "POINT:UNITS is blank or absent"
    finding = Finding(
        rule="units",
        level="warning",
        message=f"{fault}; positions are taken as millimetres",
        advice="compare a known distance, such as between two markers on one bone, or give the unit (--unit)",
    )
    return 1.0, [finding]


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
    finding = Finding(rule="rate", level="warning", message=message, advice="if it is wrong, give --rate")
    return usable[0], [finding] if len(stored) > 1 else []


def _few(names: list[str]) -> str:
    """Return the first names of a list, and how many more there are."""
    shown = ", ".join(names[:SHOWN_NAMES])
    return shown if len(names) <= SHOWN_NAMES else f"{shown} and {len(names) - SHOWN_NAMES} more"
