"""Forward kinematics: textbook cases, its own axes, and what a missing channel decides."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.geometry.skeleton import Channel, Skeleton, forward, influence, move, places, settled, turn


def arm(carried=False):
    """A root that shifts and turns, an upper arm, a rigid joint, a forearm; bones before or after their joints."""
    bones = np.array([[0, 0, 0], [0, 300, 0], [10, 0, 0], [250, 0, 0]], dtype=float)
    axes = [(False, 0, 0), (False, 0, 1), (False, 0, 2), (True, 0, 2), (True, 0, 0), (True, 1, 1), (True, 3, 2)]
    frames = np.tile(np.eye(3), (4, 1, 1))
    frames[1] = turn(0, np.array(90.0))
    return Skeleton(
        names=("root", "upper", "rigid", "fore"),
        parents=(-1, 0, 1, 2),
        before=np.zeros((4, 3)) if carried else bones,
        after=bones if carried else np.zeros((4, 3)),
        frames=frames,
        channels=tuple(Channel(joint=j, axis=a, is_rotation=r) for r, j, a in axes),
        product=(3, 4, 5, 6),
    )


@pytest.fixture(params=[False, True], ids=["before", "after"])
def skeleton(request):
    return arm(request.param)


@pytest.mark.parametrize("axis", range(3))
def test_a_quarter_turn_takes_each_axis_to_the_next(axis):
    quarter = turn(axis, np.array([90.0]))[0]
    np.testing.assert_allclose(quarter @ np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3], atol=1e-15)


def test_positions_of_a_pose_worked_out_by_hand():
    positions, rotations = forward(arm(), np.array([[1.0, 2, 3, 90, 0, 0, 0]]))
    np.testing.assert_allclose(positions[0], [[1, 2, 3], [-299, 2, 3], [-299, 12, 3], [-299, 262, 3]], atol=1e-12)
    np.testing.assert_allclose(rotations[0, 3], turn(2, np.array(90.0)), atol=1e-15)


def test_a_joint_turns_within_its_own_axes():
    positions, _ = forward(arm(carried=True), np.array([[0.0, 0, 0, 0, 0, 90, 0]]))
    # y in axes that are turned by 90 degrees about x is the parent's z: y goes to -x
    np.testing.assert_allclose(positions[0, 1], [-300, 0, 0], atol=1e-12)


def test_axes_are_the_derivatives(skeleton, rng):
    poses = rng.uniform(-90, 90, (5, 7))
    motion = move(skeleton, poses)
    moved, _ = influence(skeleton)
    for index, channel in enumerate(skeleton.channels):
        nudge = np.zeros(7)
        nudge[index] = 1e-4
        change = (forward(skeleton, poses + nudge)[0] - forward(skeleton, poses - nudge)[0]) / 2e-4
        axis = motion.axes[:, None, index]
        if channel.is_rotation:
            hub = (
                motion.positions[:, channel.joint] - motion.rotations[:, channel.joint] @ skeleton.after[channel.joint]
            )
            axis = np.radians(np.cross(axis, motion.positions - hub[:, None]))
        expected = np.where(moved[None, :, index, None], axis, 0.0)
        np.testing.assert_allclose(change, np.broadcast_to(expected, change.shape), atol=1e-5)


def test_a_missing_channel_spoils_what_it_decides_and_nothing_else(skeleton, rng):
    poses = rng.uniform(-90, 90, (3, 7))
    whole, turned = forward(skeleton, poses)
    poses[1, 5] = np.nan  # of the upper arm
    positions, rotations = forward(skeleton, poses)
    spoilt = [1, 2, 3] if skeleton.after.any() else [2, 3]
    assert np.flatnonzero(np.isnan(positions[1]).all(axis=1)).tolist() == spoilt
    assert np.flatnonzero(np.isnan(rotations[1]).all(axis=(1, 2))).tolist() == [1, 2, 3]
    np.testing.assert_array_equal(positions[[0, 2]], whole[[0, 2]])
    np.testing.assert_array_equal(rotations[1, :1], turned[1, :1])
    kept = [j for j in range(4) if j not in spoilt]
    np.testing.assert_array_equal(positions[1, kept], whole[1, kept])


def test_places_are_those_of_the_whole_kinematics(skeleton, rng):
    poses = rng.uniform(-90, 90, (40, 7))
    np.testing.assert_array_equal(places(skeleton, poses), move(skeleton, poses).positions)
    poses[rng.random(poses.shape) < 0.1] = np.nan
    np.testing.assert_array_equal(places(skeleton, poses), forward(skeleton, poses)[0])


def test_kinematics_are_the_products_of_matrices(skeleton, rng):
    poses = rng.uniform(-180, 180, (5, 7))
    motion = move(skeleton, poses)
    rotations, positions = [], []
    for joint, parent in enumerate(skeleton.parents):
        # G = G_parent C R Cᵀ and p = p_parent + G_parent (before + t) + G after, as the docstring has them
        above = rotations[parent] if parent >= 0 else np.tile(np.eye(3), (5, 1, 1))
        local, shift = np.tile(np.eye(3), (5, 1, 1)), np.tile(skeleton.before[joint], (5, 1))
        for index in (i for i, c in enumerate(skeleton.channels) if c.joint == joint and not c.is_rotation):
            shift[:, skeleton.channels[index].axis] += poses[:, index]
        for index in (i for i in skeleton.product if skeleton.channels[i].joint == joint):
            local = local @ turn(skeleton.channels[index].axis, poses[:, index])
        frame = skeleton.frames[joint]
        rotations.append(above @ frame @ local @ frame.T)
        spot = positions[parent] if parent >= 0 else np.zeros((5, 3))
        positions.append(spot + (above @ shift[:, :, None])[:, :, 0] + rotations[joint] @ skeleton.after[joint])
    np.testing.assert_allclose(motion.positions, np.stack(positions, axis=1), atol=1e-11)
    np.testing.assert_allclose(motion.rotations, np.stack(rotations, axis=1), atol=1e-14)


def test_bones_are_what_every_pose_keeps(skeleton, rng):
    positions, _ = forward(skeleton, rng.uniform(-90, 90, (20, 7)))
    bones = skeleton.bones()
    assert [(b.start, b.end, b.length) for b in bones] == [
        ("root", "upper", 300), ("upper", "rigid", 10), ("rigid", "fore", 250)
    ]  # fmt: skip
    for bone in bones:
        start, end = (skeleton.names.index(name) for name in (bone.start, bone.end))
        np.testing.assert_allclose(np.linalg.norm(positions[:, end] - positions[:, start], axis=1), bone.length)


def test_position_channels_that_never_change_are_bones(skeleton, rng):
    """Every joint gets three position channels; some keep their values, some change in a single frame."""
    joints = range(len(skeleton.names))
    shifts = tuple(Channel(joint=joint, axis=axis, is_rotation=False) for joint in joints for axis in (2, 0, 1))
    turns = [index for index, channel in enumerate(skeleton.channels) if channel.is_rotation]
    turning = tuple(skeleton.channels[index] for index in turns)
    places = {index: len(shifts) + place for place, index in enumerate(turns)}
    six = replace(skeleton, channels=(*shifts, *turning), product=tuple(places[i] for i in skeleton.product))
    poses = rng.uniform(-90, 90, (20, len(six.channels)))
    offsets = rng.uniform(-200, 200, len(shifts))
    poses[:, : len(shifts)] = offsets + rng.choice([-0.005, 0.005], (20, len(shifts)))  # the rounding of a file
    root = skeleton.parents.index(-1)
    poses[:, [index for index, channel in enumerate(shifts) if channel.joint == root]] = rng.normal(size=(20, 3))
    poses[rng.random(poses.shape) < 0.2] = np.nan
    assert six.bones() == ()
    still = settled(six, poses)
    assert {channel.joint for channel in still.channels if not channel.is_rotation} == {root}
    known = np.where(np.isnan(poses), 1.0, poses)
    known[:, : len(shifts)] = offsets
    kept = [index for index, channel in enumerate(six.channels) if channel.is_rotation or channel.joint == root]
    np.testing.assert_allclose(forward(still, known[:, kept])[0], forward(six, known)[0], atol=0.2)
    bones = six.bones(known)
    ends = {bone.end for bone in bones}
    # With both offsets the length depends on the rotation between them.
    single = [joint for joint in joints if skeleton.parents[joint] >= 0 and not skeleton.after[joint].any()]
    assert ends == {skeleton.names[joint] for joint in single}
    if not single:
        return
    # A channel that changes in one frame by more than rounding leaves its joint without a bone.
    moved = single[-1]
    known[7, next(index for index, channel in enumerate(shifts) if channel.joint == moved)] += 5.0
    assert {bone.end for bone in six.bones(known)} == ends - {skeleton.names[moved]}
