"""Filled paths step no farther than their marker does, and only where they must they move."""

import numpy as np
import pytest

from mocapclean.solvers.kriging.calm_steps import LARGEST_STEP, calm

AT_REST = np.zeros((300, 1, 3))


def a_swing(n_frames=300):
    t = np.arange(n_frames)[:, None] / 120.0
    return np.concatenate([400 * np.sin(6 * t), 50 * np.cos(6 * t), 900 + 30 * np.sin(12 * t)], axis=1)


def calmed(track, sd, known, others=AT_REST):
    """The calmed copies of a track and its SD; the other marker rests, if none are given."""
    track, sd = track.copy(), sd.copy()
    calm(track, sd, known, others, np.ones(others.shape[:2], dtype=bool))
    return track, sd


def a_gap(start, stop, value=10.0):
    known, sd = np.ones(300, dtype=bool), np.full(300, np.nan)
    known[start:stop], sd[start:stop] = False, value
    return known, sd


def largest(path):
    return np.linalg.norm(np.diff(path, axis=0), axis=1).max()


def test_a_path_that_steps_no_farther_than_its_marker_stays():
    known, sd = a_gap(100, 160)
    track = a_swing()
    track[100:160] += np.sin(np.linspace(0, np.pi, 60))[:, None] * 20.0
    moved, same = calmed(track, sd, known)
    np.testing.assert_array_equal(moved, track)
    np.testing.assert_array_equal(same, sd)


@pytest.mark.parametrize(("start", "stop"), [(100, 160), (0, 60), (240, 300)])
def test_a_jump_inside_a_path_is_spread_over_the_frames_that_are_least_sure(start, stop):
    known, sd = a_gap(start, stop)
    sd[start + 30 : stop] = 100.0
    track = a_swing()
    track[start + 30 : stop] += 150.0 * np.sin(np.linspace(np.pi / 2, 0 if stop < 300 else np.pi / 2, 30))[:, None]
    moved, widened = calmed(track, sd, known)
    assert largest(track) > 2 * LARGEST_STEP * largest(a_swing())
    assert largest(moved) <= 1.01 * LARGEST_STEP * largest(a_swing())
    np.testing.assert_array_equal(moved[known], track[known])
    change = np.linalg.norm(moved - track, axis=1)
    assert change[start : start + 25].max() < 0.2 * change.max()
    squares = np.square(moved - track).mean(axis=1)
    np.testing.assert_allclose(widened[~known], np.sqrt(sd**2 + squares)[~known])


def test_a_marker_without_two_known_samples_in_turn_stays():
    track, sd, known = (
        np.random.default_rng(1).normal(size=(300, 3)) * 100,
        np.full(300, 5.0),
        np.zeros(300, dtype=bool),
    )
    known[::3] = True
    moved, _ = calmed(track, sd, known)
    np.testing.assert_array_equal(moved, track)


def test_a_marker_that_moves_only_in_the_gap_steps_as_far_as_its_neighbours():
    known, sd = a_gap(100, 160)
    track = np.zeros((300, 3))
    track[110:150] = 200.0 * np.sin(np.linspace(0, np.pi, 40))[:, None]
    moved, _ = calmed(track, sd, known, track[:, None] + [50.0, 0.0, 0.0])
    np.testing.assert_array_equal(moved, track)


def test_a_marker_that_comes_to_another_place_in_the_gap_steps_as_far_as_it_has_to():
    known, sd = a_gap(100, 160)
    share = np.clip((np.arange(300) - 100) / 60, 0, 1)
    track = share[:, None] * [600.0, 0.0, 0.0]
    moved, _ = calmed(track, sd, known)
    np.testing.assert_allclose(moved, track, atol=1e-9)
