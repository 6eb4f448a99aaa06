"""Rotations of joints as quaternions and back: the same positions, whatever the order, branch and missing channels."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocapclean.geometry import joint_motion as jm
from mocapclean.geometry.skeleton import Channel, Skeleton, forward

ORDERS = [[*order] for order in itertools.permutations(range(3))]


def chain(axes: list[int], n_joints: int = 3) -> Skeleton:
    """A chain of joints that turn about these axes, the first of which translates."""
    channels = [Channel(joint=0, axis=axis, is_rotation=False) for axis in range(3)]
    channels += [Channel(joint=joint, axis=axis, is_rotation=True) for joint in range(n_joints) for axis in axes]
    before = np.tile([[0.0, 300.0, 20.0]], (n_joints, 1))
    return Skeleton(
        names=tuple(f"j{k}" for k in range(n_joints)),
        parents=tuple(range(-1, n_joints - 1)),
        before=before,
        after=np.zeros_like(before),
        frames=np.broadcast_to(np.eye(3), (n_joints, 3, 3)),
        channels=tuple(channels),
        product=tuple(range(3, len(channels))),
    )


def smooth_poses(skeleton: Skeleton, rng: np.random.Generator, n_frames: int = 60, size: float = 60.0) -> np.ndarray:
    time = np.linspace(0, 3, n_frames)[:, None]
    frequency, phase = rng.uniform(1, 3, (2, len(skeleton.channels)))
    return size * np.sin(frequency * time + phase)


@pytest.mark.parametrize("axes", [*ORDERS, [0, 2], [1], [2, 0, 2]], ids=str)
def test_the_quaternions_are_the_rotations_of_the_channels(axes, rng):
    skeleton = chain(axes)
    poses = rng.uniform(-400, 400, (50, len(skeleton.channels)))
    motion = jm.joint_motion(skeleton, poses, np.ones(poses.shape, dtype=bool))
    own = poses[:, 3 : 3 + len(axes)]
    letters = "".join("XYZ"[axis] for axis in axes)
    expected = Rotation.from_euler(letters, own, degrees=True).as_matrix()
    np.testing.assert_allclose(jm.matrices(motion.rotations[:, 0]), expected, atol=1e-12)
    np.testing.assert_allclose(np.abs(motion.translations[:, 0]), np.abs(poses[:, :3]))


@pytest.mark.parametrize("axes", [*ORDERS, [0, 2], [1]], ids=str)
def test_what_is_written_is_read_and_other_channels_stay(axes, rng):
    skeleton = chain(axes)
    poses = smooth_poses(skeleton, rng)
    motion = jm.joint_motion(skeleton, poses, np.ones(poses.shape, dtype=bool))
    wanted = rng.random(poses.shape) < 0.3
    written = jm.with_motion(skeleton, np.where(wanted, np.nan, poses), wanted, motion.rotations, motion.translations)
    np.testing.assert_array_equal(written[~wanted], poses[~wanted])
    for before, after in zip(forward(skeleton, poses), forward(skeleton, written), strict=True):
        np.testing.assert_allclose(after, before, atol=1e-6)


def test_a_run_is_written_on_the_branch_of_its_neighbours(rng):
    skeleton = chain([2, 0, 1])
    poses = smooth_poses(skeleton, rng) + 720.0 * (np.arange(12) >= 3)
    wanted = np.zeros(poses.shape, dtype=bool)
    wanted[20:40, 3:] = True
    motion = jm.joint_motion(skeleton, poses, ~wanted)
    full = jm.joint_motion(skeleton, poses, np.ones_like(wanted))
    written = jm.with_motion(skeleton, poses, wanted, full.rotations, motion.translations)
    np.testing.assert_allclose(written, poses, atol=1e-8)


def test_the_way_through_gimbal_lock_is_written(rng):
    skeleton = chain([2, 0, 1])
    poses = np.zeros((41, 12))
    poses[:, 4] = np.linspace(70, 110, 41)  # the middle angle passes 90 degrees at frame 20
    wanted = np.zeros(poses.shape, dtype=bool)
    wanted[5:35, 3:6] = True
    motion = jm.joint_motion(skeleton, poses, np.ones_like(wanted))
    written = jm.with_motion(skeleton, np.where(wanted, np.nan, poses), wanted, motion.rotations, motion.translations)
    assert np.isfinite(written).all()
    np.testing.assert_allclose(forward(skeleton, written)[1], forward(skeleton, poses)[1], atol=1e-4)


def test_vectors_and_angles(rng):
    vectors = rng.normal(size=(200, 3)) * np.geomspace(1e-9, 60, 200)[:, None]
    rotations = jm.from_vectors(vectors)
    np.testing.assert_allclose(jm.rotation_vectors(rotations), vectors, atol=1e-9)
    np.testing.assert_allclose(jm.rotation_vectors(-rotations), vectors, atol=1e-9)
    expected = Rotation.from_rotvec(vectors, degrees=True).magnitude() * 180 / np.pi
    np.testing.assert_allclose(jm.angles_between(rotations, jm.from_vectors(np.zeros((200, 3)))), expected, atol=1e-9)


def test_a_straight_turn_has_constant_speed_and_meets_both_ends(rng):
    ends = jm.from_vectors(np.array([[10.0, 0, 0], [0, 50.0, 30.0]]))
    rotations = np.concatenate([ends[:1], np.tile(ends[:1], (8, 1)), ends[1:]])
    unknown = np.ones(10, dtype=bool)
    unknown[[0, -1]] = False
    turned = jm.straight_turns(rotations, unknown)
    steps = jm.angles_between(turned[1:], turned[:-1])
    np.testing.assert_allclose(steps, steps[0], atol=1e-9)
    at_end = jm.straight_turns(rotations, np.arange(10) > 3)
    np.testing.assert_allclose(at_end[4:], rotations[[3] * 6], atol=1e-12)


def test_continuous_quaternions_are_the_same_rotations(rng):
    poses = np.stack([np.linspace(0, 1000, 300), np.zeros(300), np.zeros(300)], axis=1)
    rotations = jm.quaternions([0, 1, 2], poses) * rng.choice([-1.0, 1.0], (300, 1))
    smooth = jm.continuous(rotations)
    assert (np.einsum("fk,fk->f", smooth[1:], smooth[:-1]) > 0).all()
    np.testing.assert_allclose(jm.matrices(smooth), jm.matrices(rotations), atol=1e-12)
