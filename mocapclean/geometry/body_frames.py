"""A frame that travels with the body: the hip line and the neck span a plane, the root is the origin."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.numerics import interpolation

_SHORT = 5
_STIFF = 1e-4
_FLAT = 1e-9


@dataclass(frozen=True)
class BodyFrames:
    """One frame of reference for each frame of a take: axes as rows (F, 3, 3), and origins (F, 3)."""

    axes: Floats
    origins: Floats

    def to_local(self, positions: Floats) -> Floats:
        """World positions (F, M, 3) as seen from the body."""
        return (positions - self.origins[:, None]) @ self.axes.swapaxes(1, 2)

    def to_world(self, positions: Floats) -> Floats:
        """Body positions (F, M, 3) as seen from the world."""
        return positions @ self.axes + self.origins[:, None]


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


def place_landmarks(
    positions: Floats, trusted: Bools, groups: Sequence[NDArray[np.intp]], torso: NDArray[np.intp], model: Floats
) -> Floats:
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
            filled[lost, mark] = register(shape[lost], filled[lost][:, torso], weights[lost], shape[lost, place])
    return _means(filled, groups)


def _means(positions: Floats, groups: Sequence[NDArray[np.intp]]) -> Floats:
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


def register(shape: Floats, seen: Floats, weights: Floats, points: Floats) -> Floats:
    """Points (n, 3) of shapes (n, T, 3) after laying each on what is seen of it (n, T, 3), by weighted least squares.

    W. Kabsch, 1976, doi:10.1107/S0567739476001873.
    """
    share = (weights / weights.sum(axis=1, keepdims=True))[..., None]
    middle, centre = np.sum(share * shape, axis=1), np.sum(share * seen, axis=1)
    left, _, right = np.linalg.svd((share * (shape - middle[:, None])).swapaxes(1, 2) @ (seen - centre[:, None]))
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    turned: Floats = ((points - middle)[:, None] @ (left @ right))[:, 0]
    return np.asarray(turned + centre)
