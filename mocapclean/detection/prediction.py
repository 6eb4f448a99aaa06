"""Prediction of each marker from its partners: a robust ridge regression in the frame of its body segment.

The most rigid partners of a marker span a frame that travels with its segment; most of the motion is gone in it. There
the place of the marker is regressed on the places of the partners. Steps are searched for on request.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced
from mocapclean.detection.robust_ridge import Rows, regress
from mocapclean.detection.step_search import find_steps
from mocapclean.detection.steps import Step
from mocapclean.geometry.alignment import align_shapes
from mocapclean.geometry.distances import PARTNERS, Rigidity
from mocapclean.numerics import interpolation

# Chosen by hand on the takes of `bench trust`, seeds 0 to 4 (docs/results.md), where no other reason is given; no sweep
# was kept.
_FEWEST_PARTNERS = 3  # partners that span a frame
_FEWEST_FRAMES = 10  # usable frames to learn from
_MOST_ROWS = 800  # frames that a regression is learnt from, evenly spaced over the usable ones
_SHAPE_FRAMES = 100  # of these, frames that the mean shape of the partners is taken over
_SHAPE_ROUNDS = 2  # alignments to the mean shape so far
_SCALE_SLACK = 25.0  # mm², added to the variance of a distance: inputs that vary less than 5 mm have about one scale
_BATCH = 8000  # frames times markers that are predicted at once; bounds the memory


@dataclass(frozen=True)
class Prediction:
    """The prediction of each marker from its partners.

    positions: (F, M, 3) mm, the predicted positions. residual: (F, M, 3) mm, the position less the predicted one, in
    the segment's frame. rotation: (F, M, 3, 3), from the segment to the world. predicted: (M,), whether a marker is
    predicted. steps: the best step of each marker, if steps were searched for.
    """

    positions: Floats
    residual: Floats
    rotation: Floats
    predicted: Bools
    steps: tuple[Step, ...] = ()


def predict(
    positions: Floats, usable: Bools, rigid: Rigidity, *, slide: int | None = None, only: Bools | None = None
) -> Prediction:
    """Return the prediction of every marker, or only of some (M,), in every frame.

    positions: (F, M, 3), finite everywhere. usable: (F, M), the samples to learn from. slide: the longest slide to a
    step, in frames; None searches for no steps. A marker with fewer than 3 partners or 10 usable frames is not
    predicted: its predicted position is its mean place in all frames, so that its residual is its own path.
    """
    n_frames, n_markers = usable.shape
    predicted_positions = np.repeat(positions.mean(axis=0, keepdims=True), n_frames, axis=0)
    rotation = np.broadcast_to(np.eye(3), (n_frames, n_markers, 3, 3)).copy()
    residual = positions - predicted_positions
    neighbours = _Neighbours.of(rigid)
    predicted = np.count_nonzero(neighbours.weights, axis=1) >= _FEWEST_PARTNERS
    predicted &= (np.count_nonzero(usable, axis=0) >= _FEWEST_FRAMES) & (True if only is None else only)
    steps: list[Step] = []
    paths = positions.transpose(2, 1, 0)
    columns, batch = np.flatnonzero(predicted), max(1, _BATCH // n_frames)
    for markers in (columns[first : first + batch] for first in range(0, len(columns), batch)):
        usable_frames = (np.flatnonzero(usable[:, marker]) for marker in markers.tolist())
        rows = Rows.of([frames[evenly_spaced(len(frames), _MOST_ROWS)] for frames in usable_frames])
        # The frames of the segments, and in them the inputs (partners, scaled) and the targets (the markers).
        partners = paths[:, neighbours.partners[markers]].swapaxes(2, 3)
        axes, centre = _segment_frames(partners, neighbours.weights[markers], rows)
        local = _to_segment(partners - centre[..., None], axes[..., None]) / neighbours.scale[markers, None]
        inputs = np.moveaxis(local, 0, 2).reshape(len(markers), n_frames, -1)
        targets = np.moveaxis(_to_segment(paths[:, markers] - centre, axes), 0, 2)
        learnt_from = rows.take(inputs), rows.take(targets), rows
        fitted = regress(*learnt_from).predict(inputs)
        steps += [] if slide is None else find_steps(markers, *learnt_from, min(slide, n_frames))
        residual[:, markers] = (targets - fitted).swapaxes(0, 1)
        rotation[:, markers] = np.moveaxis(axes, (2, 3), (1, 0))
        world = _to_world(np.moveaxis(fitted, 2, 0), axes) + centre
        predicted_positions[:, markers] = np.moveaxis(world, (0, 2), (2, 0))
    return Prediction(predicted_positions, residual, rotation, predicted, tuple(steps))


def complete(positions: Floats, usable: Bools, rigid: Rigidity, attached: Bools | None = None) -> Floats:
    """Return positions (F, M, 3) in which samples that are not usable (F, M) are replaced.

    By the predicted position plus the residual interpolated over the gap; by interpolation for markers that are not
    attached (M,) to others, or not predicted. All are attached if None is given.
    """
    interpolated = interpolation.linear(positions, usable)
    if usable.all():
        return interpolated
    with_gaps = np.asarray(~usable.all(axis=0))
    prediction = predict(interpolated, usable, rigid, only=with_gaps if attached is None else with_gaps & attached)
    residual = interpolation.linear(prediction.residual, usable)
    completed = prediction.positions + (prediction.rotation @ residual[..., None])[..., 0]
    replaced = ~usable & prediction.predicted & usable.any(axis=0)
    return np.where(replaced[..., None], completed, interpolated)


@dataclass(frozen=True)
class _Neighbours:
    """The partners (M, 10) of all markers, with their weights and coordinate scales (M, 10), mm.

    A marker with fewer partners has weights of 0 and infinite scales in the other columns.
    """

    partners: Ints
    weights: Floats
    scale: Floats

    @classmethod
    def of(cls, rigid: Rigidity) -> "_Neighbours":
        """Return the partners of all markers."""
        partners = np.zeros((len(rigid.spread), PARTNERS), dtype=np.intp)
        weights, scale = np.zeros(partners.shape), np.full(partners.shape, np.inf)
        for marker in range(len(partners)):
            own, own_weights = rigid.partners(marker)
            partners[marker, : len(own)], weights[marker, : len(own)] = own, own_weights
            # A partner that keeps its distance varies little: its coordinates are scaled up, and penalised less.
            scale[marker, : len(own)] = np.sqrt(rigid.spread[marker, own] ** 2 + _SCALE_SLACK)
        return cls(partners, weights, scale)


def _segment_frames(partners: Floats, weights: Floats, rows: Rows) -> tuple[Floats, Floats]:
    """Return axes (3, 3, b, F) and centres (3, b, F) of the segments that partners (3, b, F, K) span.

    The partners are aligned to their mean shape over 100 of the rows, weighted by (b, K).
    """
    chosen = np.linspace(0, rows.number - 1, _SHAPE_FRAMES, axis=1).astype(int)
    frames = np.take_along_axis(rows.frames, chosen, axis=1)
    sample = np.take_along_axis(partners, frames[None, :, :, None], axis=2)
    shape = sample[:, :, _SHAPE_FRAMES // 2]
    for _ in range(_SHAPE_ROUNDS):
        axes, centre = align_shapes(shape, sample, weights)
        shape = _to_segment(sample - centre[..., None], axes[..., None]).mean(axis=2)
    return align_shapes(shape, partners, weights)


def _to_segment(world: Floats, axes: Floats) -> Floats:
    """Return vectors (3, ...) of the world in the frames with these axes (3, 3, ...)."""
    return np.stack([world[0] * axes[0, j] + world[1] * axes[1, j] + world[2] * axes[2, j] for j in range(3)])


def _to_world(local: Floats, axes: Floats) -> Floats:
    """Return vectors (3, ...) of the frames with these axes (3, 3, ...) in the world."""
    return np.stack([local[0] * axes[i, 0] + local[1] * axes[i, 1] + local[2] * axes[i, 2] for i in range(3)])
