"""Ridge regression of markers' positions on features, for several penalties at once.

    W = (AᵀA + λ s I)⁻¹ AᵀY      A (n, p) and Y (n, 3) centred, s = 3 tr(AᵀA) / p

A. E. Hoerl, R. W. Kennard, 1970, doi:10.1080/00401706.1970.10488634.
"""

import numpy as np

from mocapclean.arrays import Floats

LEAST_UNIT = 1e-200  # below it all features are 0 but for underflow; keeps the systems regular
N_COORDINATES = 3.0  # of a neighbour: s is the mean, over neighbours, of the sum of squares of their coordinates


def penalty_units(grams: Floats, n_features: Floats | float) -> Floats:
    """Return the unit s (G,) of the penalties for matrices AᵀA (G, p, p); 1 where all features are 0.

    n_features: (G,), or one number: the features that are not 0 throughout, where fewer than p of them are in use.
    """
    units = N_COORDINATES * np.einsum("gpp->g", grams) / n_features
    return np.where(units > LEAST_UNIT, units, 1.0)


def ridge_weights(grams: Floats, crosses: Floats, penalties: Floats) -> Floats:
    """Return the weights W (G, λ, p, 3) for matrices AᵀA (G, p, p), AᵀY (G, p, 3) and penalties λ s (G, λ)."""
    # A Cholesky solver would take 0.7 times as long, but loading SciPy for it takes as long as 5,000 solutions.
    systems = np.repeat(grams[:, None], penalties.shape[1], axis=1)
    np.einsum("gkpp->gkp", systems)[...] += penalties[..., None]
    return np.asarray(np.linalg.solve(systems, crosses[:, None]), dtype=np.float64)


def ridge_prediction(features: Floats, target: Floats, n_training: int, penalty: float) -> Floats:
    """Return the prediction (N, 3) of a target (N, 3) from features (N, p), learnt from the first ``n_training`` rows.

    The other rows of the target are not read.
    """
    middle, level = features[:n_training].mean(axis=0), target[:n_training].mean(axis=0)
    offsets = features - middle
    learnt = offsets[:n_training]
    gram, cross = (learnt.T @ learnt)[None], (learnt.T @ (target[:n_training] - level))[None]
    unit = penalty_units(gram, features.shape[1])
    weights = ridge_weights(gram, cross, penalty * unit[:, None])[0, 0]
    return np.asarray(offsets @ weights + level)
