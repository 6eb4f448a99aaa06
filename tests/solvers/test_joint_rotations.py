"""The fill of rotations: exact where only a steady turn is possible, and the same in every frame of reference."""

import numpy as np
import pytest

from mocapclean.geometry import joint_motion as jm
from mocapclean.geometry.joint_motion import JointMotion
from mocapclean.solvers.joints import JointAnswer, _Factors, fill_joints

RATE = 60.0
GAPS = ((0, 50, 55), (1, 100, 120), (2, 200, 201))
NAMES = ("a", "b", "c", "d")


def swinging(rng: np.random.Generator, n_frames: int = 300, n_joints: int = 4) -> np.ndarray:
    """Rotations (F, J, 4) of joints that swing together, each about an axis of its own."""
    time = np.arange(n_frames)[:, None] / RATE
    axes = rng.normal(size=(n_joints, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angle = 40.0 * np.sin(2 * np.pi * 0.9 * time + np.arange(n_joints)) + 5.0 * np.sin(2 * np.pi * 2.1 * time)
    return jm.from_vectors(angle[..., None] * axes)


def motion_of(rotations: np.ndarray, gaps=GAPS) -> JointMotion:
    known = np.ones(rotations.shape[:2], dtype=bool)
    for joint, start, stop in gaps:
        known[start:stop, joint] = False
    hidden = rotations.copy()
    for joint in range(rotations.shape[1]):
        hidden[:, joint] = jm.straight_turns(rotations[:, joint], ~known[:, joint])
    everything = np.ones(rotations.shape[1], dtype=bool)
    return JointMotion(
        rotations=hidden,
        translations=np.zeros((*rotations.shape[:2], 3)),
        turns=everything,
        shifts=~everything,
        rotation_known=known,
        translation_known=np.ones_like(known),
    )


def filled(motion: JointMotion) -> JointAnswer:
    return fill_joints(motion, NAMES, ~motion.rotation_known, ~motion.translation_known, RATE)


@pytest.fixture
def swing(rng):
    return swinging(rng)


def test_known_rotations_stay_and_gaps_come_back(swing):
    motion = motion_of(swing)
    answer = filled(motion)
    assert answer.filled.all()
    known = motion.rotation_known
    np.testing.assert_array_equal(answer.rotations[known], motion.rotations[known])
    assert (answer.rotation_sd[known] == 0.0).all()
    assert jm.angles_between(answer.rotations, swing)[~known].max() < 1.0
    straight = jm.angles_between(motion.rotations, swing)[~known]
    assert jm.angles_between(answer.rotations, swing)[~known].mean() < 0.3 * straight.mean()


def test_a_steady_turn_is_filled_exactly(rng):
    angle = np.arange(300)[:, None, None] * np.array([0.3, -0.2, 0.1, 0.25])[None, :, None]
    rotations = jm.from_vectors(angle * np.array([0.0, 0.6, 0.8]))
    answer = filled(motion_of(rotations))
    assert jm.angles_between(answer.rotations, rotations).max() < 0.05


def test_a_joint_that_turns_all_the_way_round_is_filled(rng):
    rotations = swinging(rng)
    whole = np.arange(300)[:, None] * np.array([0.0, 2.5, 0.0])
    rotations[:, 3] = jm.from_vectors(whole)
    rotations = jm.continuous(rotations)
    answer = filled(motion_of(rotations, ((3, 60, 70), (3, 150, 165), (1, 100, 110))))
    assert answer.filled.all()
    assert jm.angles_between(answer.rotations, rotations).max() < 3.0


def test_turning_the_axes_of_a_joint_turns_its_fill(swing, rng):
    turn = jm.from_vectors(np.array([30.0, -50.0, 70.0]))
    plain = filled(motion_of(swing))
    turned = filled(motion_of(jm.times(turn, swing)))
    # The method for markers learns from distances in its own axes, which bars of a hundredth of a degree show.
    assert jm.angles_between(turned.rotations, jm.times(turn, plain.rotations)).max() < 0.1


def test_longer_gaps_have_wider_bars(swing, rng):
    wandering = np.cumsum(np.cumsum(rng.normal(size=(300, 4, 3)), axis=0) * 0.02, axis=0)
    rotations = jm.times(swing, jm.from_vectors(30.0 * np.tanh(wandering / 30.0)))
    widths = []
    for length in (3, 12, 40):
        answer = filled(motion_of(rotations, ((1, 120, 120 + length),)))
        widths.append(answer.rotation_sd[120 : 120 + length, 1].max())
    assert widths[0] < widths[1] < widths[2]


def test_gaps_at_the_ends_and_a_joint_that_is_never_known(swing):
    answer = filled(motion_of(swing, ((0, 0, 6), (1, 294, 300), (2, 0, 300))))
    assert answer.filled[:, [0, 1, 3]].all()
    assert not answer.filled[:, 2].any()
    assert np.isfinite(answer.rotations).all()


@pytest.mark.parametrize("gap", [(0, 100, 160), (0, 280, 300), (0, 0, 20)])
def test_a_steady_spin_goes_on_over_more_than_half_a_turn(swing, gap):
    rotations = swing.copy()
    rotations[:, 0] = jm.from_vectors(np.arange(300)[:, None] * np.array([0.0, 6.0, 0.0]))
    rotations = jm.continuous(rotations)
    answer = filled(motion_of(rotations, (gap,)))
    assert answer.filled.all()
    assert jm.angles_between(answer.rotations, rotations).max() < 0.05


@pytest.mark.parametrize("at_end", [False, True])
def test_bars_at_the_ends_of_a_take_hold(at_end):
    inside, least = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        # Each joint wanders by itself, so that no other joint shows what it does at the end.
        speed = np.cumsum(rng.normal(size=(300, 4, 3)), axis=0) * 0.05
        rotations = jm.continuous(jm.from_vectors(20.0 * np.tanh(np.cumsum(speed, axis=0) / 20.0)))
        span = slice(285, 300) if at_end else slice(0, 15)
        answer = filled(motion_of(rotations, ((1, span.start, span.stop),)))
        errors = jm.rotation_vectors(jm.times(jm.conjugate(rotations[span, 1]), answer.rotations[span, 1]))
        bars = answer.rotation_sd[span, 1]
        inside.append((np.abs(errors) <= 1.645 * bars[:, None]).mean())
        near, far = (bars[0], bars[-1]) if at_end else (bars[-1], bars[0])
        least.append(far / near)
    assert np.mean(inside) > 0.8
    assert min(least) > 1.5


def test_fewer_windows_widen_the_bars_and_leave_the_factor(rng):
    widenings, factors = [], []
    for n_windows in (0, 1, 4, 60):
        some = _Factors()
        for _ in range(n_windows):
            some.add(rng.normal(size=(400, 3)), np.ones(400))
        widenings.append(some.widening(400))
        factors.append(some.of(400))
        assert some.widening(4000) == widenings[0]
    assert widenings[0] == widenings[1] > widenings[2] > widenings[3] > 1.0
    np.testing.assert_allclose(factors, 1.0, atol=0.1)
