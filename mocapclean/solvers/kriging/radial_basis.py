"""How near a pose is to each of a few others: features with which a linear regression bends.

D. S. Broomhead, D. Lowe, 1988, Multivariable functional interpolation and adaptive networks, Complex Systems 2, 321.
"""

import numpy as np

from mocapclean.arrays import Floats

_WIDTH, _SHARE = 0.5, 0.5


def nearness(features: Floats, n_learnt: int, n_poses: int) -> Floats:
    """Gaussians (N, k) of the distances of features (N, p) to k poses, spread over the first ``n_learnt``.

    k is ``n_poses``, or n_learnt if that is less. Their width, SD, is half the root mean square distance of the learnt
    poses from their mean; their height half that distance, so that a ridge regression shrinks them as the features.
    """
    learnt = features[:n_learnt]
    offsets = features - learnt.mean(axis=0)
    size = np.sqrt(np.square(offsets[:n_learnt]).sum(axis=1).mean())
    if size == 0.0:
        return np.zeros((len(features), min(n_poses, n_learnt)))
    offsets /= size
    poses = offsets[np.linspace(0, n_learnt - 1, min(n_poses, n_learnt)).astype(int)]
    squares = np.square(offsets).sum(axis=1)[:, None] + np.square(poses).sum(axis=1) - 2.0 * offsets @ poses.T
    return np.asarray(_SHARE * size * np.exp(-0.5 * np.maximum(squares, 0.0) / _WIDTH**2))
