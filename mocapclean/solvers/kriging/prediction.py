"""Predict one part of a gap with every predictor: move to segment axes, build features, krige, return to the world."""

from dataclasses import dataclass, replace

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.alignment import segment_frames
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.solvers.kriging.bridging import PlanBridges
from mocapclean.solvers.kriging.hinge import hinge_frames, radius_scaled
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.solvers.kriging.predictors import Predictor
from mocapclean.solvers.kriging.radial_basis import pose_nearness
from mocapclean.solvers.kriging.regression_kriging import KrigingResult, krige
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan


@dataclass(frozen=True, kw_only=True)
class PredictionInput:
    """The data of one part of a gap that all predictors share; N is the number of frames in its sampling plan.

    marker: column of the marker.
    neighbours: (q,) columns in descending order of their weight.
    hinge_ends: two indices into the neighbours, or empty where the marker is no joint.
    plan, bridges: the frames to learn, test and bridge from, and the bridges over them.
    held_out: (folds, n) training frames held out in each fold.
    positions: (N, q, 3) of the neighbours, mm, in the world.
    target: (N, 3) positions of the marker, mm, in the world; not read in the gap.
    error_floor: mm², mean square below which errors count as equal.
    """

    distances: NeighbourDistances
    marker: int
    neighbours: Ints
    hinge_ends: list[int]
    plan: SamplingPlan
    bridges: PlanBridges
    held_out: Bools
    positions: Floats
    target: Floats
    error_floor: float


def predict_all(predictors: list[Predictor], inputs: PredictionInput) -> list[KrigingResult]:
    """Return the results of the predictors in world coordinates; those without a defined frame are left out."""
    frames = _frames_of_reference(predictors, inputs) if predictors else []
    results = [_predict(*each, inputs) for each in zip(predictors, frames, strict=True)]
    return [result for result in results if result]


def _frames_of_reference(predictors: list[Predictor], inputs: PredictionInput) -> list[BodyFrames]:
    """Return each predictor's segment axes; predictors on a circle later derive their axes from these.

    They follow the framing neighbours; where there are none they only shift with the mean of all neighbours.
    """
    positions, n_training = inputs.positions, len(inputs.plan.training)
    # All distinct alignments are computed at once, one row of weights each.
    distinct = list(dict.fromkeys((p.n_framing, p.looseness) for p in predictors if p.n_framing))
    weights = np.zeros((len(distinct), len(inputs.neighbours)))
    for row, (n, looseness) in zip(weights, distinct, strict=True):
        row[:n] = inputs.distances.weights(inputs.marker, looseness)[inputs.neighbours[:n]]
    turning = dict(zip(distinct, segment_frames(positions, weights, n_training), strict=True))
    shifting = BodyFrames(np.broadcast_to(np.eye(3), (len(positions), 3, 3)), positions.mean(axis=1))
    return [turning.get((p.n_framing, p.looseness), shifting) for p in predictors]


def _predict(predictor: Predictor, frames: BodyFrames, inputs: PredictionInput) -> KrigingResult | None:
    """Return one predictor's result in world coordinates, or None where its hinge has no frame."""
    plan = inputs.plan
    _, windows, _, gap = plan.parts
    radii = None
    if predictor.hinged:
        first, second = inputs.distances.mean[inputs.marker, inputs.neighbours[inputs.hinge_ends]]
        ends = inputs.positions[:, inputs.hinge_ends]
        hinge = hinge_frames(ends, (first, second), frames, inputs.target, len(plan.training))
        if not hinge:
            return None
        frames, radii = hinge
    features = _features(predictor, frames, radii, inputs)
    local_target = frames.to_local(inputs.target[:, None])[:, 0]
    result = krige(features, local_target, plan, inputs.bridges, inputs.held_out, inputs.error_floor)
    # Back to the world: the errors turn with the axes, the positions also shift with the origins.
    window_axes = frames.axes[windows].reshape(*plan.windows.shape, 3, 3)[:, : len(plan.inside)]
    return replace(
        result,
        positions=np.einsum("nij,ni->nj", frames.axes[gap], result.positions) + frames.origins[gap],
        window_errors=np.einsum("wmij,wmi->wmj", window_axes, result.window_errors),
    )


def _features(predictor: Predictor, frames: BodyFrames, radii: Floats | None, inputs: PredictionInput) -> Floats:
    """Return the features (N, p): scaled positions of neighbours in the frame, then radii and nearness to poses."""
    positions, training = inputs.positions, inputs.plan.parts[0]
    local = frames.to_local(positions[:, : predictor.n_features]) * _scales(predictor, inputs)[:, None]
    features = local.reshape(len(positions), -1)
    if radii is not None:
        features = radius_scaled(features, radii, training)
    if predictor.n_poses:
        nearness = pose_nearness(features, len(inputs.plan.training), predictor.n_poses)
        features = np.hstack([features, nearness])
    return features


def _scales(predictor: Predictor, inputs: PredictionInput) -> Floats:
    """Return the factors (n_features,) of the neighbours' positions."""
    chosen = inputs.neighbours[: predictor.n_features]
    if predictor.n_framing:
        return inputs.distances.rigid_scales(inputs.marker, chosen, predictor.looseness)
    return inputs.distances.shifting_scales(inputs.marker, chosen)
