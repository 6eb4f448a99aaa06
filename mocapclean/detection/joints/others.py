"""Judge single frames of joints by the other joints: what these explain in the same frame is motion, no pop.

The fourth differences of a joint's rotation are regressed on those of all other joints in the same frame. A sharp
motion of the whole body, and noise that joints share, are explained; a pop of one joint is not. With z the fourth
differences of all joints and P the inverse of their covariance, what the others do not explain of joint b is
P_bb⁻¹ (P z)_b. Source: S. L. Lauritzen, 1996, Graphical Models, section 5.1.3 (regression by the precision matrix).
"""

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.geometry.joint_motion import conjugate, times

_PATTERN = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
"""Fourth differences that a pop of one unit in one frame adds to the frames around it."""
_SCALE = 1.0 / 6.0
"""The fourth difference times this is how far a frame lies from the cubic through its four neighbours."""
_BESIDE = 5
"""Frames on each side whose fourth differences show how rough the motion is. As in ``pops``."""
_FOLDS, _BLOCK = 2, 60
"""Frames in blocks are predicted by a regression on the other blocks. Other numbers gave the same figures."""
_RIDGE = 0.05
"""Share of the mean variance that is added to all: a take has few frames for its joints. By hand; 0.01 to 0.6 differ
by 1 % of the pops at 30 Hz."""
_USUAL_SHARE = 0.9
"""Quantile of a joint's fourth differences that is its scale."""
_NOISE = 0.3
"""Degrees that are added to the scale of a joint, so that one at rest has no weight. Chosen by hand."""
_CLIP = 6.0
"""Scales at which a fourth difference is clipped in the regression, so that faults do not rule it. Chosen by hand."""
_FEWEST = 20
"""Frames in the other blocks without which nothing is regressed. Chosen by hand."""


def unexplained(paths: Floats) -> Floats:
    """Return the fourth differences (F - 4, S, 3) of rotations that the other joints do not explain.

    paths: (F, S, 4), unit quaternions in degrees. Differences are given in the axes of the joint, two frames before
    the last one that they contain.
    """
    before = paths[1:-3]
    sharp = times(conjugate(before), np.diff(paths, n=4, axis=0))[..., 1:]
    sharp /= np.linalg.norm(before, axis=2, keepdims=True)
    n_frames, n_joints, _ = sharp.shape
    size = np.linalg.norm(sharp, axis=2)
    scale = np.hypot(np.quantile(size, _USUAL_SHARE, axis=0), _NOISE)
    clipped = (sharp * np.minimum(1.0, _CLIP * scale / np.maximum(size, _NOISE))[..., None] / scale[:, None]).reshape(
        n_frames, 3 * n_joints
    )
    fold = np.arange(n_frames) // _BLOCK % _FOLDS
    rest = sharp.copy()
    for here in (fold == k for k in range(_FOLDS)):
        others = clipped[~here]
        if len(others) < _FEWEST:
            continue
        unexplained_share = _shares(others, n_joints)
        explained = clipped[here] - clipped[here] @ unexplained_share
        rest[here] -= explained.reshape(-1, n_joints, 3) * scale[:, None]
    return rest


def _shares(values: Floats, n_joints: int) -> Floats:
    """Return the matrix (3 S, 3 S) that takes the values of a frame to what the other joints do not explain of them."""
    covariance = values.T @ values
    ridge = _RIDGE * np.trace(covariance) / len(covariance)
    precision = np.linalg.inv(covariance + ridge * np.eye(len(covariance)))
    blocks = precision.reshape(n_joints, 3, n_joints, 3)
    own = blocks[np.arange(n_joints), :, np.arange(n_joints)]
    return np.asarray(np.einsum("iajb,jbc->iajc", blocks, np.linalg.inv(own))).reshape(precision.shape)


def fitted_pop(rest: Floats, signal: int, frame: int) -> tuple[float, float, float]:
    """Return the size of a pop in one frame by least squares, and the largest and median distance without it beside.

    rest: (F - 4, S, 3), as ``unexplained`` returns it. Distances are those from the cubic through four neighbours.
    """
    centre = frame - 2
    first = max(centre - _BESIDE, 0)
    beside = rest[first : centre + _BESIDE + 1, signal].copy()
    own = slice(centre - 2 - first, centre + 3 - first)
    pop = _PATTERN @ beside[own] / (_PATTERN @ _PATTERN)
    beside[own] -= _PATTERN[:, None] * pop
    distances = _SCALE * np.linalg.norm(beside, axis=1)
    return float(np.linalg.norm(pop)), float(distances.max()), float(np.median(distances))


def usual(rest: Floats, signals: Ints) -> Floats:
    """Return the distance (n,) that each of some signals exceeds in a tenth of the frames."""
    return np.asarray(_SCALE * np.quantile(np.linalg.norm(rest[:, signals], axis=2), _USUAL_SHARE, axis=0))
