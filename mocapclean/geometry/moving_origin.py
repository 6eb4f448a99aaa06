"""An origin that moves with the markers of a take."""

import numpy as np

from mocapclean.arrays import Bools, Floats

# Fewest markers whose mean serves as the origin; chosen by hand, so that no single marker's own motion dominates it.
_FEWEST_MARKERS = 3


def moving_origin(positions: Floats, trusted: Bools) -> Floats:
    """Return one point (F, 3) for each frame of positions (F, M, 3): the mean of the markers that are always trusted.

    With fewer than three such markers it is t_f of the additive model x_fm = t_f + s_m, by least squares over the
    trusted (F, M) samples: then the point does not jump when a marker appears or disappears. Frames without a trusted
    sample do not count; they get the mean of the other frames' origins.
    """
    has_trusted = trusted.any(axis=1)
    always = trusted[has_trusted].all(axis=0)
    origin = np.zeros((len(trusted), 3))
    if np.count_nonzero(always) >= _FEWEST_MARKERS:
        origin[has_trusted] = positions[has_trusted][:, always].mean(axis=1)
    elif has_trusted.any():
        known = np.where(trusted[..., None], positions, 0.0)[has_trusted]
        origin[has_trusted] = _additive_model(known, trusted[has_trusted].astype(np.float64))
    if has_trusted.any():
        origin[~has_trusted] = origin[has_trusted].mean(axis=0)
    return origin


def _additive_model(known: Floats, weights: Floats) -> Floats:
    """Return t (F, 3) of the additive model for positions (F, M, 3), 0 where the weights (F, M), 0 or 1, are 0.

    Every frame has a weight of 1 at least once.
    """
    mean = known[weights > 0].mean(axis=0)
    offsets = np.where(weights[..., None] > 0, known - mean, 0.0)
    # Eliminate t_f = (Σ_m w_fm (x_fm − s_m)) / Σ_m w_fm, and solve the normal equations for s.
    share = weights / weights.sum(axis=1, keepdims=True)
    normal_matrix = np.diag(weights.sum(axis=0)) - weights.T @ share
    total = offsets.sum(axis=1)
    right_side = offsets.sum(axis=0) - share.T @ total
    shape = np.linalg.lstsq(normal_matrix, right_side, rcond=None)[0]  # s, up to a common shift
    moved: Floats = (total - weights @ shape) / weights.sum(axis=1, keepdims=True) + mean
    return moved
