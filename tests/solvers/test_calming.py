"""Steps of filled paths of rotations."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from mocapclean.geometry.joint_motion import (
    angles_between,
    conjugate,
    continuous,
    from_vectors,
    rotation_vectors,
    straight_turns,
    times,
)
from mocapclean.solvers.joints.calming import calmed

START, STOP, N_FRAMES = 40, 60, 100


@pytest.fixture
def take():
    """A joint that turns by 2 degrees in each frame; frames 40 to 60 are not known."""
    rotations = continuous(from_vectors(np.arange(N_FRAMES)[:, None] * np.array([0.0, 2.0, 0.0])))
    known = np.ones(N_FRAMES, dtype=bool)
    known[START:STOP] = False
    return rotations, known, straight_turns(rotations, ~known)[START:STOP]


def steps(rotations, path):
    whole = rotations.copy()
    whole[START:STOP] = path
    return angles_between(whole[START - 1 : STOP], whole[START : STOP + 1])


def test_a_path_no_faster_than_the_joint_beside_it_stays(take):
    rotations, known, plain = take
    bend = np.sin(np.linspace(0.0, np.pi, STOP - START + 2))[1:-1, None] * np.array([0.0, 0.0, 1.0])
    rotations[START - 5] = times(rotations[START - 5], from_vectors(np.array([0.0, 1.0, 0.0])))
    path = times(plain, from_vectors(bend))
    assert_array_equal(calmed(rotations, known, START, path, np.full(STOP - START, 9.0), plain), path)


def test_large_steps_fade_as_far_as_the_error_bars_allow(take, rng):
    rotations, known, plain = take
    path = times(plain, from_vectors(rng.normal(scale=3.0, size=(STOP - START, 3))))
    before = steps(rotations, path).max()
    for sd in (0.0, 0.5, 2.0, 20.0):
        bars = np.full(STOP - START, sd)
        calm = calmed(rotations, known, START, path, bars, plain)
        moved = np.linalg.norm(rotation_vectors(times(conjugate(path), calm)), axis=1)
        assert (moved <= np.sqrt(3.0) * sd + 0.2).all()
        after = steps(rotations, calm).max()
        assert after <= before + 1e-9
        before = after
    assert before < 2.2


def test_a_gap_without_a_known_side_stays(take, rng):
    rotations, known, plain = take
    path = times(plain, from_vectors(rng.normal(scale=3.0, size=(STOP - START, 3))))
    known[STOP] = False
    assert_array_equal(calmed(rotations, known, START, path, np.full(STOP - START, 9.0), plain), path)
