"""Radial basis features, with which a regression that is linear in them follows the pose nonlinearly.

D. S. Broomhead, D. Lowe, 1988, Multivariable functional interpolation and adaptive networks, Complex Systems 2, 321.
"""

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.solvers.kriging.segment_batch import SegmentBatch

WIDTH = 0.5  # SD of a Gaussian, of the root mean square distance of poses from their mean; chosen by hand
HEIGHT = 0.5  # of the same distance, so that a ridge penalty shrinks Gaussians and positions alike; chosen by hand


def pose_nearness(features: Floats, batch: SegmentBatch, n_poses: int) -> Floats:
    """Return Gaussian radial basis functions (G, N, k) of features (G, N, p), centred on k of the training rows.

    k is ``n_poses``; a pose is repeated where there are fewer rows. All are 0 where the training poses do not differ.
    """
    offsets = features - batch.training_mean(features)
    squares = np.square(offsets).sum(axis=2, keepdims=True)
    size = np.sqrt(batch.training_mean(squares))
    rows = np.linspace(0, batch.n_training - 1, n_poses, axis=1).astype(np.intp)
    poses = offsets[np.arange(len(offsets))[:, None], rows]
    # |a - b|² = |a|² + |b|² - 2 aᵀb
    distances = squares + np.square(poses).sum(axis=2)[:, None] - 2.0 * offsets @ poses.swapaxes(1, 2)
    scale = WIDTH * np.where(size > 0.0, size, 1.0)
    return np.asarray(HEIGHT * size * np.exp(-0.5 * np.maximum(distances, 0.0) / scale**2))
