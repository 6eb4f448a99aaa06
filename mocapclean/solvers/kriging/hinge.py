"""Axes for a marker at fixed distances from two others, as a knee from hip and ankle: it moves on a circle about their
line.

The two distances confine the joint to a circle around the line between the two markers, the ends. The centre and the
radius of the circle follow from the triangle of the three (law of cosines). Only the angle on the circle remains to be
predicted.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.solvers.kriging.segment_batch import SegmentBatch

# The constants below were chosen by hand; no sweep was kept.
MIN_BENDING = 5.0  # times the rigidity parameter, SD of the distance between the ends above which the joint bends
MAX_CANDIDATES = 8  # rigid neighbours among which the ends are sought
DISTANCE_SD_FLOOR = 1.0  # mm, added to the SDs of the joint's distances, so that nearly rigid pairs count alike
RADIUS_SCALE = 10.0  # the value of the radius as a feature, where it is equal to its mean over the training frames
MIN_RADIUS = 0.02  # of the first distance, the least radius: the circle of a stretched limb would shrink to a point
MIN_SINE = 1e-3  # sine of the angle to the line below which the mean direction defines no frame
MIN_LENGTH = 1e-9  # mm, keeps a division by the distance between the ends finite


def find_ends(distances: NeighbourDistances, marker: int, neighbours: Ints) -> list[int]:
    """Return the indices of two neighbours at constant distance from the marker but not from each other, or an empty
    list.

    The marker is rigid with both ends, and the ends are not rigid with each other. Of such pairs the one is chosen
    whose distance varies most, relative to the distances from the marker.
    """
    rigid_sd = np.sqrt(distances.variance[marker, neighbours])
    near = np.flatnonzero(rigid_sd < distances.rigidity)[:MAX_CANDIDATES]
    bending = np.sqrt(distances.variance[np.ix_(neighbours[near], neighbours[near])])
    bending[~np.isfinite(bending)] = 0.0
    score = bending / (DISTANCE_SD_FLOOR + rigid_sd[near] + rigid_sd[near][:, None])
    score[bending <= MIN_BENDING * distances.rigidity] = 0.0
    if not score.any():
        return []
    return sorted(int(near[k]) for k in np.unravel_index(score.argmax(), score.shape))


def hinge_frames(
    ends: Floats, lengths: Floats, segment: BodyFrames, batch: SegmentBatch
) -> tuple[BodyFrames, Floats, Bools]:
    """Return the axes (G, N) of the joints' circles, their radii (G, N), mm, and where (G,) they are defined.

    The circles are about the line between both ends. ends: (G, N, 2, 3) the two markers. lengths: (G, 2) the joint's
    distances from them. The joint is the target of the batch, which is read in the training rows only. The first axis
    runs from end to end. The second points to the joint's mean direction in ``segment``, the frames of the body
    segment. They are undefined where this direction is along the line.
    """
    line = ends[:, :, 1] - ends[:, :, 0]
    distance = np.linalg.norm(line, axis=2)
    line = line / np.maximum(distance, MIN_LENGTH)[..., None]
    # Law of cosines: the centre is (d² + l₁² - l₂²) / 2d along the line, and the radius √(l₁² - along²).
    first, second = lengths[:, :1], lengths[:, 1:]
    along = (distance**2 + first**2 - second**2) / (2.0 * np.maximum(distance, MIN_LENGTH))
    centres = ends[:, :, 0] + along[..., None] * line
    radii = np.sqrt(np.maximum(first**2 - along**2, (MIN_RADIUS * first) ** 2))
    # The joint's mean direction in the segment's frames, turned to the world and made perpendicular to the line.
    training = batch.training
    to_joint = batch.target[:, training] - centres[:, training]
    mean = batch.training_mean((segment.axes[:, training] @ to_joint[..., None])[..., 0])
    outward = (mean[:, :, None] @ segment.axes)[:, :, 0]
    outward = outward - np.sum(outward * line, axis=2, keepdims=True) * line
    size = np.linalg.norm(outward, axis=2, keepdims=True)
    defined: Bools = size.min(axis=(1, 2)) > MIN_SINE * np.linalg.norm(mean[:, 0], axis=1)
    outward = outward / np.where(size > 0.0, size, 1.0)
    return BodyFrames(np.stack([line, outward, np.cross(line, outward)], axis=2), centres), radii, defined


def radius_scaled(features: Floats, radii: Floats, batch: SegmentBatch) -> Floats:
    """Return features (G, N, p), centred and multiplied by radius over mean radius (G, N), with the relative radius
    appended.

    On a circle of radius r the joint's position is r times a function of its angle.
    """
    relative = radii[..., None] / batch.training_mean(radii[..., None])
    return np.concatenate([(features - batch.training_mean(features)) * relative, RADIUS_SCALE * relative], axis=2)
