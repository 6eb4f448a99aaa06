"""Frames of reference that travel with a body segment, from markers that are more or less rigid to it."""

import numpy as np
from numpy.typing import NDArray

from mocapclean.numerics.body_frames import BodyFrames

Floats = NDArray[np.float64]

_SAMPLE = 100
_ROUNDS = 2
_TURNS = 30
_MOVED = 1e-7  # Newton's step after this one would be its square
_NUDGE = 1e-12 * np.array([[1.0, 0.3, -0.2], [-0.4, 1.1, 0.5], [0.1, -0.6, 0.9]])  # off singular matrices


def segment_frames(points: Floats, weights: Floats, n_learnt: int) -> BodyFrames:
    """The frames (n) that lay points (n, q, 3) on their mean shape, weighted (q,), by least squares.

    The mean shape is that of up to 100 of the first ``n_learnt`` frames, laid on each other (J. C. Gower, 1975,
    doi:10.1007/BF02291478); all frames are then laid on it (W. Kabsch, 1976, doi:10.1107/S0567739476001873).
    """
    share = weights / weights.sum()
    origins = np.einsum("nqc,q->nc", points, share)
    offsets = points - origins[:, None]
    sample = offsets[np.unique(np.linspace(0, n_learnt - 1, min(n_learnt, _SAMPLE)).astype(int))]
    shape = sample[len(sample) // 2]
    for _ in range(_ROUNDS):
        shape = np.matmul(sample, rotations(_moments(sample, shape, share))).mean(axis=0)
    return BodyFrames(rotations(_moments(offsets, shape, share)).swapaxes(1, 2), origins)


def _moments(offsets: Floats, shape: Floats, share: Floats) -> Floats:
    moments: Floats = np.matmul(offsets.swapaxes(1, 2), shape * share[:, None])
    return moments


def rotations(moments: Floats) -> Floats:
    """The rotations R (n, 3, 3), det R = 1, that maximise tr(Rᵀ H) for matrices H (n, 3, 3).

    R is the polar factor of H + cof H / σ₁, which has the singular vectors of H and a smallest singular value of the
    sign that makes them a rotation, also where H has rank 2. It is found by Newton's iteration, scaled: N. J. Higham,
    1986, doi:10.1137/0907079. Where H has rank 1, R is one of the many.
    """
    size = np.sqrt(np.einsum("nij,nij->n", moments, moments))
    factor = np.ascontiguousarray(np.moveaxis(moments, 0, 2)) / np.where(size > 0.0, size, 1.0)
    factor += _cofactors(factor) / _largest(factor) + _NUDGE[..., None]
    factor[..., size <= 0.0] = np.eye(3)[..., None]
    for _ in range(_TURNS):
        inverse = _cofactors(factor)
        inverse /= np.einsum("jn,jn->n", factor[0], inverse[0])
        scale = np.sqrt(np.sqrt(np.einsum("ijn,ijn->n", inverse, inverse) / np.einsum("ijn,ijn->n", factor, factor)))
        following = 0.5 * (scale * factor + inverse / scale)
        moved = float(np.abs(following - factor).max(initial=0.0))
        factor = following
        if moved < _MOVED:
            break
    return np.moveaxis(factor, 2, 0)


def _largest(matrices: Floats) -> Floats:
    """The largest singular values (n,) of matrices (3, 3, n), up to 4 % too large; at least 1e-3."""
    power = np.einsum("kin,kjn->nij", matrices, matrices)
    for _ in range(3):
        power = power @ power
    return np.asarray(np.maximum(np.einsum("nij,nij->n", power, power) ** 0.03125, 1e-3))


def _cofactors(matrices: Floats) -> Floats:
    """The cofactors (3, 3, n) of matrices (3, 3, n)."""
    found = np.empty_like(matrices)
    for i in range(3):
        (x, y, z), (u, v, w) = matrices[i - 2], matrices[i - 1]
        found[i, 0], found[i, 1], found[i, 2] = y * w - z * v, z * u - x * w, x * v - y * u
    return found
