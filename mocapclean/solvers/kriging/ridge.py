"""Ridge regression of a marker's position on features, for several penalties at once.

    W = (AᵀA + λ s I)⁻¹ AᵀY      A (n, p) and Y (n, 3) centred, s = 3 tr(AᵀA) / p

A. E. Hoerl, R. W. Kennard, 1970, doi:10.1080/00401706.1970.10488634.
"""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats

N_COORDINATES = 3.0  # of a neighbour: s is the mean, over neighbours, of the sum of squares of their coordinates


class RidgeRegression:
    """Ridge regressions of a target (n, 3) on features (n, p), both centred, with or without some of the rows."""

    def __init__(self, features: Floats, target: Floats) -> None:
        self.features, self.target = features, target
        self.gram, self.cross = features.T @ features, features.T @ target
        self.penalty_unit = N_COORDINATES * np.trace(self.gram) / len(self.gram) or 1.0

    def weights(self, penalties: Floats, held_out: Bools | None = None) -> Floats:
        """Return the weights W (λ, p, 3) for penalties (λ,), learnt without the rows held out (n,)."""
        gram, cross = self.gram, self.cross
        if held_out is not None:
            # Taking the held-out rows off the sums is cheaper than summing over the others.
            features = self.features[held_out]
            gram, cross = gram - features.T @ features, cross - features.T @ self.target[held_out]
        systems = gram + (self.penalty_unit * penalties)[:, None, None] * np.eye(len(gram))
        return np.stack([scipy.linalg.lapack.dposv(system.T, cross, overwrite_a=True)[1] for system in systems])


def ridge_prediction(features: Floats, target: Floats, n_training: int, penalty: float) -> Floats:
    """Return the prediction (N, 3) of a target (N, 3) from features (N, p), learnt from the first ``n_training`` rows.

    The other rows of the target are not read.
    """
    middle, level = features[:n_training].mean(axis=0), target[:n_training].mean(axis=0)
    offsets = features - middle
    (weights,) = RidgeRegression(offsets[:n_training], target[:n_training] - level).weights(np.array([penalty]))
    return np.asarray(offsets @ weights + level)
