"""Frames of reference that travel with a body segment, from markers that are more or less rigid to it."""

import numpy as np

from mocapclean.arrays import Floats, evenly_spaced
from mocapclean.geometry.body_frames import BodyFrames

_SAMPLE = 100
_ROUNDS = 2
_TURNS = 60
_MOVED = 1e-9  # of λ, which is between 1 and √3; the step after this one would be its square
_FLAT = 1e-5  # (σ₁ + σ₂)(σ₂ + σ₃)(σ₃ + σ₁)


def segment_frames(points: Floats, weights: Floats, n_learnt: int) -> list[BodyFrames]:
    """For each row of weights (v, q) the frames (n) that lay points (n, q, 3) on their mean shape, by least squares.

    The mean shape is that of up to 100 of the first ``n_learnt`` frames, laid on each other (J. C. Gower, 1975,
    doi:10.1007/BF02291478); all frames are then laid on it (W. Kabsch, 1976, doi:10.1107/S0567739476001873).
    """
    shares = weights / weights.sum(axis=1, keepdims=True)
    middle = points.mean(axis=1, keepdims=True)
    offsets = points - middle
    sample = offsets[evenly_spaced(n_learnt, _SAMPLE)]
    beside = sample.transpose(1, 0, 2).reshape(points.shape[1], -1)
    shapes = _centred(np.repeat(sample[None, len(sample) // 2], len(shares), axis=0), shares)
    for _ in range(_ROUNDS):
        turns = _laid(sample, shapes, shares)
        shapes = _centred(np.matmul(beside, turns.reshape(len(shares), 3 * len(sample), 3)) / len(sample), shares)
    origins = (middle + np.matmul(shares, offsets)).swapaxes(0, 1)
    return [BodyFrames(*each) for each in zip(_laid(offsets, shapes, shares).swapaxes(2, 3), origins, strict=True)]


def _centred(shapes: Floats, shares: Floats) -> Floats:
    """Shapes (v, q, 3) about their middles weighted by shares (v, q)."""
    return np.asarray(shapes - np.einsum("vq,vqc->vc", shares, shapes)[:, None])


def _laid(offsets: Floats, shapes: Floats, shares: Floats) -> Floats:
    """The rotations (v, n, 3, 3) that lay shapes (v, q, 3), centred, on offsets (n, q, 3)."""
    n, n_points, _ = offsets.shape
    weighted = (shapes * shares[..., None]).swapaxes(0, 1).reshape(n_points, -1)
    moments = (offsets.swapaxes(1, 2).reshape(-1, n_points) @ weighted).reshape(n, 3, len(shapes), 3)
    return rotations(moments.transpose(2, 0, 1, 3).reshape(-1, 3, 3)).reshape(len(shapes), n, 3, 3)


def lay(shape: Floats, seen: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The rotations (3, 3, b, F) and centres (3, b, F) that lay shapes (3, b, K) on what is seen (3, b, F, K)."""
    share = weights / weights.sum(axis=1, keepdims=True)
    model = share * (shape - (share * shape).sum(axis=2, keepdims=True))
    centre = (seen @ share[..., None])[..., 0]
    moments = (seen - centre[..., None]) @ np.moveaxis(model, 0, 2)
    turn = rotations(np.moveaxis(moments, 0, 2).reshape(-1, 3, 3))
    return np.moveaxis(turn, 0, 2).reshape(3, 3, *moments.shape[1:3]), centre


def rotations(moments: Floats) -> Floats:
    """The rotations R (n, 3, 3), det R = 1, that maximise tr(Rᵀ H) for matrices H (n, 3, 3).

    F. L. Markley, 1993, Attitude determination using vector observations: a fast optimal matrix algorithm: with the
    largest root λ of (λ² − ‖H‖²)² − 8 λ det H − 4 ‖cof H‖² = 0, which is max tr(Rᵀ H),

        R = ((κ + ‖H‖²) H + λ cof H − H Hᵀ H) / (κ λ − det H),   κ = (λ² − ‖H‖²) / 2.

    Newton's iteration finds λ from above. A last step of N. J. Higham's, 1986, doi:10.1137/0907079, takes away what
    rounding left. Where H is near rank 1 the formula loses its digits and the singular vectors serve; R is then one of
    many.
    """
    size = np.sqrt(np.einsum("nij,nij->n", moments, moments))
    unit = np.ascontiguousarray(np.moveaxis(moments, 0, 2)) / np.where(size > 0.0, size, 1.0)
    cofactors = _cofactors(unit)
    determinant, minors = np.einsum("jn,jn->n", unit[0], cofactors[0]), np.einsum("ijn,ijn->n", cofactors, cofactors)
    most = np.full(len(size), np.sqrt(3.0))
    for _ in range(_TURNS):
        excess = most * most - 1.0
        slope = 4.0 * most * excess - 8.0 * determinant
        step = (excess * excess - 8.0 * most * determinant - 4.0 * minors) / np.maximum(slope, _FLAT)
        most -= step
        if np.all((step < _MOVED) | (slope < 8.0 * _FLAT)):
            break
    kappa = 0.5 * (most * most - 1.0)
    denominator = kappa * most - determinant
    flat = denominator < _FLAT
    cube = np.einsum("ikn,kln->iln", np.einsum("ijn,kjn->ikn", unit, unit), unit)
    found = ((kappa + 1.0) * unit + most * cofactors - cube) / np.where(flat, 1.0, denominator)
    turned: Floats = np.moveaxis(0.5 * (found + _cofactors(found)), 2, 0)
    if flat.any():
        turned[flat] = rotations_by_svd(moments[flat])
    return turned


def rotations_by_svd(moments: Floats) -> Floats:
    """Return the rotations R (n, 3, 3), det R = 1, that maximise tr(Rᵀ H) for matrices H (n, 3, 3).

    From the singular vectors of H; W. Kabsch, 1976, doi:10.1107/S0567739476001873. ``rotations`` is several times
    faster and answers with these where H is near rank 1.
    """
    left, _, right = np.linalg.svd(moments)
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)


def _cofactors(matrices: Floats) -> Floats:
    """The cofactors (3, 3, n) of matrices (3, 3, n)."""
    found = np.empty_like(matrices)
    for i in range(3):
        (x, y, z), (u, v, w) = matrices[i - 2], matrices[i - 1]
        found[i, 0], found[i, 1], found[i, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return found


def register(shape: Floats, seen: Floats, weights: Floats, points: Floats) -> Floats:
    """Points (n, 3) of shapes (n, T, 3) after laying each on what is seen of it (n, T, 3), by weighted least squares.

    W. Kabsch, 1976, doi:10.1107/S0567739476001873.
    """
    share = (weights / weights.sum(axis=1, keepdims=True))[..., None]
    middle, centre = np.sum(share * shape, axis=1), np.sum(share * seen, axis=1)
    turns = rotations_by_svd((share * (shape - middle[:, None])).swapaxes(1, 2) @ (seen - centre[:, None]))
    turned: Floats = ((points - middle)[:, None] @ turns)[:, 0]
    return np.asarray(turned + centre)
