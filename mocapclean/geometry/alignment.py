"""Alignment of point sets by rotation and translation, and frames of reference from it.

Aligning many shapes with their own mean is generalised Procrustes analysis: J. C. Gower, 1975, doi:10.1007/BF02291478.
Aligning one shape with another is W. Kabsch's problem, 1976, doi:10.1107/S0567739476001873.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.geometry.rotations import fit_rotations, fit_rotations_by_svd, fit_rotations_of_columns
from mocapclean.numerics import interpolation

# Most frames that the mean shape of a segment is taken over, and rounds of Procrustes analysis for it. Chosen by hand
# for speed, no sweep was kept; few suffice, as a segment is nearly rigid.
_SEGMENT_SAMPLE = 100
_SEGMENT_ROUNDS = 2
# The same rounds for a whole body, which is not rigid; chosen by hand, no sweep was kept.
_BODY_ROUNDS = 30


def segment_frames(points: Floats, weights: Floats, n_learnt: Ints) -> BodyFrames:
    """Return the frames (G, v, n) that align v mean shapes of each of G segments with its points (G, n, q, 3).

    The alignments are weighted least squares with weights (G, v, q). The mean shapes are those of 100 of the first
    ``n_learnt`` (G,) frames, aligned with each other.
    """
    shares = weights / weights.sum(axis=2, keepdims=True)
    centroids = points.mean(axis=2, keepdims=True)
    offsets = points - centroids
    rows = np.linspace(0, n_learnt - 1, _SEGMENT_SAMPLE, axis=1).astype(np.intp)
    sample = offsets[np.arange(len(offsets))[:, None], rows]
    points_of_frames = sample.transpose(0, 2, 1, 3).reshape(len(sample), 1, points.shape[2], -1)
    # Procrustes rounds from the middle frame: align the sample with the shape, then average it in the shape's frame.
    shapes = _centred(np.repeat(sample[:, None, _SEGMENT_SAMPLE // 2], shares.shape[1], axis=1), shares)
    for _ in range(_SEGMENT_ROUNDS):
        rotations = _alignments(sample, shapes, shares).reshape(*shares.shape[:2], -1, 3)
        shapes = _centred(np.matmul(points_of_frames, rotations) / _SEGMENT_SAMPLE, shares)
    origins = centroids.swapaxes(1, 2) + np.einsum("gvq,gnqc->gvnc", shares, offsets, optimize=True)
    return BodyFrames(_alignments(offsets, shapes, shares).swapaxes(3, 4), origins)


def _centred(shapes: Floats, shares: Floats) -> Floats:
    """Return shapes (G, v, q, 3) less their centroids under weights of sum 1 (G, v, q)."""
    return np.asarray(shapes - np.matmul(shares[:, :, None], shapes))


def _alignments(offsets: Floats, shapes: Floats, shares: Floats) -> Floats:
    """Return the rotations (G, v, n, 3, 3) that align centred shapes (G, v, q, 3) with offsets (G, n, q, 3)."""
    n_segments, n_frames, n_points, _ = offsets.shape
    # H = Σ_q w_q x_q s_qᵀ of every frame and shape, in one product for each segment
    weighted = (shapes * shares[..., None]).swapaxes(1, 2).reshape(n_segments, n_points, -1)
    moments = offsets.swapaxes(2, 3).reshape(n_segments, -1, n_points) @ weighted
    moments = moments.reshape(n_segments, n_frames, 3, -1, 3).transpose(0, 3, 1, 2, 4)
    return fit_rotations(moments.reshape(-1, 3, 3)).reshape(moments.shape)


def align_shapes(shape: Floats, positions: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Return the rotations (3, 3, b, F) and centroids (3, b, F) that align shapes (3, b, K) with positions.

    positions: (3, b, F, K). weights: (b, K), those of the least squares. The centroids are the weighted means of the
    positions.
    """
    share = weights / weights.sum(axis=1, keepdims=True)
    model = share * (shape - (share * shape).sum(axis=2, keepdims=True))
    # Centroid and moments Σ w x sᵀ in one product, for the weighted shape sums to 0.
    products = np.concatenate([share[None], model]).swapaxes(0, 1) @ positions.swapaxes(2, 3)
    moments = np.ascontiguousarray(products[:, :, 1:].swapaxes(1, 2))
    rotations = fit_rotations_of_columns(moments.reshape(3, 3, -1))
    return rotations.reshape(moments.shape), products[:, :, 0]


def carry_points(shapes: Floats, positions: Floats, weights: Floats, points: Floats) -> Floats:
    """Return points (n, 3) moved along with shapes (n, T, 3) that are aligned with positions (n, T, 3).

    weights: (n, T), those of the least squares. Each point is in the coordinates of its shape.
    """
    share = (weights / weights.sum(axis=1, keepdims=True))[..., None]
    shape_centroid, centroid = np.sum(share * shapes, axis=1), np.sum(share * positions, axis=1)
    moments = (share * (shapes - shape_centroid[:, None])).swapaxes(1, 2) @ (positions - centroid[:, None])
    rotations = fit_rotations_by_svd(moments)
    rotated: Floats = ((points - shape_centroid)[:, None] @ rotations)[:, 0]
    return np.asarray(rotated + centroid)


def mean_shape_frames(positions: Floats, trusted: Bools) -> BodyFrames:
    """Return the frames (F) that align a take's mean shape with its trusted samples (F, M) of positions (F, M, 3).

    Generalised Procrustes analysis of incomplete shapes alternates two steps: every frame is aligned with the mean
    shape by its trusted samples alone, and the mean shape is that of the trusted samples in these frames. It starts
    from the middle frame. A frame without a trusted sample has the axes and origin of the frame before it, or of the
    first frame with one.
    """
    weights = trusted.astype(float)
    known = np.where(trusted[..., None], positions, 0.0)
    shape = interpolation.linear(positions, trusted)[len(positions) // 2]
    count = np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
    centroids = known.sum(axis=1) / count
    offsets = np.where(trusted[..., None], known - centroids[:, None], 0.0)
    frames = BodyFrames(np.broadcast_to(np.eye(3), (len(weights), 3, 3)), centroids)
    for _ in range(_BODY_ROUNDS):
        # Align every frame with the shape; the centroid is that of the frame's trusted markers.
        shape = shape - shape.mean(axis=0)
        shape_centroids = weights @ shape / count
        axes = fit_rotations_by_svd(np.einsum("fm,mi,fmj->fij", weights, shape, offsets, optimize=True))
        frames = BodyFrames(axes, centroids - np.einsum("fij,fi->fj", axes, shape_centroids))
        # Average the trusted samples in their frames.
        local = np.where(trusted[..., None], frames.to_local(known), 0.0)
        shape = local.sum(axis=0) / np.maximum(weights.sum(axis=0), 1.0)[:, None]
    # The last frame with a trusted sample, or the first one at the beginning of the take
    is_empty = np.asarray(~trusted.any(axis=1))
    source = np.maximum.accumulate(np.where(is_empty, -1, np.arange(len(trusted))))
    source = np.where(source < 0, np.argmin(is_empty), source)
    return BodyFrames(frames.axes[source], frames.origins[source])
