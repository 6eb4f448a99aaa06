"""Where each marker should be by the markers around it: a ridge regression in the frame of its body segment.

For every marker its most rigid partners span a frame, in which most of the motion is gone; in it the marker's place is
regressed on theirs. On request it also looks for the frame from which on a marker sits elsewhere in its segment.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced
from mocapclean.detection.robust_ridge import Rows, regress
from mocapclean.detection.steps import Step, steps_of
from mocapclean.geometry.alignment import align_shapes
from mocapclean.geometry.distances import PARTNERS, Rigidity
from mocapclean.numerics import interpolation

_ENOUGH = 10
_TRAIN, _SHAPED = 800, 100
_AT_ONCE = 8000


@dataclass(frozen=True)
class Prediction:
    """What the others say of each marker.

    residual: (F, M, 3) mm, the marker less what is expected, in its segment's frame; expected: (F, M, 3) mm, in the
    world; rotation: (F, M, 3, 3), segment to world; known: (M,), whether anything is said; steps: the best of each
    marker, if they were asked for.
    """

    residual: Floats
    expected: Floats
    rotation: Floats
    known: Bools
    steps: tuple[Step, ...] = ()


def predict(
    positions: Floats, usable: Bools, rigid: Rigidity, *, slide: int | None = None, only: Bools | None = None
) -> Prediction:
    """Predict every marker (or only some, (M,) bool) in every frame from its partners.

    positions: (F, M, 3), finite everywhere. usable: (F, M), the samples to learn from. slide: how many frames a step
    may take, None where steps are not asked for. A marker with fewer than 3 partners or too few usable frames is not
    predicted: it is expected where the mean of all markers goes.
    """
    n_frames, n_markers = usable.shape
    expected = np.repeat(positions.mean(axis=1, keepdims=True), n_markers, axis=1)
    rotation = np.broadcast_to(np.eye(3), (n_frames, n_markers, 3, 3)).copy()
    residual = positions - expected
    around = _Around.of(rigid)
    known = np.count_nonzero(around.weights, axis=1) >= 3
    known &= (np.count_nonzero(usable, axis=0) >= _ENOUGH) & (True if only is None else only)
    steps: list[Step] = []
    paths = positions.transpose(2, 1, 0)
    able, at_once = np.flatnonzero(known), max(1, _AT_ONCE // n_frames)
    for markers in (able[first : first + at_once] for first in range(0, len(able), at_once)):
        learnt_from = (np.flatnonzero(usable[:, marker]) for marker in markers.tolist())
        rows = Rows.of([frames[evenly_spaced(len(frames), _TRAIN)] for frames in learnt_from])
        seen = paths[:, around.partners[markers]].swapaxes(2, 3)
        turn, centre = _segments(seen, around.weights[markers], rows)
        local = _into(seen - centre[..., None], turn[..., None]) / around.scale[markers, None]
        inputs = np.moveaxis(local, 0, 2).reshape(len(markers), n_frames, -1)
        wanted = np.moveaxis(_into(paths[:, markers] - centre, turn), 0, 2)
        learnt = rows.take(inputs), rows.take(wanted), rows
        guess = regress(*learnt).at(inputs)
        steps += [] if slide is None else steps_of(markers, *learnt, min(slide, n_frames))
        residual[:, markers] = (wanted - guess).swapaxes(0, 1)
        rotation[:, markers] = np.moveaxis(turn, (2, 3), (1, 0))
        expected[:, markers] = np.moveaxis(_out_of(np.moveaxis(guess, 2, 0), turn) + centre, (0, 2), (2, 0))
    return Prediction(residual, expected, rotation, known, tuple(steps))


def complete(positions: Floats, usable: Bools, rigid: Rigidity) -> Floats:
    """Positions (F, M, 3) with what is not usable replaced: as expected, plus the residual carried over the gap."""
    filled = interpolation.linear(positions, usable)
    if usable.all():
        return filled
    found = predict(filled, usable, rigid, only=np.asarray(~usable.all(axis=0)))
    carried = interpolation.linear(found.residual, usable)
    better = found.expected + (found.rotation @ carried[..., None])[..., 0]
    return np.where((~usable & found.known & usable.any(axis=0))[..., None], better, filled)


@dataclass(frozen=True)
class _Around:
    """The partners (M, 10) of all markers, their weights (M, 10) and scales (M, 10); 0 and ∞ where there are fewer."""

    partners: Ints
    weights: Floats
    scale: Floats

    @classmethod
    def of(cls, rigid: Rigidity) -> "_Around":
        partners = np.zeros((len(rigid.spread), PARTNERS), dtype=np.intp)
        weights, scale = np.zeros(partners.shape), np.full(partners.shape, np.inf)
        for marker in range(len(partners)):
            chosen, says = rigid.partners(marker)
            partners[marker, : len(chosen)], weights[marker, : len(chosen)] = chosen, says
            scale[marker, : len(chosen)] = np.sqrt(rigid.spread[marker, chosen] ** 2 + 25.0)
        return cls(partners, weights, scale)


def _segments(seen: Floats, weights: Floats, rows: Rows) -> tuple[Floats, Floats]:
    """The frames of segments (3, b, F, K) over all frames, about the mean shapes of 100 of the rows."""
    some = np.linspace(0, rows.number - 1, _SHAPED, axis=1).astype(int)
    frames = np.take_along_axis(rows.frames, some, axis=1)
    sample = np.take_along_axis(seen, frames[None, :, :, None], axis=2)
    shape = sample[:, :, _SHAPED // 2]
    for _ in range(2):
        turn, centre = align_shapes(shape, sample, weights)
        shape = _into(sample - centre[..., None], turn[..., None]).mean(axis=2)
    return align_shapes(shape, seen, weights)


def _into(away: Floats, turn: Floats) -> Floats:
    """World vectors (3, ...) in frames (3, 3, ...)."""
    return np.stack([away[0] * turn[0, j] + away[1] * turn[1, j] + away[2] * turn[2, j] for j in range(3)])


def _out_of(local: Floats, turn: Floats) -> Floats:
    """Vectors (3, ...) of frames (3, 3, ...) in the world."""
    return np.stack([local[0] * turn[i, 0] + local[1] * turn[i, 1] + local[2] * turn[i, 2] for i in range(3)])
