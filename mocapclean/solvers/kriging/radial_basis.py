"""Radial basis features, with which a regression that is linear in them follows the pose nonlinearly.

D. S. Broomhead, D. Lowe, 1988, Multivariable functional interpolation and adaptive networks, Complex Systems 2, 321.
"""

import numpy as np

from mocapclean.arrays import Floats

WIDTH = 0.5  # SD of a Gaussian, of the root mean square distance of poses from their mean; chosen by hand
HEIGHT = 0.5  # of the same distance, so that a ridge penalty shrinks Gaussians and positions alike; chosen by hand


def pose_nearness(features: Floats, n_training: int, n_poses: int) -> Floats:
    """Return Gaussian radial basis functions (N, k) of features (N, p), centred on k of the first ``n_training`` rows.

    k is ``n_poses``, or n_training if that is less. All are 0 where the training poses do not differ.
    """
    training = features[:n_training]
    offsets = features - training.mean(axis=0)
    size = np.sqrt(np.square(offsets[:n_training]).sum(axis=1).mean())
    if size == 0.0:
        return np.zeros((len(features), min(n_poses, n_training)))
    offsets /= size
    poses = offsets[np.linspace(0, n_training - 1, min(n_poses, n_training)).astype(int)]
    # |a - b|² = |a|² + |b|² - 2 aᵀb
    squares = np.square(offsets).sum(axis=1)[:, None] + np.square(poses).sum(axis=1) - 2.0 * offsets @ poses.T
    return np.asarray(HEIGHT * size * np.exp(-0.5 * np.maximum(squares, 0.0) / WIDTH**2))
