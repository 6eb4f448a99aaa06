"""Pops in the first and last frames of a take."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.detection.joints import faults
from mocapclean.geometry.joint_motion import JointMotion, continuous, from_vectors, times
from mocapclean.geometry.skeleton import Channel, Skeleton

N_JOINTS, N_FRAMES = 8, 150
PLACES = ((0, 1), (1, 2), (0, 2), (N_FRAMES - 1, N_FRAMES), (N_FRAMES - 2, N_FRAMES - 1), (N_FRAMES - 2, N_FRAMES))


@pytest.fixture
def skeleton():
    """A chain of joints 300 mm apart; the root has position channels."""
    before = np.zeros((N_JOINTS, 3))
    before[1:, 1] = 300.0
    shifts = [Channel(joint=0, axis=axis, is_rotation=False) for axis in range(3)]
    turns = [Channel(joint=joint, axis=axis, is_rotation=True) for joint in range(N_JOINTS) for axis in range(3)]
    return Skeleton(
        names=tuple(f"joint{joint}" for joint in range(N_JOINTS)),
        parents=tuple(range(-1, N_JOINTS - 1)),
        before=before,
        after=np.zeros((N_JOINTS, 3)),
        frames=np.broadcast_to(np.eye(3), (N_JOINTS, 3, 3)).copy(),
        channels=(*shifts, *turns),
        product=tuple(range(3, 3 + 3 * N_JOINTS)),
    )


@pytest.fixture
def motion(rng):
    """Swings of up to 40 degrees at 0.3 to 1 Hz and a root that walks at 1 m/s, at 60 Hz."""
    time = np.arange(N_FRAMES)[:, None, None] / 60.0
    frequency, phase = rng.uniform(0.3, 1.0, (N_JOINTS, 3)), rng.uniform(0, 6, (N_JOINTS, 3))
    vectors = rng.uniform(10, 40, (N_JOINTS, 3)) * np.sin(2 * np.pi * frequency * time + phase)
    translations = np.zeros((N_FRAMES, N_JOINTS, 3))
    translations[:, 0, 1:] = np.column_stack([np.full(N_FRAMES, 900.0), 300.0 + 1000.0 * time[:, 0, 0]])
    known = np.ones((N_FRAMES, N_JOINTS), dtype=bool)
    return JointMotion(
        rotations=continuous(from_vectors(vectors)),
        translations=translations,
        turns=known[0],
        shifts=np.arange(N_JOINTS) == 0,
        rotation_known=known,
        translation_known=known,
    )


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
