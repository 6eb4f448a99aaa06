"""The computed points of a C3D file that a repair of its markers leaves behind."""

import re
from dataclasses import replace

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.formats.c3d.document import C3dDocument
from mocapclean.formats.c3d.samples import read_samples
from mocapclean.geometry.distances import rigidity
from mocapclean.take import Take
from mocapclean.take.names import bare_name

SAME_SEGMENT = 10.0
"""mm, robust SD of the distance of a computed point from a marker of the same segment. Chosen by hand."""
SIDE = re.compile(r"[LR](?=[A-Z]|eft|ight)|[lr](?=[ _.])")
"""The side with which a name begins: LKNE, RightHipCenter, l_knee."""


def outdated(take: Take) -> tuple[str, ...]:
    """Return the computed points, which are carried untouched, that may follow from a changed marker of a take.

    These are the points whose distance to it varies little, and the angles, forces and the like of its side. Nothing
    in the file states how a point was computed.
    """
    document = take.origin.document if take.origin else None
    changed: Bools = np.asarray(take.changed.any(axis=0))
    if not isinstance(document, C3dDocument) or not changed.any():
        return ()
    old = [document.names[i] for i in np.array(document.computed)[_move_with(take, changed, document)]]
    repaired = [name for name, is_changed in zip(take.markers, changed, strict=True) if is_changed]
    sides = {_side(name) for name in repaired}
    old += [name for i in document.quantities if {_side(name := document.names[i]), ""} & sides or not _side(name)]
    return tuple(old)


def _move_with(take: Take, changed: Bools, document: C3dDocument) -> Bools:
    """Return which computed points keep their distance to a changed marker (M,) in the frames that did not change."""
    if not document.computed:
        return np.zeros(0, dtype=bool)
    samples = read_samples(replace(document, columns=np.array(document.computed)))
    positions = np.concatenate([take.positions, samples.positions], axis=1)
    trusted = np.concatenate([take.trusted & ~take.changed, samples.trusted], axis=1)
    spread = rigidity(positions, trusted).spread[len(changed) :, : len(changed)]
    return np.asarray((spread[:, changed] <= SAME_SEGMENT).any(axis=1))


def _side(name: str) -> str:
    """Return the side of a point as L or R, "" if its name begins with none."""
    found = SIDE.match(bare_name(name))
    return found.group().upper() if found else ""
