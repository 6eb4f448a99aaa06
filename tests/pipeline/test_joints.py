"""Repairs of takes with poses: known channels stay, what is answered is near, what cannot be reached is left."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.geometry.joint_motion import angles_between, joint_motion
from mocapclean.pipeline import contacts, joints
from mocapclean.pipeline.fill import fill
from mocapclean.simulate import perform
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution, Take
from mocapclean.take.posed import posed_take

RATE = 60.0
METHODS = ["kriging", "pma", "kalman", "trnn2"]


@pytest.fixture(scope="module")
def truth() -> Take:
    performance = perform("walk", 4.0, RATE, 3)
    return posed_take(performance.bvh, performance.bvh_poses, RATE)


def without(take: Take, spans: dict[str, slice], one_channel: bool = False) -> Take:
    """The take whose joints lack their channels, or the last of them, in these frames."""
    known = take.known.copy()
    for name, frames in spans.items():
        channels = np.flatnonzero(take.owners == take.markers.index(name))
        known[frames, channels[-1] if one_channel else channels[0] : channels[-1] + 1] = False
    poses = np.where(known, take.poses, np.nan)
    return posed_take(take.skeleton, poses, take.rate)


SPANS = {"LeftArm": slice(60, 80), "RightLeg": slice(100, 110), "Head": slice(150, 170)}


@pytest.mark.parametrize("method", METHODS)
def test_known_channels_stay_and_unknown_ones_come_back(truth, method):
    damaged = without(truth, SPANS)
    filled = fill(damaged, method, fill_poor=True).take
    np.testing.assert_array_equal(filled.poses[damaged.known], truth.poses[damaged.known])
    done = filled.filled
    assert (done <= ~damaged.trusted).all()
    assert done.sum() >= 0.5 * (~damaged.trusted).sum()
    everything = np.isfinite(filled.poses)
    rotations = [joint_motion(truth.skeleton, take.poses, everything).rotations for take in (truth, filled)]
    # A twist that no position shows is bridged by a straight turn, so that the limit is wide for these methods.
    assert np.median(angles_between(*rotations)[done]) < (3.0 if method == "kriging" else 8.0)


def test_one_missing_angle_leaves_the_others(truth):
    damaged = without(truth, SPANS, one_channel=True)
    filled = fill(damaged).take
    assert np.isfinite(filled.poses).all()
    np.testing.assert_array_equal(filled.poses[damaged.known], truth.poses[damaged.known])
    assert np.abs(filled.poses - truth.poses).max() < 5.0


def test_a_root_out_of_place_moves_the_body_and_nothing_else(truth):
    damaged = without(truth, {"Hips": slice(90, 100)})
    filled = fill(damaged).take
    apart = np.linalg.norm(filled.positions - truth.positions, axis=2)
    assert apart[90:100].max() < 60.0
    assert apart[:90].max() == apart[100:].max() == 0.0


def test_positions_that_no_pose_reaches_are_left(truth, monkeypatch):
    damaged = without(truth, {"LeftArm": slice(60, 70)})

    def far_off(name, take, params, **options):
        positions = np.where(take.trusted[..., None], take.positions, take.positions + 900.0)
        return Solution(positions=positions, filled=~take.trusted, sd=np.ones(take.trusted.shape))

    monkeypatch.setattr(joints, "run_method", far_off)
    solution = joints.fill_poses("pma", damaged, SOLVERS["pma"].Params(), ~damaged.trusted)
    arm = truth.markers.index("LeftArm")
    assert not solution.filled.any()
    assert solution.unreachable[60:70, arm].all()
    assert solution.misfit[60:70, arm].min() > joints.FARTHEST_MISFIT


def test_a_step_at_the_end_of_a_fitted_span_is_no_larger_than_the_joint_makes(truth, monkeypatch):
    damaged = without(truth, {"LeftArm": slice(60, 80)})

    def beside(name, take, params, **options):
        positions = np.where(take.trusted[..., None], take.positions, np.add(truth.positions, [0.0, 25.0, 0.0]))
        return Solution(positions=positions, filled=~take.trusted)

    monkeypatch.setattr(joints, "run_method", beside)
    solution = joints.fill_poses("linear", damaged, SOLVERS["linear"].Params(), ~damaged.trusted)
    arm = truth.markers.index("LeftArm")
    assert solution.filled[60:80, arm].all()
    rotations = joint_motion(truth.skeleton, solution.poses, np.isfinite(solution.poses)).rotations[:, arm]
    steps = angles_between(rotations[1:], rotations[:-1])
    elsewhere = np.delete(steps, slice(58, 81)).max()
    assert steps[58:81].max() <= 1.5 * elsewhere + 1.0 + 1e-6


def test_hidden_joints_are_right_where_the_truth_fills_them(truth):
    damaged = without(truth, {"LeftArm": slice(60, 70)})

    def by_truth(take: Take, wanted: np.ndarray) -> Solution:
        return Solution(positions=take.positions, filled=wanted, poses=truth.poses)

    hidden = joints.HiddenJoints(damaged, by_truth)
    mask = np.zeros_like(truth.trusted)
    mask[120:130, truth.markers.index("RightArm")] = True
    errors = hidden.solve(replace(hidden.take, trusted=hidden.take.trusted & ~mask), mask).positions
    assert np.abs(errors).max() < 1e-9


def test_the_error_of_a_far_end_is_that_of_the_bone(truth):
    """An arm that is 2 degrees off moves its elbow by the length of the bone times 2 degrees."""
    arm = truth.markers.index("LeftArm")
    channels = np.flatnonzero(truth.owners == arm)
    mask = np.zeros_like(truth.trusted)
    mask[120, arm] = True

    def off(take: Take, wanted: np.ndarray) -> Solution:
        poses = truth.poses.copy()
        poses[120, channels[-1]] += 2.0
        return Solution(positions=take.positions, filled=wanted, poses=poses)

    hidden = joints.HiddenJoints(truth, off)
    errors = hidden.solve(replace(hidden.take, trusted=~mask), mask).positions
    expected = np.radians(2.0) * joints.levers(truth.skeleton)[arm]
    assert np.linalg.norm(errors[120, arm]) == pytest.approx(expected, rel=1e-6)


def test_a_broken_contact_is_counted_and_kept(truth):
    """The body stands still but for its arms; a thigh is filled 4 degrees off for 10 frames."""
    poses = np.repeat(truth.poses[:1], 120, axis=0)
    standing = posed_take(truth.skeleton, poses, RATE)
    leg, foot = standing.markers.index("LeftUpLeg"), standing.markers.index("LeftFoot")
    damaged = without(standing, {"LeftUpLeg": slice(50, 60)})
    wrong = poses.copy()
    wrong[50:60, np.flatnonzero(standing.owners == leg)[0]] += 4.0
    solution = Solution(positions=damaged.positions, filled=~damaged.trusted, poses=wrong)
    after = joints.merge_poses(damaged, solution, ~damaged.trusted)
    around = contacts.contacts(damaged, after.filled)
    assert foot in {contact.joint for contact in contacts.broken(after, around)}
    kept = contacts.kept(damaged, after, around)
    assert not contacts.broken(kept, around)
    np.testing.assert_array_equal(kept.poses[damaged.known], poses[damaged.known])
    assert np.linalg.norm(kept.positions[50:60, foot] - standing.positions[50:60, foot], axis=1).max() < 1.5


def test_a_walking_foot_is_no_contact(truth):
    swinging = int(
        np.argmax(np.linalg.norm(np.diff(truth.positions[:200, truth.markers.index("LeftFoot")], axis=0), axis=1))
    )
    start = max(20, swinging - 5)
    damaged = without(truth, {"LeftUpLeg": slice(start, start + 10)})
    found = contacts.contacts(damaged, ~damaged.trusted)
    assert truth.markers.index("LeftFoot") not in {contact.joint for contact in found}
