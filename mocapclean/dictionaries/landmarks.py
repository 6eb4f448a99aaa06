"""The frame of a dictionary's body: the hip line and the neck span a plane, the root is the origin."""

from collections.abc import Sequence

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.geometry.alignment import carry_points
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.numerics import interpolation

_SHORT = 5
_STIFF = 1e-4
_FLAT = 1e-9


def plane_frames(landmarks: Floats) -> BodyFrames:
    """The frames of landmarks (F, 4, 3): origin, right hip, left hip, neck.

    x runs from the right hip to the left, y lies in the plane of both and the neck, towards it. Landmarks that
    coincide or lie on a line leave the free axes where the world has them.
    """
    origin, right, left, top = landmarks.swapaxes(0, 1)
    size = _FLAT * np.linalg.norm(np.ptp(landmarks, axis=1), axis=-1, keepdims=True)
    x = _unit(left - right, size, np.broadcast_to(np.eye(3)[0], origin.shape))
    across = _reject(np.eye(3)[np.abs(x).argmin(axis=-1)], x)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    y = _unit(_reject(top - (left + right) / 2, x), size, across)
    return BodyFrames(np.stack([x, y, np.cross(x, y)], axis=1), origin)


def _reject(vectors: Floats, axes: Floats) -> Floats:
    along: Floats = np.sum(vectors * axes, axis=-1, keepdims=True)
    return vectors - along * axes


def _unit(vectors: Floats, least: Floats, instead: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    flat = length <= least
    return np.where(flat, instead, vectors / np.where(flat, 1.0, length))


def place_landmarks(positions: Floats, trusted: Bools, groups: Sequence[Ints], torso: Ints, model: Floats) -> Floats:
    """The landmarks (F, 4, 3): means of the markers of each group, the untrusted ones among them supplied.

    positions: (F, M, 3); trusted: (F, M). torso: columns of the markers that tell where the torso is, the groups'
    among them. model: (P, M, 3) poses of this body in its own frame. A gap of up to 5 frames is bridged by a line. In a
    longer one the shape of the torso, not its place, is interpolated, and laid on the markers that are seen, those
    most rigidly tied to the lost one counting most. Where fewer than 3 are seen, the line remains.
    """
    filled = interpolation.linear(positions, trusted)
    known = _bridge(trusted)
    marks = np.unique(np.concatenate(groups))
    complete: Bools = np.all(known[:, marks], axis=1)
    if not complete.all():
        frames = plane_frames(_means(filled, groups))
        seen = np.asarray(known[:, torso] & complete[:, None])
        shape = interpolation.linear(frames.to_local(filled[:, torso]), seen)
        shape = np.where(np.any(seen, axis=0)[:, None], shape, model[:, torso].mean(axis=0))
        for mark in marks:
            weights: Floats = known[:, torso] * rigidity(model[:, torso], model[:, mark])
            lost = ~known[:, mark] & (np.count_nonzero(weights, axis=1) >= 3)
            (place,) = np.flatnonzero(torso == mark)
            filled[lost, mark] = carry_points(shape[lost], filled[lost][:, torso], weights[lost], shape[lost, place])
    return _means(filled, groups)


def _means(positions: Floats, groups: Sequence[Ints]) -> Floats:
    return np.stack([positions[:, group].mean(axis=1) for group in groups], axis=1)


def _bridge(trusted: Bools) -> Bools:
    """Trusted samples (F, M) and inner gaps of up to 5 frames between them."""
    known = trusted.copy()
    for marker, start, stop in column_runs(~trusted):
        if stop - start <= _SHORT and start > 0 and stop < len(trusted):
            known[start:stop, marker] = True
    return known


def rigidity(model: Floats, mark: Floats) -> Floats:
    """Weights (T,) of markers (P, T, 3) by how constant their distance to one marker (P, 3) is: 1 / variance."""
    distance = np.linalg.norm(model - mark[:, None], axis=-1)
    floor = (_STIFF * distance.mean()) ** 2
    weights: Floats = 1.0 / (distance.var(axis=0) + floor + np.finfo(float).tiny)
    return np.asarray(weights / weights.max())
