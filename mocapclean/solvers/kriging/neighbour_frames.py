"""Moving axes centred on the position that a marker's neighbours predict, for the interpolation of its short gaps."""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.alignment import segment_frames
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.solvers.kriging.frame_selection import MIN_TRAINING, spread_out
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.solvers.kriging.ridge import ridge_prediction

# The constants below were chosen by hand; no sweep was kept.
N_FRAMING = 6  # heaviest neighbours that the frames are aligned with
N_FEATURES = 12  # heaviest neighbours that the marker is predicted from
PENALTY = 1e-4  # ridge penalty, in the unit of ``RidgeRegression``


def neighbour_frames(
    positions: Floats,
    trusted: Bools,
    usable: Bools,
    distances: NeighbourDistances,
    n_training: int,
    marker: int,
    frames: Ints,
) -> BodyFrames | None:
    """Return frames of reference (n) at some frames of the take, each at the predicted position of a marker.

    positions: (F, M, 3). usable: (F, M) whether a sample may serve as a neighbour. n_training: most frames learnt from.
    An origin is NaN where some neighbour is not usable. None with fewer than three neighbours or 20 training frames.
    """
    weights = distances.weights(marker)
    neighbours = np.argsort(-weights, kind="stable")[:N_FEATURES]
    neighbours = neighbours[weights[neighbours] > 0.0]
    complete: Bools = np.asarray(usable[:, neighbours].all(axis=1))
    training = spread_out(np.flatnonzero(trusted[:, marker] & complete), n_training, 1)
    if len(neighbours) < 3 or len(training) < 2 * MIN_TRAINING:
        return None
    # Align frames with the nearest few, then predict the marker in them by ridge regression on all neighbours.
    both = np.append(training, frames)
    points, framing = positions[both][:, neighbours], np.arange(len(neighbours)) < N_FRAMING
    framing_weights = np.where(framing, weights[neighbours], 0.0)
    frames_of_all = segment_frames(points[None], framing_weights[None, None], np.array([len(training)]))
    segment = BodyFrames(frames_of_all.axes[0, 0], frames_of_all.origins[0, 0])
    scales = distances.rigid_scales(marker, neighbours)
    features = (segment.to_local(points) * scales[:, None]).reshape(len(both), -1)
    target = segment.to_local(positions[both, marker][:, None])[:, 0]
    local = ridge_prediction(features, target, len(training), PENALTY)
    predicted = segment.to_world(local[:, None])[:, 0]
    origins = np.where(complete[frames, None], predicted[len(training) :], np.nan)
    return BodyFrames(segment.axes[len(training) :], origins)
