"""Predict the segments of a batch with every predictor: move to segment axes, build features, krige, return."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.alignment import segment_frames
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.solvers.kriging.hinge import hinge_frames, radius_scaled
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.solvers.kriging.predictors import Predictor
from mocapclean.solvers.kriging.radial_basis import pose_nearness
from mocapclean.solvers.kriging.regression_kriging import KrigingResult, krige
from mocapclean.solvers.kriging.segment_batch import SegmentBatch


@dataclass(frozen=True, kw_only=True)
class Neighbourhoods:
    """The neighbours of the markers of a batch, in descending order of their weights; q at most.

    markers: (G,) columns. neighbours: (G, q) columns. in_use: (G, q) whether a marker has as many neighbours.
    hinge_ends: (G, 2) indices into the neighbours; not read where the markers of the batch are no joints.
    positions: (G, N, q, 3) of the neighbours, mm, in the world. displacements: (G, N, q, 3) of these over 1/20 s
    around each frame, mm, or None where no predictor of the batch reads them. distances: those of the take.
    """

    markers: Ints
    neighbours: Ints
    in_use: Bools
    hinge_ends: Ints
    positions: Floats
    displacements: Floats | None
    distances: NeighbourDistances

    def rows(self, values: Floats) -> Floats:
        """Return the entries (G, q) of a matrix over all markers (M, M), at each marker and its neighbours."""
        return np.asarray(values[self.markers[:, None], self.neighbours])


def predict_all(
    predictors: list[Predictor], near: Neighbourhoods, batch: SegmentBatch, error_floor: float
) -> list[tuple[KrigingResult, Bools]]:
    """Return the results of the predictors in world coordinates, and for which segments (G,) they are defined.

    error_floor: mm², mean square below which errors count as equal.
    """
    frames = _frames_of_reference(predictors, near, batch)
    return [_predict(*each, near, batch, error_floor) for each in zip(predictors, frames, strict=True)]


def _frames_of_reference(predictors: list[Predictor], near: Neighbourhoods, batch: SegmentBatch) -> list[BodyFrames]:
    """Return each predictor's segment axes; predictors on a circle later derive their axes from these.

    They follow the framing neighbours; where there are none they only shift with the mean of all neighbours.
    """
    # All distinct alignments are computed at once, one row of weights each.
    distinct = list(dict.fromkeys(p.n_framing for p in predictors if p.n_framing))
    found: dict[int, BodyFrames] = {}
    if distinct:
        weights = np.stack([_framing_weights(near, each) for each in distinct], axis=1)
        aligned = segment_frames(near.positions, weights, batch.n_training)
        found = {each: BodyFrames(aligned.axes[:, k], aligned.origins[:, k]) for k, each in enumerate(distinct)}
    share = near.in_use / near.in_use.sum(axis=1, keepdims=True)
    means = (share[:, None, None] @ near.positions)[:, :, 0]
    shifting = BodyFrames(np.broadcast_to(np.eye(3), (*means.shape, 3)), means)
    return [found.get(p.n_framing, shifting) for p in predictors]


def _framing_weights(near: Neighbourhoods, n_framing: int) -> Floats:
    """Return the weights (G, q) of the neighbours that frames of reference are aligned with; 0 for the others."""
    weights = near.distances.weights_between(near.markers[:, None], near.neighbours) * near.in_use
    weights[:, n_framing:] = 0.0
    return weights


def _predict(
    predictor: Predictor, frames: BodyFrames, near: Neighbourhoods, batch: SegmentBatch, error_floor: float
) -> tuple[KrigingResult, Bools]:
    """Return one predictor's results in world coordinates, and for which segments (G,) it has a frame."""
    radii, defined = None, np.ones(len(near.markers), dtype=bool)
    if predictor.hinged:
        ends = np.take_along_axis(near.positions, near.hinge_ends[:, None, :, None], axis=2)
        lengths = np.take_along_axis(near.rows(near.distances.mean), near.hinge_ends, axis=1)
        frames, radii, defined = hinge_frames(ends, lengths, frames, batch)
    features, n_features = _features(predictor, frames, radii, near, batch)
    local_target = frames.to_local(batch.target[:, :, None])[:, :, 0]
    result = krige(features, local_target, batch, n_features, error_floor)
    # Back to the world: the errors turn with the axes, the positions also shift with the origins.
    shape = *batch.window_share.shape, batch.window_rows, 3, 3
    window_axes = frames.axes[:, batch.windows].reshape(shape)[:, :, : batch.n_inside]
    gap_frames = BodyFrames(frames.axes[:, batch.gap], frames.origins[:, batch.gap])
    in_world = KrigingResult(
        positions=gap_frames.to_world(result.positions[:, :, None])[:, :, 0],
        window_errors=(result.window_errors[..., None, :] @ window_axes)[..., 0, :],
        gap_variance=result.gap_variance,
        window_variance=result.window_variance,
    )
    return in_world, defined


def _features(
    predictor: Predictor, frames: BodyFrames, radii: Floats | None, near: Neighbourhoods, batch: SegmentBatch
) -> tuple[Floats, Floats]:
    """Return the features (G, N, p), and how many (G,) are in use.

    They are scaled positions of neighbours in the frame, then radii and nearness to poses.
    """
    chosen = slice(0, predictor.n_features)
    positions = near.positions[:, :, chosen]
    # Axes that only shift need no product.
    local = frames.to_local(positions) if predictor.n_framing else positions - frames.origins[..., None, :]
    if predictor.moving and near.displacements is not None:
        moves = near.displacements[:, :, chosen] @ frames.axes.swapaxes(-1, -2)
        local = np.concatenate([local, moves], axis=3)
    local *= _scales(predictor, near)[:, None, chosen, None]
    features = local.reshape(*local.shape[:2], -1)
    in_use = float(local.shape[3]) * near.in_use[:, chosen].sum(axis=1)
    if radii is not None:
        features, in_use = radius_scaled(features, radii, batch), in_use + 1.0
    if predictor.n_poses:
        nearness = pose_nearness(features, batch, predictor.n_poses)
        features, in_use = np.concatenate([features, nearness], axis=2), in_use + predictor.n_poses
    return features, in_use


def _scales(predictor: Predictor, near: Neighbourhoods) -> Floats:
    """Return the factors (G, q) of the neighbours' positions; 0 for those that are not in use."""
    if predictor.n_framing:
        scales = near.distances.rigid_scales(near.markers[:, None], near.neighbours)
    else:
        scales = near.distances.shifting_scales(near.markers[:, None], near.neighbours)
    return scales * near.in_use
