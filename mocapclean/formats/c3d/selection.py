"""The choice of the points that are read as markers, by their positions, from those that are markers by their names."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.formats.c3d.document import C3dDocument
from mocapclean.formats.c3d.point_kinds import PLACES, QUANTITY_KINDS, Kind, computed_by_position
from mocapclean.formats.c3d.points import carried_points, unlabelled_take
from mocapclean.formats.c3d.samples import Samples, distrust_marks, read_samples, residual_findings
from mocapclean.take import Finding


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The markers of a file: their indices among the points, their samples, and the kinds of all points."""

    document: C3dDocument
    columns: list[int]
    kinds: list[Kind]
    samples: Samples
    findings: list[Finding]


def select_markers(document: C3dDocument, kinds: Sequence[Kind], asked: Sequence[str]) -> Selection:
    """Return the markers of a document: its columns, without those that are never seen or computed from others.

    asked: names of points that are read as markers whatever they are.
    """
    samples = read_samples(document)
    findings = distrust_marks(samples)
    columns, names = document.marker_points(), document.names
    found = [kinds[i] for i in columns]
    is_free = np.array([names[i] not in asked for i in columns])
    is_left = _set_kind(found, _never_seen(samples) & is_free, Kind.NEVER_SEEN)
    if Kind.CAPTURED in found:
        is_captured = np.array([kind is Kind.CAPTURED for kind in found])
        follows = computed_by_position(samples.positions, samples.trusted, is_captured)
        is_left |= _set_kind(found, follows & is_free, Kind.COMPUTED)
    all_kinds = list(kinds)
    for column, kind in zip(columns, found, strict=True):
        all_kinds[column] = kind
    chosen = [int(column) for column in columns[~is_left]]
    samples = samples.select(~is_left)
    findings += residual_findings(samples)
    if Kind.CAPTURED not in kinds and Kind.UNLABELLED in found:
        findings.append(unlabelled_take(len(chosen)))
    findings += carried_points(list(names), all_kinds, chosen)
    carried = [i for i in range(len(names)) if i not in set(chosen)]
    document = replace(
        document,
        columns=as_columns(chosen),
        computed=tuple(i for i in carried if all_kinds[i] in PLACES),
        quantities=tuple(i for i in carried if all_kinds[i] in QUANTITY_KINDS),
    )
    return Selection(document=document, columns=chosen, kinds=all_kinds, samples=samples, findings=findings)


def as_columns(columns: list[int]) -> Any:
    """Return ascending indices as a slice where they adjoin, which numpy reads as a view, else as an array."""
    adjoin = columns == list(range(columns[0], columns[-1] + 1))
    return slice(columns[0], columns[-1] + 1) if adjoin else np.array(columns)


def _never_seen(samples: Samples) -> Bools:
    """Return the points (M,) that are seen in no frame; none in a take in which nothing is seen."""
    seen: Bools = np.asarray(samples.trusted.any(axis=0))
    return ~seen if seen.any() else seen


def _set_kind(kinds: list[Kind], where: Bools, kind: Kind) -> Bools:
    """Set the kind of some points (M,), in place, and return them."""
    for column in np.flatnonzero(where):
        kinds[column] = kind
    return where
