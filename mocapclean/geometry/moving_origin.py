"""A point that travels with whatever is seen, to take positions about."""

import numpy as np

from mocapclean.arrays import Bools, Floats

_FEWEST = 3


def moving_origin(positions: Floats, trusted: Bools) -> Floats:
    """One point (F, 3) for each frame of positions (F, M, 3): the mean of the markers that are always trusted.

    Where these are fewer than three it is t_f of the additive model x_fm = t_f + s_m, by least squares over the trusted
    (F, M) samples, so that the point does not leap when a marker comes or goes. Frames in which nothing is trusted do
    not count; they get what the model gives the mean of the others.
    """
    seen = trusted.any(axis=1)
    always = trusted[seen].all(axis=0)
    origin = np.zeros((len(trusted), 3))
    if np.count_nonzero(always) >= _FEWEST:
        origin[seen] = positions[seen][:, always].mean(axis=1)
    elif seen.any():
        origin[seen] = _additive(np.where(trusted[..., None], positions, 0.0)[seen], trusted[seen].astype(np.float64))
    if seen.any():
        origin[~seen] = origin[seen].mean(axis=0)
    return origin


def _additive(known: Floats, weights: Floats) -> Floats:
    """t (F, 3) of the additive model for known (F, M, 3), 0 where the weights (F, M) are; every frame has some."""
    middle = known[weights > 0].mean(axis=0)
    offsets = np.where(weights[..., None] > 0, known - middle, 0.0)
    share = weights / weights.sum(axis=1, keepdims=True)
    system = np.diag(weights.sum(axis=0)) - weights.T @ share
    total = offsets.sum(axis=1)
    pull = offsets.sum(axis=0) - share.T @ total
    shape = np.linalg.lstsq(system, pull, rcond=None)[0]
    moved: Floats = (total - weights @ shape) / weights.sum(axis=1, keepdims=True) + middle
    return moved
