"""Rotations as Euler angles over time: bridged over gaps, and written without needless jumps.

One rotation has many Euler angles: each angle plus whole turns and, for three different axes, the flipped triple
(α + 180°, 180° - β, γ + 180°).
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.geometry.skeleton import Skeleton

JUMP_DEGREES = 90.0
"""Degrees from one frame to the next beyond which other Euler angles of the same rotation are tried. Halfway to the
180 degrees by which the flipped triple differs; chosen by hand."""
FLIP_SIGNS = (1, -1, 1)
"""Signs of the flipped triple: (α, -β, γ) + 180° is (α + 180°, 180° - β, γ + 180°)."""


def rotations_of(skeleton: Skeleton) -> list[list[int]]:
    """Return the rotation channels of each joint in product order."""
    channels: list[list[int]] = [[] for _ in skeleton.names]
    for index in skeleton.product:
        channels[skeleton.channels[index].joint].append(index)
    return channels


def shifts_of(skeleton: Skeleton) -> list[list[int]]:
    """Return the position channels of each joint."""
    channels: list[list[int]] = [[] for _ in skeleton.names]
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation:
            channels[channel.joint].append(index)
    return channels


def is_ball(axes: list[int]) -> bool:
    """Whether rotations about these axes make a ball joint: three, about different axes."""
    return len(axes) == 3 and len(set(axes)) == 3


def bridge(skeleton: Skeleton, poses: Floats, free: Bools) -> Floats:
    """Return poses (F, C) whose free channels run straight from their last known values to their next.

    A gap at an end of the take repeats the nearest known value. A channel that is never known is zero, and so is a
    channel that is NaN and not free. The angles at the right end are those of the same rotation nearest to the left.
    """
    known = ~free & np.isfinite(poses)
    bridged = np.where(known, poses, 0.0)
    groups = [group for group in rotations_of(skeleton) if group]
    groups += [[i] for i, channel in enumerate(skeleton.channels) if not channel.is_rotation]
    for group in groups:
        axes = [skeleton.channels[i].axis for i in group if skeleton.channels[i].is_rotation]
        for first, stop in runs(np.asarray((~known[:, group]).any(axis=1))):
            ends = [poses[i, group] for i in (first - 1, stop) if 0 <= i < len(poses)]
            if not ends:
                continue
            left, right = ends[0], ends[-1]
            if axes:
                right = nearest_angles(axes, right, left)
            share = np.arange(1, stop - first + 1)[:, None] / (stop - first + 1)
            line = left + share * (right - left)
            bridged[first:stop, group] = np.where(free[first:stop, group], line, bridged[first:stop, group])
    return bridged


def nearest_angles(axes: list[int], angles: Floats, near: Floats) -> Floats:
    """Return the Euler angles (..., n), degrees, of the same rotations that are nearest to ``near``."""
    best = angles + 360 * np.round((near - angles) / 360)
    if is_ball(axes):
        flipped = angles * FLIP_SIGNS + 180
        flipped += 360 * np.round((near - flipped) / 360)
        closer = np.abs(flipped - near).sum(axis=-1) < np.abs(best - near).sum(axis=-1)
        best = np.where(closer[..., None], flipped, best)
    return best


def smoothest(axes: list[int], angles: Floats, has_left: bool, has_right: bool) -> Floats:
    """Return the same rotations (F, n) as angles with the fewest and smallest jumps.

    has_left, has_right: whether the first and the last row are neighbours of the run, which are kept as they are and
    not returned.
    """
    candidates = [angles]
    inner = slice(int(has_left), len(angles) - int(has_right))
    for direction in (1, -1):
        candidate = angles.copy()
        candidate[::direction] = _continued(axes, angles[::direction])
        if has_left:
            candidate[0] = angles[0]
        if has_right:
            candidate[-1] = angles[-1]
        candidates.append(candidate)

    def jumps(candidate: Floats) -> float:
        step = np.abs(np.diff(candidate, axis=0))
        return float(step[step > JUMP_DEGREES].sum())

    return min(candidates, key=jumps)[inner]


def _continued(axes: list[int], angles: Floats) -> Floats:
    """Return the same rotations (F, n) as the angles nearest to those of the frame before."""
    angles = np.unwrap(angles, period=360, axis=0)
    if is_ball(axes):
        for i in np.flatnonzero(np.abs(np.diff(angles, axis=0)).sum(axis=1) > JUMP_DEGREES) + 1:
            # Flip the whole rest of the run where that makes this step shorter.
            flipped = angles[i:] * FLIP_SIGNS + 180
            flipped += 360 * np.round((angles[i - 1] - flipped[0]) / 360)
            if np.abs(flipped[0] - angles[i - 1]).sum() < np.abs(angles[i] - angles[i - 1]).sum():
                angles[i:] = flipped
    return angles


def euler_angles(axes: list[int], matrices: Floats) -> Floats:
    """Return the angles (F, 3), degrees, of rotations (F, 3, 3) about three different axes i, j, k.

    With s = 1 where i, j, k is cyclic, else -1, the product R_i(α) R_j(β) R_k(γ) has R_ik = s sin β,
    R_jk = -s sin α cos β, R_kk = cos α cos β, R_ij = -s cos β sin γ and R_ii = cos β cos γ.
    """
    i, j, k = axes
    sign = 1 if (j - i) % 3 == 1 else -1
    first = np.arctan2(-sign * matrices[:, j, k], matrices[:, k, k])
    second = np.arcsin(np.clip(sign * matrices[:, i, k], -1, 1))
    third = np.arctan2(-sign * matrices[:, i, j], matrices[:, i, i])
    return np.asarray(np.degrees(np.stack([first, second, third], axis=1)))
