"""A frame of reference that travels with whatever is seen: every frame laid on one mean shape."""

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.alignment import rotations_by_svd
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.numerics import interpolation

_ROUNDS = 30


def shape_frames(positions: Floats, trusted: Bools) -> BodyFrames:
    """The frames (F) that lay the trusted samples (F, M) of positions (F, M, 3) on their own mean shape best.

    Generalised Procrustes analysis of incomplete shapes: by turns every frame is turned and shifted onto the mean
    shape by its trusted samples alone, and the mean is taken of what is trusted. J. C. Gower, 1975,
    doi:10.1007/BF02291478; W. Kabsch, 1976, doi:10.1107/S0567739476001873. The mean shape starts as the middle frame.
    A frame in which nothing is trusted stands where the frame before it does, or else as the world.
    """
    seen = trusted.astype(float)
    known = np.where(trusted[..., None], positions, 0.0)
    shape = interpolation.linear(positions, trusted)[len(positions) // 2]
    count = np.maximum(seen.sum(axis=1, keepdims=True), 1.0)
    middles = known.sum(axis=1) / count
    offsets = np.where(trusted[..., None], known - middles[:, None], 0.0)
    frames = BodyFrames(np.broadcast_to(np.eye(3), (len(seen), 3, 3)), middles)
    for _ in range(_ROUNDS):
        shape = shape - shape.mean(axis=0)
        centres = seen @ shape / count
        axes = rotations_by_svd(np.einsum("fm,mi,fmj->fij", seen, shape, offsets, optimize=True))
        frames = BodyFrames(axes, middles - np.einsum("fij,fi->fj", axes, centres))
        laid = np.where(trusted[..., None], frames.to_local(known), 0.0)
        shape = laid.sum(axis=0) / np.maximum(seen.sum(axis=0), 1.0)[:, None]
    blind = np.asarray(~trusted.any(axis=1))
    before = np.maximum.accumulate(np.where(blind, -1, np.arange(len(trusted))))
    before = np.where(before < 0, np.argmin(blind), before)
    return BodyFrames(frames.axes[before], frames.origins[before])
