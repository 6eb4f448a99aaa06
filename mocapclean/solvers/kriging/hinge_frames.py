"""Frames of a joint between two others at known distances, as a knee is between hip and ankle.

Two distances leave a circle about the line between the others. How far along the line its centre is, and its radius,
follow from the triangle (the law of cosines); only where on the circle the joint is has to be told from other things.
"""

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.geometry.body_frames import BodyFrames

_STRAIGHT = 0.02  # least radius, as a share of a length
_ALONG = 1e-3  # sine of the angle below which a direction counts as that of the line


def hinge_frames(
    ends: Floats, lengths: tuple[float, float], base: BodyFrames, target: Floats, n_learnt: int
) -> tuple[BodyFrames, Floats] | None:
    """The frames (n) at the circle's centre and the radii (n,), mm, of joints at ``lengths`` from ends (n, 2, 3).

    The first axis runs from end to end, the second to where the joint is on average as seen from ``base``: over the
    first ``n_learnt`` targets (n, 3), where it is known. None where that is along the line.
    """
    line = ends[:, 1] - ends[:, 0]
    apart = np.linalg.norm(line, axis=1)
    line = line / np.maximum(apart, 1e-9)[:, None]
    along = (apart**2 + lengths[0] ** 2 - lengths[1] ** 2) / (2.0 * np.maximum(apart, 1e-9))
    centres = ends[:, 0] + along[:, None] * line
    radii = np.sqrt(np.maximum(lengths[0] ** 2 - along**2, (_STRAIGHT * lengths[0]) ** 2))
    mean = np.einsum("nij,nj->i", base.axes[:n_learnt], target[:n_learnt] - centres[:n_learnt]) / n_learnt
    outward = mean @ base.axes
    outward = outward - np.sum(outward * line, axis=1, keepdims=True) * line
    size = np.linalg.norm(outward, axis=1, keepdims=True)
    if size.min() <= _ALONG * np.linalg.norm(mean):
        return None
    outward = outward / size
    return BodyFrames(np.stack([line, outward, np.cross(line, outward)], axis=1), centres), radii
