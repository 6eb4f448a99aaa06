"""Poses as rotations and translations of joints: unit quaternions instead of Euler angles, and the way back.

A quaternion is (w, x, y, z). Q and -Q are the same rotation, and one rotation has many Euler angles. Along the frames
of a joint the quaternions have the sign nearest to the frame before, so that a whole turn of an angle is no event.
Source: K. Shoemake, 1985, Animating rotation with quaternion curves, doi:10.1145/325165.325242.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.geometry.euler import (
    bridge,
    euler_angles,
    is_ball,
    rotations_of,
    shifts_of,
    smoothest,
)
from mocapclean.geometry.skeleton import Skeleton

_SMALL_ANGLE = 1e-8  # radians below which sin(a) / a is 1 in float64 and its Taylor series is used
_GIMBAL_COSINE = 1e-3  # cosine of the middle angle below which the outer two cannot be distinguished; by hand
_ASCENTS = 60  # turns through the free angles of a joint; each halves the rest or better, chosen by hand


@dataclass(frozen=True, kw_only=True)
class JointMotion:
    """The motion of each joint relative to its parent, in F frames of J joints.

    rotations: (F, J, 4) unit quaternions, identity where a joint does not turn. translations: (F, J, 3) mm, values of
    the position channels, 0 on axes without one. turns, shifts: (J,), whether the joint has rotation channels, and
    position channels. rotation_known, translation_known: (F, J), whether all of these can be trusted; True without
    channels. Where unknown, a rotation is that of a straight turn between the known ones (slerp), and a translation
    lies on a straight line.
    """

    rotations: Floats
    translations: Floats
    turns: Bools
    shifts: Bools
    rotation_known: Bools
    translation_known: Bools


def bridged_poses(skeleton: Skeleton, poses: Floats, known: Bools) -> Floats:
    """Return poses (F, C) in which channels that are not known (F, C) lie on a line between their known neighbours.

    A channel that is never known is 0.
    """
    return poses if known.all() else bridge(skeleton, poses, ~known)


def joint_motion(skeleton: Skeleton, poses: Floats, known: Bools) -> JointMotion:
    """Return the rotations and translations of poses (F, C), degrees and mm, whose channels are known (F, C) or not."""
    poses = bridged_poses(skeleton, poses, known)
    n_frames, n_joints = len(poses), len(skeleton.names)
    rotations = np.zeros((n_frames, n_joints, 4))
    rotations[..., 0] = 1.0
    translations = np.zeros((n_frames, n_joints, 3))
    rotation_known = np.ones((n_frames, n_joints), dtype=bool)
    translation_known = rotation_known.copy()
    turning, shifting = rotations_of(skeleton), shifts_of(skeleton)
    for joint, (turned, shifted) in enumerate(zip(turning, shifting, strict=True)):
        if turned:
            axes = [skeleton.channels[index].axis for index in turned]
            rotation_known[:, joint] = known[:, turned].all(axis=1)
            own = quaternions(axes, poses[:, turned])
            rotations[:, joint] = continuous(straight_turns(own, ~rotation_known[:, joint]))
        for index in shifted:
            translations[:, joint, skeleton.channels[index].axis] = poses[:, index]
        if shifted:
            translation_known[:, joint] = known[:, shifted].all(axis=1)
    return JointMotion(
        rotations=rotations,
        translations=translations,
        turns=np.array([bool(channels) for channels in turning]),
        shifts=np.array([bool(channels) for channels in shifting]),
        rotation_known=rotation_known,
        translation_known=translation_known,
    )


def straight_turns(rotations: Floats, unknown: Bools) -> Floats:
    """Return rotations (F, 4) in which runs of unknown frames (F,) turn at constant speed between their ends.

    A run at the first or last frame repeats the known rotation beside it. Without any known one the rotations stay.
    """
    turned = rotations.copy()
    for first, stop in runs(unknown):
        before, after = first > 0, stop < len(rotations)
        if not (before or after):
            break
        left = rotations[first - 1] if before else rotations[stop]
        right = rotations[stop] if after else rotations[first - 1]
        share = np.arange(1, stop - first + 1)[:, None] / (stop - first + 1)
        turned[first:stop] = times(left, from_vectors(share * rotation_vectors(times(conjugate(left), right))))
    return turned


def with_motion(skeleton: Skeleton, poses: Floats, wanted: Bools, rotations: Floats, translations: Floats) -> Floats:
    """Return poses (F, C) whose wanted channels (F, C) follow rotations (F, J, 4) and translations (F, J, 3).

    All other channels keep their values. Where some rotation channels of a joint are wanted, those angles come nearest
    to the rotation that the others allow. Angles are those of the rotation nearest to the frames beside.
    """
    poses, start = poses.copy(), bridged_poses(skeleton, poses, ~wanted & np.isfinite(poses))
    for joint, channels in enumerate(rotations_of(skeleton)):
        for first, stop in runs(np.asarray(wanted[:, channels].any(axis=1))):
            _write_run(skeleton, poses, wanted, start, rotations[:, joint], channels, slice(int(first), int(stop)))
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation:
            frames = wanted[:, index]
            poses[frames, index] = translations[frames, channel.joint, channel.axis]
    return poses


def _write_run(
    skeleton: Skeleton,
    poses: Floats,
    wanted: Bools,
    start: Floats,
    rotations: Floats,
    channels: list[int],
    frames: slice,
) -> None:
    """Set the wanted angles of one joint in a run of frames; ``start`` (F, C) are finite angles to begin with."""
    axes = [skeleton.channels[index].axis for index in channels]
    free = wanted[frames][:, channels]
    given = start[frames][:, channels]
    target = rotations[frames]
    angles, rest = given.copy(), np.ones(len(given), dtype=bool)
    if is_ball(axes):
        exact = euler_angles(axes, matrices(target))
        rest = ~free.all(axis=1) | (np.abs(np.cos(np.radians(exact[:, 1]))) <= _GIMBAL_COSINE)
        angles[~rest] = exact[~rest]
    if rest.any():
        angles[rest] = _nearest_allowed(axes, given[rest], free[rest], target[rest])
    before, after = frames.start > 0, frames.stop < len(poses)
    if free.all():
        beside = start[frames.start - before : frames.stop + after, channels].copy()
        beside[int(before) : len(beside) - int(after)] = angles
        angles = smoothest(axes, beside, before, after)
    for column, index in enumerate(channels):
        own = np.flatnonzero(free[:, column]) + frames.start
        poses[own, index] = angles[own - frames.start, column]


def _nearest_allowed(axes: list[int], angles: Floats, free: Bools, target: Floats) -> Floats:
    """Return angles (F, n), degrees, whose free ones (F, n) bring the product of rotations nearest to a target (F, 4).

    Each free angle a in turn: with the other factors fixed, R = A R_axis(a) B is nearest where R_axis(a) is nearest to
    Aᵀ T Bᵀ, which has a closed form: tan(a / 2) = v / w for that product's quaternion (w, ..., v, ...).
    """
    angles = angles.copy()
    several = int(free.sum(axis=1).max(initial=0)) > 1
    for _ in range(_ASCENTS if several else 1):
        for index in range(len(axes)):
            left = quaternions(axes[:index], angles[:, :index])
            right = quaternions(axes[index + 1 :], angles[:, index + 1 :])
            rest = times(conjugate(left), times(target, conjugate(right)))
            found = np.degrees(2.0 * np.arctan2(rest[:, 1 + axes[index]], rest[:, 0]))
            found += 360.0 * np.round((angles[:, index] - found) / 360.0)
            angles[:, index] = np.where(free[:, index], found, angles[:, index])
    return angles


def quaternions(axes: list[int], angles: Floats) -> Floats:
    """Return the quaternions (F, 4) of products of rotations about coordinate axes by angles (F, n) in degrees."""
    product = np.zeros((len(angles), 4))
    product[:, 0] = 1.0
    for column, axis in enumerate(axes):
        half = np.radians(angles[:, column]) / 2.0
        factor = np.zeros((len(angles), 4))
        factor[:, 0], factor[:, 1 + axis] = np.cos(half), np.sin(half)
        product = times(product, factor)
    return product


def times(one: Floats, other: Floats) -> Floats:
    """Return the products (..., 4) of quaternions."""
    a, b, c, d = np.moveaxis(one, -1, 0)
    e, f, g, h = np.moveaxis(other, -1, 0)
    product: Floats = np.stack(
        [
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        ],
        axis=-1,
    )
    return product


def conjugate(rotations: Floats) -> Floats:
    """Return the inverse rotations (..., 4) of unit quaternions."""
    return np.asarray(rotations * np.array([1.0, -1.0, -1.0, -1.0]))


def continuous(rotations: Floats) -> Floats:
    """Return the same rotations (F, ..., 4), each with the sign nearest to the frame before."""
    dots = np.einsum("...k,...k->...", rotations[1:], rotations[:-1])
    signs = np.cumprod(np.where(dots < 0.0, -1.0, 1.0), axis=0)
    result = rotations.copy()
    result[1:] *= signs[..., None]
    return result


def rotation_vectors(rotations: Floats) -> Floats:
    """Return the rotation vectors (..., 3), degrees, of quaternions (..., 4): axis times angle, at most 180 degrees."""
    signed = np.where(rotations[..., :1] < 0.0, -rotations, rotations)
    sine = np.linalg.norm(signed[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, signed[..., :1])
    # a / sin(a / 2), which is 2 for a = 0
    scale = np.where(sine > _SMALL_ANGLE, angle / np.where(sine > _SMALL_ANGLE, sine, 1.0), 2.0)
    return np.asarray(np.degrees(scale * signed[..., 1:]))


def from_vectors(vectors: Floats) -> Floats:
    """Return the quaternions (..., 4) of rotation vectors (..., 3) in degrees."""
    half = np.radians(vectors) / 2.0
    angle = np.linalg.norm(half, axis=-1, keepdims=True)
    # sin(a) / a, which is 1 for a = 0
    scale = np.where(angle > _SMALL_ANGLE, np.sin(angle) / np.where(angle > _SMALL_ANGLE, angle, 1.0), 1.0)
    return np.concatenate([np.cos(angle), scale * half], axis=-1)


def angles_between(one: Floats, other: Floats) -> Floats:
    """Return the angles (...), degrees, 0 to 180, of the rotations from one set of quaternions to the other."""
    return np.asarray(np.linalg.norm(rotation_vectors(times(conjugate(one), other)), axis=-1))


def matrices(rotations: Floats) -> Floats:
    """Return the rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(rotations, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.asarray(np.stack([np.stack(row, axis=-1) for row in rows], axis=-2))
