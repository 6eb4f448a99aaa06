"""Prediction of each marker from its partners: a robust ridge regression in the frame of its body segment.

The most rigid partners of a marker span a frame that travels with its segment; most of the motion is gone in it. There
the place of the marker is regressed on the places of the partners. Steps are searched for on request.

Shapes: b markers that are predicted at once, K partners, F frames, T rows (frames that a marker is learnt from). Frames
are the last axis here, so that the samples of a path lie side by side in memory.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced
from mocapclean.detection.robust_ridge import RidgeFit, Rows, Sample, regress
from mocapclean.detection.step_search import find_steps
from mocapclean.detection.steps import Step
from mocapclean.geometry.alignment import align_shapes
from mocapclean.geometry.distances import PARTNERS, Rigidity
from mocapclean.numerics import interpolation
from mocapclean.numerics.robust import nan_median

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
    positions: Floats,
    usable: Bools,
    rigid: Rigidity,
    *,
    slide: int | None = None,
    only: Bools | None = None,
    known: tuple[Prediction, Bools] | None = None,
    screened: bool = True,
) -> Prediction:
    """Return the prediction of every marker, or only of some (M,), in every frame.

    positions: (F, M, 3), finite everywhere. usable: (F, M), the samples to learn from. slide: the longest slide to a
    step, in frames; None searches for no steps. known: an earlier prediction, and the markers (M,) that keep it.
    screened: whether only steps that may be credible are searched for. A marker with fewer than 3 partners or 10 usable
    frames is not predicted: its predicted position is its mean place in all frames, so that its residual is its own
    path.
    """
    paths = _paths(positions)
    kept = np.zeros(usable.shape[1], dtype=bool) if known is None else known[1]
    wanted = ~kept if only is None else only & ~kept
    neighbours = _Neighbours.of(rigid)
    predicted = neighbours.predicted(usable, wanted)
    alone, steps = ~kept & ~predicted, list[Step]()
    if known is None:
        place, residual = np.empty_like(paths), np.empty_like(paths)
        rotation = np.empty((3, *paths.shape))
    else:
        last = known[0]
        place, residual, rotation = (_paths(part).copy() for part in (last.positions, last.residual, last.rotation))
        steps += [step for step in last.steps if kept[step.marker]]
        predicted = predicted | (last.predicted & kept)
    place[:, alone] = paths[:, alone].mean(axis=2, keepdims=True)
    residual[:, alone] = paths[:, alone] - place[:, alone]
    rotation[:, :, alone], everywhere = np.eye(3)[:, :, None, None], np.arange(len(usable))
    for segment in _segments(paths, usable, neighbours, wanted):
        markers, fit = segment.markers, regress(segment.sample)
        place[:, markers], axes = segment.predicted(paths, everywhere, fit)
        residual[:, markers], rotation[:, :, markers] = _to_segment(paths[:, markers] - place[:, markers], axes), axes
        if slide is not None:
            penalties = fit.penalties if screened else None
            steps += find_steps(markers, segment.sample, min(slide, len(usable)), penalties)
    steps = [] if slide is None else sorted(steps, key=lambda step: step.marker)
    return Prediction(_samples(place), _samples(residual), _samples(rotation), predicted, tuple(steps))


def steps_of(positions: Floats, usable: Bools, rigid: Rigidity, slide: int, only: Bools) -> list[Step]:
    """Return the steps that ``predict`` finds for some markers (M,), without the prediction of every frame."""
    steps: list[Step] = []
    for segment in _segments(_paths(positions), usable, _Neighbours.of(rigid), only):
        penalties = regress(segment.sample).penalties
        steps += find_steps(segment.markers, segment.sample, min(slide, len(usable)), penalties)
    return steps


def carried(positions: Floats, usable: Bools, rigid: Rigidity) -> Floats:
    """Return the positions (F, M, 3) of markers that keep their median place in the frame of their segment.

    NaN for markers that cannot be predicted. Nothing else is learnt, which takes a fraction of the time of a
    prediction. positions: (F, M, 3), finite everywhere. usable: (F, M).
    """
    paths, everyone = _paths(positions), np.ones(usable.shape[1], dtype=bool)
    place = np.full_like(paths, np.nan)
    for segment in _segments(paths, usable, _Neighbours.of(rigid), everyone):
        usual = nan_median(np.where(segment.rows.weights > 0, segment.targets, np.nan), axis=2)
        _, axes, centre = segment.at(paths, slice(None))
        place[:, segment.markers] = _to_world(usual[..., None], axes) + centre
    return _samples(place)


@dataclass(frozen=True)
class Completion:
    """Positions (F, M, 3) in which samples that are not usable (F, M) are replaced, and how.

    interpolated: by interpolation over time. filled: by the predicted position plus the residual interpolated over the
    gap, for markers that are attached to others and predicted; else interpolated.
    """

    usable: Bools
    interpolated: Floats
    filled: Floats


def complete(
    positions: Floats,
    usable: Bools,
    rigid: Rigidity,
    attached: Bools | None = None,
    known: Completion | None = None,
) -> Completion:
    """Return positions (F, M, 3) in which samples that are not usable (F, M) are replaced.

    attached: (M,), the markers attached to others; all if None is given. known: an earlier completion, which markers
    keep if neither they nor their partners have changed.
    """
    interpolated = interpolation.linear(positions, usable)
    filled = interpolated.copy()
    wanted = np.asarray(~usable.all(axis=0))
    if attached is not None:
        wanted &= attached
    if known is not None:
        kept = ~affected(known.interpolated, known.usable, interpolated, usable, rigid)
        filled[:, kept] = known.filled[:, kept]
        wanted &= ~kept
    paths = _paths(interpolated)
    for segment in _segments(paths, usable, _Neighbours.of(rigid), wanted):
        markers = segment.markers
        # The frames in gaps, and those beside them, whose residuals are interpolated.
        lost = ~usable[:, markers]
        beside = lost.copy()
        beside[1:] |= lost[:-1]
        beside[:-1] |= lost[1:]
        frames = np.flatnonzero(beside.any(axis=1))
        place, axes = segment.predicted(paths, frames, regress(segment.sample))
        residual = _to_segment(paths[:, markers[:, None], frames] - place, axes)
        gaps = lost[frames]
        residual = _paths(interpolation.linear(_samples(residual), ~gaps, frames))
        column, rank = np.nonzero(gaps.T)
        turned = _to_world(residual[:, column, rank], axes[:, :, column, rank])
        filled[frames[rank], markers[column]] = (place[:, column, rank] + turned).T
    return Completion(usable, interpolated, filled)


def affected(before: Floats, usable_before: Bools, after: Floats, usable: Bools, rigid: Rigidity) -> Bools:
    """Return the markers (M,) whose prediction may differ after a change of positions (F, M, 3) or usable (F, M).

    They are those that have changed themselves, and those of whose partners one has.
    """
    changed = (before != after).any(axis=(0, 2)) | (usable_before != usable).any(axis=0)
    neighbours = _Neighbours.of(rigid)
    return np.asarray(changed | (changed[neighbours.partners] & (neighbours.weights > 0)).any(axis=1))


def _paths(samples: Floats) -> Floats:
    """Return samples (F, M, ...) with the frames last and the markers before them, contiguous in memory."""
    return np.ascontiguousarray(np.moveaxis(samples, (0, 1), (-1, -2)))


def _samples(paths: Floats) -> Floats:
    """Return paths (..., M, F) with the frames first and the markers second, in the same memory."""
    return np.moveaxis(paths, (-1, -2), (0, 1))


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

    def predicted(self, usable: Bools, only: Bools) -> Bools:
        """Return which of some markers (M,) can be predicted from their usable samples (F, M)."""
        enough = np.count_nonzero(self.weights, axis=1) >= _FEWEST_PARTNERS
        return np.asarray(only & enough & (np.count_nonzero(usable, axis=0) >= _FEWEST_FRAMES))


@dataclass(frozen=True)
class _Segment:
    """The body segments of b markers, and what they are learnt from.

    columns: (b, K), the partners, with weights and scale (b, K). shape: (3, b, K) mm, their mean shape. In the rows:
    partners: (3, b, K, T) mm. axes: (3, 3, b, T), of the segments in the world. centre: (3, b, T) mm. targets:
    (3, b, T) mm, the markers in their segments.
    """

    markers: Ints
    rows: Rows
    columns: Ints
    weights: Floats
    scale: Floats
    shape: Floats
    partners: Floats
    axes: Floats
    centre: Floats
    targets: Floats

    @cached_property
    def sample(self) -> Sample:
        """The partners, scaled, and the markers in their segments, in the rows."""
        scaled = (self.partners - self.centre[:, :, None]) / self.scale[..., None]
        inputs = _to_segment(scaled, self.axes[..., None, :]).swapaxes(0, 1)
        n_markers, n_coordinates, n_partners, n_rows = inputs.shape
        inputs = inputs.reshape(n_markers, n_coordinates * n_partners, n_rows)
        return Sample.of(inputs, self.targets.swapaxes(0, 1), self.rows)

    def at(self, paths: Floats, frames: slice | Ints) -> tuple[Floats, Floats, Floats]:
        """Return partners (3, b, K, n), axes (3, 3, b, n) and centres (3, b, n) in some frames of paths (3, M, F)."""
        if self.rows.are_all(paths.shape[2]):
            return self.partners[..., frames], self.axes[..., frames], self.centre[..., frames]
        index = frames if isinstance(frames, slice) else frames[None, None]
        partners = paths[:, self.columns if isinstance(frames, slice) else self.columns[..., None], index]
        return partners, *align_shapes(self.shape, partners.swapaxes(2, 3), self.weights)

    def predicted(self, paths: Floats, frames: Ints, fit: RidgeFit) -> tuple[Floats, Floats]:
        """Return predicted positions (3, b, n) of the markers, and the axes (3, 3, b, n), in some frames of all paths.

        The inputs are linear in the partners' positions p: Rᵀ(p - c) / scale, with c = Σ share · p. One product of the
        slopes with p gives their sums for each axis of the world and of the segment, and the axes R combine these.
        """
        n_markers, n_partners = self.scale.shape
        slopes = fit.slopes.reshape(n_markers, 3, 3, n_partners) / self.scale[:, None, None]
        share = self.weights / self.weights.sum(axis=1, keepdims=True)
        slopes = (slopes - share[:, None, None] * slopes.sum(axis=3, keepdims=True)).reshape(n_markers, 9, n_partners)
        intercept = np.moveaxis(fit.intercept, 1, 0)
        place, all_axes = np.empty((3, n_markers, len(frames))), np.empty((3, 3, n_markers, len(frames)))
        size = max(1, _BATCH // n_markers)
        for chunk in (slice(low, low + size) for low in range(0, len(frames), size)):
            partners, axes, centre = self.at(paths, frames[chunk])
            products = (slopes @ partners).reshape(3, n_markers, 3, 3, -1)
            fitted = np.einsum("icbf,ibdcf->dbf", axes, products) + intercept
            place[..., chunk], all_axes[..., chunk] = _to_world(fitted, axes) + centre, axes
        return place, all_axes


def _segments(paths: Floats, usable: Bools, neighbours: _Neighbours, only: Bools) -> Iterator[_Segment]:
    """Yield the segments of those of some markers (M,) that can be predicted, several at once.

    paths: (3, M, F), finite everywhere. usable: (F, M), the samples to learn from.
    """
    chosen = np.flatnonzero(neighbours.predicted(usable, only))
    size = max(1, _BATCH // min(len(usable), _MOST_ROWS))
    for markers in (chosen[first : first + size] for first in range(0, len(chosen), size)):
        usable_frames = (np.flatnonzero(usable[:, marker]) for marker in markers.tolist())
        rows = Rows.of([frames[evenly_spaced(len(frames), _MOST_ROWS)] for frames in usable_frames])
        columns, weights = neighbours.partners[markers], neighbours.weights[markers]
        partners = _in_rows(paths, columns, rows)
        shape = _mean_shape(partners, weights, rows)
        axes, centre = align_shapes(shape, partners.swapaxes(2, 3), weights)
        targets = _to_segment(_in_rows(paths, markers[:, None], rows)[:, :, 0] - centre, axes)
        scale = neighbours.scale[markers]
        yield _Segment(markers, rows, columns, weights, scale, shape, partners, axes, centre, targets)


def _in_rows(paths: Floats, columns: Ints, rows: Rows) -> Floats:
    """Return the samples (3, b, K, T) of markers (b, K) on paths (3, M, F), in the rows of b markers."""
    if rows.are_all(paths.shape[2]):
        return np.asarray(paths[:, columns])
    return np.asarray(paths[:, columns[..., None], rows.frames[:, None]])


def _mean_shape(partners: Floats, weights: Floats, rows: Rows) -> Floats:
    """Return the mean shape (3, b, K) of partners (3, b, K, T) with weights (b, K), over 100 of the rows."""
    chosen = np.linspace(0, rows.number - 1, _SHAPE_FRAMES, axis=1).astype(np.intp)
    sample = np.take_along_axis(partners, chosen[None, :, None], axis=3)
    shape = sample[..., _SHAPE_FRAMES // 2]
    for _ in range(_SHAPE_ROUNDS):
        axes, centre = align_shapes(shape, sample.swapaxes(2, 3), weights)
        shape = _to_segment(sample - centre[:, :, None], axes[..., None, :]).mean(axis=3)
    return shape


def _to_segment(world: Floats, axes: Floats) -> Floats:
    """Return vectors (3, ...) of the world in the frames with these axes (3, 3, ...)."""
    return np.stack([world[0] * axes[0, j] + world[1] * axes[1, j] + world[2] * axes[2, j] for j in range(3)])


def _to_world(local: Floats, axes: Floats) -> Floats:
    """Return vectors (3, ...) of the frames with these axes (3, 3, ...) in the world."""
    return np.stack([local[0] * axes[i, 0] + local[1] * axes[i, 1] + local[2] * axes[i, 2] for i in range(3)])
