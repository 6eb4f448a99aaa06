"""What the other joints do in the same frame: regression on them, and pops judged by what it leaves."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from mocapclean.detection.joints import pops
from mocapclean.detection.joints.others import fitted_pop, unexplained
from mocapclean.detection.joints.pops import find_excursions
from mocapclean.detection.joints.signals import DEGREES, Signals
from mocapclean.geometry.joint_motion import continuous, from_vectors, times

N_FRAMES, N_JOINTS, POPPED, AT = 400, 8, 3, 200


def shaken(rng, amplitude, latent=None):
    """Vectors (F, J, 3), degrees: joints that swing, and shake by fixed shares of the same three noises."""
    time = np.arange(N_FRAMES)[:, None, None] / 60.0
    swing = rng.uniform(5, 20, (N_JOINTS, 3)) * np.sin(
        2 * np.pi * rng.uniform(0.3, 0.8, (N_JOINTS, 3)) * time + rng.uniform(0, 6, (N_JOINTS, 3))
    )
    noise = rng.normal(size=(N_FRAMES, 3)) if latent is None else latent
    shares = np.linalg.qr(rng.normal(size=(N_JOINTS, 3, 3)))[0]
    return swing, amplitude * np.einsum("fk,jkc->fjc", noise, shares)


def signals(swing, shake):
    """The signals of joints that swing and then shake in their own axes."""
    paths = continuous(times(from_vectors(swing), from_vectors(shake))) * DEGREES
    return Signals(
        paths=paths,
        known=np.ones(paths.shape[:2], dtype=bool),
        joints=np.arange(N_JOINTS),
        part="rotation",
        unit=np.ones(N_JOINTS),
    )


def sure(found):
    return {(one.signal, one.start, one.stop) for one in found if one.score >= 1.0}


def test_the_regression_is_that_on_all_other_joints(rng):
    """Oracle: least squares with the ridge as further rows, joint by joint."""
    from mocapclean.detection.joints import others

    values = rng.normal(size=(50, 12)) @ rng.normal(size=(12, 12))
    ridge = others._RIDGE * np.trace(values.T @ values) / 12
    found = values @ others._shares(values, 4)
    for joint in range(4):
        own = np.arange(12) // 3 == joint
        rows = np.vstack([values[:, ~own], np.sqrt(ridge) * np.eye(9)])
        wanted = np.vstack([values[:, own], np.zeros((9, 3))])
        expected = values[:, own] - values[:, ~own] @ np.linalg.lstsq(rows, wanted, rcond=None)[0]
        assert_allclose(found[:, own], expected, atol=1e-8)


def test_a_shared_noise_is_explained_and_a_noise_of_its_own_is_not(rng):
    shared = signals(*shaken(rng, 2.0))
    sharp = np.linalg.norm(np.diff(shared.paths, n=4, axis=0), axis=2)
    assert np.median(np.linalg.norm(unexplained(shared.paths), axis=2)) < 0.4 * np.median(sharp)
    swing, _ = shaken(rng, 0.0)
    own = signals(swing, rng.normal(0.0, 2.0, swing.shape))
    sharp = np.linalg.norm(np.diff(own.paths, n=4, axis=0), axis=2)
    assert np.median(np.linalg.norm(unexplained(own.paths), axis=2)) > 0.8 * np.median(sharp)


def test_the_size_of_a_pop_is_that_of_the_pop(rng):
    swing, shake = shaken(rng, 0.5)
    shake[AT, POPPED] += [0.0, 6.0, 8.0]
    pop, largest, median = fitted_pop(unexplained(signals(swing, shake).paths), POPPED, AT)
    assert pop == pytest.approx(10.0, rel=0.15)
    assert median <= largest < 2.0


def test_a_pop_in_a_body_that_shakes_is_found_by_the_other_joints(rng, monkeypatch):
    swing, shake = shaken(rng, 2.0)
    shake[AT, POPPED] += [0.0, 0.0, 20.0]
    taken = signals(swing, shake)
    assert (POPPED, AT, AT + 1) in sure(find_excursions(taken, 60.0))
    monkeypatch.setattr(pops, "_LEAST_ALONE", np.inf)
    assert (POPPED, AT, AT + 1) not in sure(find_excursions(taken, 60.0))


def test_a_jerk_of_the_whole_body_is_no_pop(rng, monkeypatch):
    latent = rng.normal(size=(N_FRAMES, 3))
    latent[AT] = [26.0, 0.0, 0.0]
    taken = signals(*shaken(rng, 1.0, latent))
    assert not {one for one in sure(find_excursions(taken, 60.0)) if one[1] <= AT < one[2]}
    monkeypatch.setattr(pops, "_EXPLAINED", 0.0)
    assert {one for one in sure(find_excursions(taken, 60.0)) if one[1] <= AT < one[2]}
