"""Coordinates spanned by three markers."""

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.geometry.body_frames import BodyFrames

_LEAST_AREA = 1e-2  # |a × b| over the sum of the squared sides below which a triangle is thin; no sweep was kept


def triad_frames(first: Floats, second: Floats, third: Floats) -> BodyFrames:
    """Return the frames of three markers (F, 3): origin at the first, x towards the second, y normal to their plane."""
    x = _unit(second - first)
    y = _unit(np.cross(x, third - first))
    return BodyFrames(np.stack([x, y, np.cross(y, x)], axis=1), first)


def spans(first: Floats, second: Floats, third: Floats) -> bool:
    """Whether three markers (F, 3) span a plane in every frame, by the area of their triangle."""
    sides = second - first, third - first, third - second
    area = np.linalg.norm(np.cross(sides[0], sides[1]), axis=-1)
    return bool((area > _LEAST_AREA * np.square(sides).sum(axis=-1).max(axis=0)).all())


def _unit(vectors: Floats) -> Floats:
    """Return vectors (F, 3) of length 1, 0 where they were 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    unit: Floats = vectors / np.where(length > 0.0, length, 1.0)
    return unit
