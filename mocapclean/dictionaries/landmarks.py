"""The frame of reference of a dictionary's body: its origin is the root, the hips and the neck span its plane."""

from collections.abc import Sequence

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.geometry.alignment import carry_points
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.numerics import interpolation

# Frames of the longest gap that is interpolated linearly; chosen by hand, 42 ms at 120 Hz.
_LONGEST_INTERPOLATED = 5
# Fewest trusted markers that locate a missing one: with fewer the rotation is not determined.
_FEWEST_MARKERS = 3
# Least SD of a distance between markers, relative to its mean; chosen by hand, so that no pair gets all weight.
_LEAST_RELATIVE_SD = 1e-4
# Length of a vector between landmarks, relative to their extent, at which it counts as 0; rounding errors are smaller.
_ZERO_LENGTH = 1e-9


def plane_frames(landmarks: Floats) -> BodyFrames:
    """Return the frames of landmarks (F, 4, 3): origin, right hip, left hip, neck.

    x points from the right hip to the left, y towards the neck in the plane of hips and neck. Where landmarks coincide
    or are collinear, the undetermined axes are those of the world.
    """
    origin, right, left, top = landmarks.swapaxes(0, 1)
    least = _ZERO_LENGTH * np.linalg.norm(np.ptp(landmarks, axis=1), axis=-1, keepdims=True)
    x = _unit(left - right, least, np.broadcast_to(np.eye(3)[0], origin.shape))
    # The world axis most nearly perpendicular to x, made perpendicular, is y where the neck is on the hip line.
    across = _perpendicular(np.eye(3)[np.abs(x).argmin(axis=-1)], x)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    y = _unit(_perpendicular(top - (left + right) / 2, x), least, across)
    return BodyFrames(np.stack([x, y, np.cross(x, y)], axis=1), origin)


def _perpendicular(vectors: Floats, axes: Floats) -> Floats:
    """Return vectors (F, 3) less their components along unit axes (F, 3)."""
    along: Floats = np.sum(vectors * axes, axis=-1, keepdims=True)
    return vectors - along * axes


def _unit(vectors: Floats, least: Floats, replacement: Floats) -> Floats:
    """Return vectors (F, 3) scaled to length 1; the replacement (F, 3) for those no longer than ``least`` (F, 1)."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    is_zero = length <= least
    return np.where(is_zero, replacement, vectors / np.where(is_zero, 1.0, length))


def place_landmarks(positions: Floats, trusted: Bools, groups: Sequence[Ints], torso: Ints, model: Floats) -> Floats:
    """Return the landmarks (F, 4, 3): the means of the markers of each group, with untrusted markers estimated.

    positions: (F, M, 3). trusted: (F, M). torso: columns of the markers on the torso, those of the groups among them.
    model: (P, M, 3), poses of this body in its own frame. A gap of up to 5 frames is interpolated linearly. In a longer
    one the shape of the torso is interpolated, in the coordinates of the body, and aligned with the trusted markers of
    the torso; those most rigid with the missing marker weigh most. With fewer than 3 trusted markers, the gap is
    interpolated linearly.
    """
    filled = interpolation.linear(positions, trusted)
    known = _with_short_gaps(trusted)
    marks = np.unique(np.concatenate(groups))
    complete: Bools = np.all(known[:, marks], axis=1)
    if not complete.all():
        # The shape of the torso in the frames of the complete landmarks; that of the model for markers without any
        frames = plane_frames(_means(filled, groups))
        measured = np.asarray(known[:, torso] & complete[:, None])
        shape = interpolation.linear(frames.to_local(filled[:, torso]), measured)
        shape = np.where(np.any(measured, axis=0)[:, None], shape, model[:, torso].mean(axis=0))
        for mark in marks:
            weights: Floats = known[:, torso] * rigidity_weights(model[:, torso], model[:, mark])
            lost = ~known[:, mark] & (np.count_nonzero(weights, axis=1) >= _FEWEST_MARKERS)
            (column,) = np.flatnonzero(torso == mark)
            filled[lost, mark] = carry_points(shape[lost], filled[lost][:, torso], weights[lost], shape[lost, column])
    return _means(filled, groups)


def _means(positions: Floats, groups: Sequence[Ints]) -> Floats:
    """Return the means (F, G, 3) of the markers of each group."""
    return np.stack([positions[:, group].mean(axis=1) for group in groups], axis=1)


def _with_short_gaps(trusted: Bools) -> Bools:
    """Return the trusted samples (F, M), with gaps of up to 5 frames between two of them."""
    known = trusted.copy()
    for marker, start, stop in column_runs(~trusted):
        if stop - start <= _LONGEST_INTERPOLATED and start > 0 and stop < len(trusted):
            known[start:stop, marker] = True
    return known


def rigidity_weights(model: Floats, mark: Floats) -> Floats:
    """Return weights (T,) of markers (P, T, 3): 1 / variance of their distance from one marker (P, 3), 1 at most."""
    distance = np.linalg.norm(model - mark[:, None], axis=-1)
    floor = (_LEAST_RELATIVE_SD * distance.mean()) ** 2
    weights: Floats = 1.0 / (distance.var(axis=0) + floor + np.finfo(float).tiny)
    return np.asarray(weights / weights.max())
