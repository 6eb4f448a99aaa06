"""Pops in the first and last frames of a take."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.detection.joints import faults
from mocapclean.geometry.joint_motion import continuous, from_vectors, times
from tests import joint_chain

N_JOINTS, N_FRAMES = 8, 150
PLACES = ((0, 1), (1, 2), (0, 2), (N_FRAMES - 1, N_FRAMES), (N_FRAMES - 2, N_FRAMES - 1), (N_FRAMES - 2, N_FRAMES))


@pytest.fixture
def skeleton():
    return joint_chain.skeleton(N_JOINTS)


@pytest.fixture
def motion(rng):
    """Swings and a root that walks, at 60 Hz."""
    return joint_chain.smooth(rng, 60.0, N_JOINTS, N_FRAMES)


def turned(motion, joints, start, stop, rng, degrees):
    """The motion with some joints turned by the same angle in frames start to stop."""
    rotations = motion.rotations.copy()
    for joint in joints:
        vector = rng.normal(size=3)
        turn = from_vectors(degrees * vector / np.linalg.norm(vector))[None]
        rotations[start:stop, joint] = times(rotations[start:stop, joint], turn)
    return replace(motion, rotations=continuous(rotations))


def spans(found):
    return [(fault.joint, fault.start, fault.stop, fault.part) for fault in found if fault.is_sure]


@pytest.mark.parametrize(("start", "stop"), PLACES)
def test_a_pop_at_an_end_belongs_to_the_joint_that_jumps(skeleton, motion, rng, start, stop):
    for joint in range(N_JOINTS):
        damaged = turned(motion, [joint], start, stop, rng, 30.0)
        assert spans(faults(skeleton, damaged, 60.0)) == [(joint, start, stop, "rotation")]


@pytest.mark.parametrize(("start", "stop"), PLACES)
def test_another_pose_of_the_whole_body_at_an_end_is_no_pop(skeleton, motion, rng, start, stop):
    damaged = turned(motion, range(N_JOINTS), start, stop, rng, 30.0)
    assert spans(faults(skeleton, damaged, 60.0)) == []


@pytest.mark.parametrize("n", [1, 2, 5, 12])
@pytest.mark.parametrize("at_start", [True, False])
def test_a_root_at_zero_at_an_end_is_a_pop_of_its_translation(skeleton, motion, n, at_start):
    start, stop = (0, n) if at_start else (N_FRAMES - n, N_FRAMES)
    translations = motion.translations.copy()
    translations[start:stop, 0] = 0.0
    found = faults(skeleton, replace(motion, translations=translations), 60.0)
    assert spans(found) == [(0, start, stop, "translation")]


def test_a_take_that_begins_at_the_origin_has_no_pop(skeleton, motion):
    translations = motion.translations - motion.translations[:1]
    assert spans(faults(skeleton, replace(motion, translations=translations), 60.0)) == []
