"""Inverse kinematics: targets are reached, trusted joints stay, free channels are never read, nothing flips."""

import numpy as np
import pytest

from mocapclean.formats import amc, bvh
from mocapclean.geometry import inverse_kinematics
from mocapclean.geometry.inverse_kinematics import fit
from mocapclean.geometry.skeleton import Channel, Skeleton, forward
from mocapclean.take import ReadOptions

FRAMES = 90
GAP = slice(30, 60)


def chain(parents, before, after=None, orders=None, shifts=(0,), frames=None):
    """A skeleton with the given rotation axes, in product order, and shifts for some joints."""
    n_joints = len(parents)
    channels, product = [], []
    for joint in range(n_joints):
        if joint in shifts:
            channels += [Channel(joint=joint, axis=axis, is_rotation=False) for axis in range(3)]
        for axis in orders[joint] if orders else (2, 0, 1):
            product.append(len(channels))
            channels.append(Channel(joint=joint, axis=axis, is_rotation=True))
    return Skeleton(
        names=tuple(f"j{i}" for i in range(n_joints)),
        parents=tuple(parents),
        before=np.asarray(before, dtype=float),
        after=np.zeros((n_joints, 3)) if after is None else np.asarray(after, dtype=float),
        frames=np.tile(np.eye(3), (n_joints, 1, 1)) if frames is None else frames,
        channels=tuple(channels),
        product=tuple(product),
    )


def body(order=(2, 0, 1), shifts=(0,)):
    """A root with two three-bone limbs and a fork, in the manner of BVH."""
    parents = [-1, 0, 1, 2, 3, 0, 5, 6, 2]
    before = np.array([[0, 0, 0], [100, 50, 0], [0, -300, 0], [0, -280, 20], [0, -20, 90], [-100, 50, 0],
                       [0, -300, 0], [0, -280, 20], [60, -40, 30]], dtype=float)  # fmt: skip
    before[[j for j in shifts if j]] = 0
    return chain(parents, before, orders=[order] * 9, shifts=shifts)


def acclaim():
    """A root with an arm of ball, hinge, twist and wrist, in the manner of ASF."""
    after = [[0, 0, 0], [0, 200, 0], [280, 0, 0], [240, 0, 0], [90, 0, 0], [60, 10, 20], [40, 5, -30]]
    tilted = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    frames = np.tile(np.eye(3), (7, 1, 1))
    frames[1] = tilted
    orders = [(2, 1, 0), (2, 1, 0), (2, 1, 0), (1,), (0,), (2, 1), (2,)]
    return chain([-1, 0, 1, 2, 3, 4, 5], np.zeros((7, 3)), after, orders, frames=frames)


def motion(skeleton, rng, n_frames=FRAMES, size=25.0):
    """Smooth poses, knees and elbows well bent, about an offset pose."""
    time = np.linspace(0, 2 * np.pi, n_frames)[:, None]
    n = len(skeleton.channels)
    poses = rng.uniform(20, 40, n) + size * np.sin(time + rng.uniform(0, 6, n)) * rng.uniform(0.3, 1, n)
    shifted = [i for i, c in enumerate(skeleton.channels) if not c.is_rotation and skeleton.parents[c.joint] >= 0]
    poses[:, shifted] = rng.uniform(50, 200, len(shifted))
    return poses


def without(skeleton, joints, span=GAP, n_frames=FRAMES):
    wanted = np.zeros((n_frames, len(skeleton.names)), dtype=bool)
    wanted[span, joints] = True
    return wanted


def off(skeleton, result, targets):
    return np.linalg.norm(forward(skeleton, result.poses)[0] - targets, axis=2)


def noise(rng, shape, size):
    time = np.linspace(0, 2 * np.pi, shape[0])[:, None, None]
    return size * np.sin(2 * time + rng.uniform(0, 6, shape[1:]))


SKELETONS = {
    "ZXY": body(),
    "XYZ": body((0, 1, 2)),
    "YXZ": body((1, 0, 2)),
    "shifts": body(shifts=range(9)),
    "acclaim": acclaim(),
}


@pytest.fixture(params=SKELETONS, ids=str)
def skeleton(request):
    return SKELETONS[request.param]


@pytest.mark.parametrize("joint", range(7))
def test_a_reachable_target_is_reached_and_nothing_else_moves(skeleton, joint, rng):
    poses = motion(skeleton, rng)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [joint])
    result = fit(skeleton, poses, truth, ~wanted, wanted)
    away = off(skeleton, result, truth)
    assert np.array_equal(result.fitted, wanted)
    assert np.quantile(away[wanted], 0.9) < 0.5
    assert away[wanted].max() < 5
    assert away[~wanted].max() < 0.1
    assert not result.changed[~wanted.any(axis=1)].any()
    assert np.array_equal(result.poses[~result.changed], poses[~result.changed])


@pytest.mark.parametrize("joints", [[0], [2, 3], [1, 2, 3, 4], list(range(7))], ids=str)
def test_trusted_joints_are_held_when_targets_err(skeleton, joints, rng):
    poses = motion(skeleton, rng)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, joints)
    targets = truth + noise(rng, truth.shape, 10.0) * wanted[:, :, None]
    result = fit(skeleton, poses, targets, ~wanted, wanted)
    assert np.array_equal(result.fitted, wanted)
    assert off(skeleton, result, truth)[~wanted].max() < 0.1
    assert off(skeleton, result, targets)[wanted].max() < 40


def test_a_nearer_pose_is_not_to_be_found(skeleton, rng):
    poses = motion(skeleton, rng)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [2, 3])
    targets = truth + noise(rng, truth.shape, 10.0) * wanted[:, :, None]
    result = fit(skeleton, poses, targets, ~wanted, wanted)
    best = (off(skeleton, result, targets)[GAP] ** 2 * np.where(wanted, 1, 1e4)[GAP]).sum(axis=1)
    for _ in range(40):
        moved = result.poses + rng.normal(0, 0.5, poses.shape) * result.changed
        away = np.linalg.norm(forward(skeleton, moved)[0] - targets, axis=2)[GAP]
        assert np.all((away**2 * np.where(wanted, 1, 1e4)[GAP]).sum(axis=1) > 0.9 * best)


def test_free_channels_are_never_read(skeleton, rng):
    poses = motion(skeleton, rng)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [2, 4])
    targets = truth + noise(rng, truth.shape, 8.0) * wanted[:, :, None]
    result = fit(skeleton, poses, targets, ~wanted, wanted)
    garbage = np.where(result.changed, rng.uniform(-180, 180, poses.shape), poses)
    again = fit(skeleton, garbage, targets, ~wanted, wanted)
    np.testing.assert_array_equal(again.poses, result.poses)


def test_angles_do_not_flip(skeleton, rng):
    poses = motion(skeleton, rng)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [2])
    result = fit(skeleton, poses, truth, ~wanted, wanted)
    turns = [i for i, c in enumerate(skeleton.channels) if c.is_rotation]
    assert np.abs(np.diff(result.poses[:, turns], axis=0)).max() < 15
    assert np.abs(np.diff(poses, axis=0)).max() < 3


def test_a_gap_across_the_wrap_of_an_angle_is_bridged_the_short_way():
    skeleton = chain([-1, 0], [[0, 0, 0], [0, 100, 0]])
    poses = np.zeros((40, 9))
    turning = np.linspace(170, 190, 40)
    poses[:, 3] = (turning + 180) % 360 - 180
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [1], slice(10, 30), 40)
    result = fit(skeleton, poses, truth, ~wanted, wanted)
    np.testing.assert_allclose(result.poses[10:30, 3], turning[10:30], atol=1e-3)


def test_missing_channels_are_given_numbers_and_the_others_are_kept(skeleton, rng):
    whole = motion(skeleton, rng)
    poses = whole.copy()
    missing = [i for i, c in enumerate(skeleton.channels) if c.is_rotation and c.joint == 0]
    poses[GAP, missing] = np.nan
    truth, _ = forward(skeleton, whole)
    wanted = np.isnan(forward(skeleton, poses)[0]).any(axis=2)
    targets = truth + noise(rng, truth.shape, 3.0) * wanted[:, :, None]
    result = fit(skeleton, poses, targets, ~wanted, wanted)
    assert np.array_equal(result.changed, np.isnan(poses))
    assert np.array_equal(result.fitted, wanted)
    assert off(skeleton, result, truth).max() < 10
    nothing = fit(skeleton, poses, targets, ~wanted, np.zeros_like(wanted))
    np.testing.assert_array_equal(nothing.poses, poses)
    assert not nothing.changed.any()


def test_a_joint_that_cannot_be_fitted_is_left_and_reported(rng):
    skeleton = body()
    poses = motion(skeleton, rng)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [2, 6])
    targets = truth.copy()
    targets[GAP, 3] += 400  # no pose brings the trusted joint below j2 there
    result = fit(skeleton, poses, targets, ~wanted, wanted)
    assert not result.fitted[:, 2].any()
    assert np.array_equal(result.fitted[:, 6], wanted[:, 6])
    below = [i for i, c in enumerate(skeleton.channels) if c.joint in (2, 3, 4)]
    assert not result.changed[:, below].any()


def test_a_zero_offset_a_rigid_joint_and_a_single_frame_are_no_obstacle(rng):
    skeleton = chain(
        [-1, 0, 1, 2, 3],
        [[0, 0, 0], [100, 0, 0], [0, 0, 0], [0, 0, 0], [0, 80, 0]],
        orders=[(2, 0, 1), (), (2, 0, 1), (1,), ()],
    )
    poses = motion(skeleton, rng, n_frames=1)
    truth, _ = forward(skeleton, poses)
    wanted = np.ones((1, 5), dtype=bool)
    everything = fit(skeleton, np.zeros_like(poses), truth, ~wanted, wanted)
    assert off(skeleton, everything, truth).max() < 0.1
    for joint in range(5):
        wanted = np.arange(5)[None] == joint
        result = fit(skeleton, poses, truth, ~wanted, wanted)
        assert np.isfinite(result.poses).all()
        assert off(skeleton, result, truth)[~wanted].max() < 0.1


def test_a_target_that_is_not_finite_is_not_fitted(rng):
    skeleton = body()
    poses = motion(skeleton, rng)
    targets, _ = forward(skeleton, poses)
    wanted = without(skeleton, [3])
    targets[40, 3] = np.nan
    result = fit(skeleton, poses, targets, ~wanted, wanted)
    assert not result.fitted[40, 3]
    assert result.fitted.sum() == wanted.sum() - 1
    assert not result.changed[40].any()


@pytest.mark.parametrize(
    "name",
    ["amc/49_02.amc", "bvh/PyMO__AV_8Walk_Meredith_HVHA_Rep1.bvh", "bvh/ganimator__idle1.bvh"],
)
def test_ten_joints_out_for_a_second_in_a_real_capture(captures, name, rng):
    read = amc.read if name.endswith("amc") else bvh.read
    take = read(captures / name, ReadOptions())
    n_frames = min(180, len(take.positions))
    poses, truth = take.origin.document.poses[:n_frames], take.positions[:n_frames]
    wanted = np.zeros(truth.shape[:2], dtype=bool)
    wanted[60:120, rng.choice(wanted.shape[1], 10, replace=False)] = True
    targets = truth + noise(rng, truth.shape, 5.0) * wanted[:, :, None]
    for goals, allowed in ((truth, 1.0), (targets, 15.0)):
        result = fit(take.skeleton, poses, goals, ~wanted, wanted)
        away = off(take.skeleton, result, goals)
        assert np.array_equal(result.fitted, wanted)
        assert np.quantile(away[wanted], 0.95) < allowed
        assert away[~wanted].max() < 0.1


def test_frames_that_are_left_out_of_a_fit_change_nothing(skeleton, rng, monkeypatch):
    poses = motion(skeleton, rng, n_frames=400)
    truth, _ = forward(skeleton, poses)
    wanted = np.zeros(truth.shape[:2], dtype=bool)
    for start, length, joint in [(0, 5, 3), (40, 30, 2), (74, 3, 5), (90, 1, 1), (392, 8, 4)]:
        wanted[start : start + length, joint] = True
    targets = truth + noise(rng, truth.shape, 15.0) * wanted[:, :, None]
    # Angles without a value: within wanted frames, beside them, and far away.
    for start, stop, channel in [(50, 55, 7), (68, 72, 9), (200, 210, 8), (380, 392, 6)]:
        poses[start:stop, channel] = np.nan
    few = fit(skeleton, poses, targets, ~wanted, wanted)
    assert len(inverse_kinematics._frames_that_matter(poses, wanted)) < 100
    monkeypatch.setattr(inverse_kinematics, "_frames_that_matter", lambda poses, wanted: np.arange(len(poses)))
    every = fit(skeleton, poses, targets, ~wanted, wanted)
    assert every.fitted.any()
    np.testing.assert_array_equal(few.poses, every.poses)
    np.testing.assert_array_equal(few.changed, every.changed)
    np.testing.assert_array_equal(few.fitted, every.fitted)


def test_jumps_are_as_far_apart_as_their_frames(rng):
    skeleton = body()
    poses = motion(skeleton, rng, n_frames=200)
    truth, _ = forward(skeleton, poses)
    wanted = without(skeleton, [3], slice(50, 60), 200) | without(skeleton, [3], slice(90, 100), 200)
    found = []
    for frames in (inverse_kinematics._frames_that_matter(poses, wanted), np.arange(200)):
        state = inverse_kinematics._Fitting(skeleton, poses, frames, truth, ~wanted, wanted, 0.1)
        state.choose_free(state.wanted.any(axis=1))
        channel = np.flatnonzero(state.free.any(axis=0) & state.is_rotation)[0]
        state.poses[np.isin(frames, [51, 98]), channel] += 90.0
        found.append(frames[state._frames_at_jumps()].tolist())
    assert found[0] == found[1] == [50, 51, 52, 53, 96, 97, 98, 99]
