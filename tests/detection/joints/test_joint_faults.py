"""Faults of joints in their own channels, on smooth generated motions of a chain of joints."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from mocapclean.detection.joints import faults
from mocapclean.geometry.joint_motion import (
    conjugate,
    continuous,
    from_vectors,
    joint_motion,
    quaternions,
    times,
)
from tests import joint_chain

N_JOINTS, N_FRAMES = 6, 200
RATES = (30.0, 60.0, 120.0)


skeleton = partial(joint_chain.skeleton, N_JOINTS)


def smooth(rng, rate, n_frames=N_FRAMES):
    return joint_chain.smooth(rng, rate, N_JOINTS, n_frames)


def turned(motion, joint, frames, vector):
    """The motion with one joint turned by a rotation vector (3,) or (f, 3), degrees, in some frames."""
    rotations = motion.rotations.copy()
    vectors = np.broadcast_to(vector, (len(rotations[frames]), 3)).astype(float)
    rotations[frames, joint] = times(rotations[frames, joint], from_vectors(vectors))
    return replace(motion, rotations=continuous(rotations))


def spans(found):
    return [(fault.kind, fault.joint, fault.start, fault.stop, fault.part) for fault in found if fault.is_sure]


@pytest.mark.parametrize("rate", RATES)
def test_a_smooth_motion_has_no_fault(rng, rate):
    for _ in range(5):
        assert faults(skeleton(), smooth(rng, rate), rate) == ()


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("degrees", [20.0, 45.0, 170.0])
def test_a_pop_belongs_to_the_joint_that_jumps(rng, rate, degrees):
    for joint in range(N_JOINTS):
        motion = turned(smooth(rng, rate), joint, slice(100, 101), [0.0, 0.6 * degrees, 0.8 * degrees])
        assert spans(faults(skeleton(), motion, rate)) == [("pop", joint, 100, 101, "rotation")]


def test_an_excursion_of_several_frames_is_one_pop(rng):
    motion = turned(smooth(rng, 120.0), 2, slice(80, 86), [40.0, 0.0, 0.0])
    assert spans(faults(skeleton(), motion, 120.0)) == [("pop", 2, 80, 86, "rotation")]


def test_a_burst_of_noise_is_found_whole(rng):
    signs = np.array([1.0, -1.0, 1.0, -1.0])[:, None]
    motion = turned(smooth(rng, 120.0), 3, slice(80, 84), signs * [0.0, 25.0, 10.0])
    found = [fault for fault in faults(skeleton(), motion, 120.0) if fault.is_sure]
    assert {frame for fault in found for frame in range(fault.start, fault.stop)} == {80, 81, 82, 83}
    assert {fault.joint for fault in found} == {3}


@pytest.mark.parametrize("n", [1, 3, 10])
@pytest.mark.parametrize("rate", RATES)
def test_a_root_that_is_elsewhere_is_a_pop_of_its_translation(rng, rate, n):
    motion = smooth(rng, rate)
    translations = motion.translations.copy()
    translations[100 : 100 + n, 0] = 0.0
    found = faults(skeleton(), replace(motion, translations=translations), rate)
    assert spans(found) == [("pop", 0, 100, 100 + n, "translation")]


def test_a_somersault_at_30_hz_is_no_fault(rng):
    motion = smooth(rng, 30.0)
    share = np.clip((np.arange(N_FRAMES) - 60) / 15.0, 0, 1)
    turn = np.zeros((N_FRAMES, 3))
    turn[:, 0] = -360.0 * share**2 * (3 - 2 * share)
    rotations = motion.rotations.copy()
    rotations[:, 0] = times(rotations[:, 0], from_vectors(turn))
    assert faults(skeleton(), replace(motion, rotations=continuous(rotations)), 30.0) == ()


def test_turns_of_an_angle_and_other_signs_of_a_quaternion_are_no_events():
    angles = np.linspace(0.0, 1000.0, N_FRAMES)
    poses = np.zeros((N_FRAMES, 3 + 3 * N_JOINTS))
    poses[:, 4] = (angles + 180.0) % 360.0 - 180.0
    poses[::2, 7] = 360.0
    motion = joint_motion(skeleton(), poses, np.ones(poses.shape, dtype=bool))
    assert faults(skeleton(), motion, 60.0) == ()


def held(motion, joints, first, stop):
    rotations = motion.rotations.copy()
    rotations[first + 1 : stop, joints] = rotations[first, joints]
    return replace(motion, rotations=continuous(rotations))


def swinging(rng):
    """A smooth motion in which joints 2 and 3 turn fast enough that half a second of hold shows."""
    motion = smooth(rng, 120.0)
    rotations = motion.rotations.copy()
    turn = np.zeros((N_FRAMES, 3))
    turn[:, 1] = 120.0 * np.arange(N_FRAMES) / 120.0
    for joint in (2, 3):
        rotations[:, joint] = from_vectors(turn)
    return replace(motion, rotations=continuous(rotations))


def test_only_the_held_frames_of_a_hold_are_distrusted(rng):
    motion = held(swinging(rng), [2, 3], 100, 130)
    expected = [("hold", joint, 101, 130, "rotation") for joint in (2, 3)]
    assert spans(faults(skeleton(), motion, 120.0)) == expected


def test_rest_until_the_end_and_rest_with_a_gentle_start_are_no_faults(rng):
    assert not faults(skeleton(), held(swinging(rng), [2], 150, N_FRAMES), 120.0)
    still = smooth(rng, 120.0)
    rotations = still.rotations.copy()
    time = np.clip(np.abs(np.arange(N_FRAMES) - 100.0) - 20.0, 0.0, None)
    turn = np.zeros((N_FRAMES, 3))
    turn[:, 0] = 0.02 * time**2
    rotations[:, 4] = from_vectors(turn)
    assert not faults(skeleton(), replace(still, rotations=continuous(rotations)), 120.0)


def test_a_body_that_is_posed_as_a_whole_is_never_sure(rng):
    motion = smooth(rng, 120.0)
    rotations = motion.rotations.copy()
    rotations[:30] = [1.0, 0.0, 0.0, 0.0]
    found = faults(skeleton(), replace(motion, rotations=continuous(rotations)), 120.0)
    assert [fault.is_sure for fault in found] == [False]
    assert (found[0].kind, found[0].start, found[0].stop) == ("splice", 29, 31)


def test_a_splice_is_a_suspicion_at_the_jump(rng):
    motion = turned(smooth(rng, 120.0), 1, slice(100, None), [60.0, 0.0, 0.0])
    (found,) = faults(skeleton(), motion, 120.0)
    assert (found.kind, found.joint, found.start, found.stop, found.is_sure) == ("splice", 1, 99, 101, False)


def test_a_pop_beside_a_gap_is_not_sure(rng):
    motion = turned(smooth(rng, 120.0), 2, slice(100, 101), [40.0, 0.0, 0.0])
    known = motion.rotation_known.copy()
    known[102, 2] = False
    found = faults(skeleton(), replace(motion, rotation_known=known), 120.0)
    assert found
    assert not any(fault.is_sure for fault in found)


def test_a_lasting_flip_and_what_moves_with_it_are_suspicions(rng):
    motion = turned(smooth(rng, 120.0), 2, slice(80, 90), [175.0, 0.0, 0.0])
    motion = turned(motion, 3, slice(80, 90), [40.0, 0.0, 0.0])
    found = faults(skeleton(), motion, 120.0)
    assert {fault.joint for fault in found} == {2, 3}
    assert not any(fault.is_sure for fault in found)


def damaged(rng, rate=60.0):
    """A motion with pops of a rotation and of the root's translation."""
    motion = turned(smooth(rng, rate), 2, slice(70, 71), [30.0, 0.0, 0.0])
    motion = turned(motion, 4, slice(120, 122), [0.0, 50.0, 0.0])
    translations = motion.translations.copy()
    translations[150, 0] += 500.0
    return replace(motion, translations=translations)


def test_a_turned_world_and_turned_axes_change_nothing(rng):
    motion = damaged(rng)
    expected = spans(faults(skeleton(), motion, 60.0))
    assert len(expected) == 3
    world, axes = from_vectors(np.array([20.0, 130.0, -60.0])), from_vectors(np.array([-80.0, 10.0, 140.0]))
    rotations = times(times(world, motion.rotations), axes)
    assert spans(faults(skeleton(), replace(motion, rotations=continuous(rotations)), 60.0)) == expected
    assert spans(faults(skeleton(), replace(motion, rotations=conjugate(motion.rotations)), 60.0)) == expected


def test_another_order_of_angles_changes_nothing(rng):
    motion = damaged(rng)
    expected = spans(faults(skeleton(), motion, 60.0))
    for order in ([0, 1, 2], [2, 0, 1], [1, 0, 2]):
        rotations = motion.rotations.copy()
        angles = 30.0 * np.sin(np.arange(N_FRAMES)[:, None] / 25.0 + np.arange(3))
        rotations[:, 5] = quaternions(order, angles)
        assert spans(faults(skeleton(), replace(motion, rotations=continuous(rotations)), 60.0)) == expected


def test_reversed_time_gives_mirrored_spans(rng):
    motion = damaged(rng)
    back = replace(motion, rotations=continuous(motion.rotations[::-1]), translations=motion.translations[::-1])
    mirrored = {(k, j, N_FRAMES - b, N_FRAMES - a, p) for k, j, a, b, p in spans(faults(skeleton(), back, 60.0))}
    assert mirrored == set(spans(faults(skeleton(), motion, 60.0)))


@pytest.mark.parametrize("size", [0.01, 25.4])
def test_a_body_of_another_size_has_the_same_faults(rng, size):
    motion = damaged(rng)
    expected = spans(faults(skeleton(), motion, 60.0))
    scaled = replace(motion, translations=motion.translations * size)
    assert spans(faults(skeleton(size), scaled, 60.0)) == expected


def test_takes_too_short_to_judge_have_no_faults(rng):
    for n_frames in (1, 2, 3, 5, 8):
        assert faults(skeleton(), smooth(rng, 60.0, n_frames), 60.0) == ()
