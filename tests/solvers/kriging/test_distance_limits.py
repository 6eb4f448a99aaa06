"""Filled samples stay within the distances that the take shows for nearly rigid pairs."""

import numpy as np
import pytest

from mocapclean.solvers.kriging.distance_limits import DistanceLimits
from mocapclean.solvers.kriging.neighbours import NeighbourDistances

RIGIDITY = 2.0
RATE = 120.0


def a_heel(rng, n_frames=400):
    """Three markers on a rigid heel (SD of distances about 0.6 mm), and one on the other foot, far from it."""
    t = np.arange(n_frames)[:, None, None] / RATE
    heel = np.array([[0.0, 0, 0], [90, 0, 0], [0, 80, 10], [400, 100, 0]])
    step = 300 * np.concatenate([np.sin(5 * t), 0.2 * np.cos(5 * t), 0.1 * np.sin(9 * t)], axis=2)
    positions = heel + np.where(np.arange(4)[:, None] < 3, step, -step)
    return positions + 0.4 * rng.normal(size=positions.shape)


def limits_of(positions, trusted):
    return DistanceLimits.measured(positions, trusted, NeighbourDistances.measured(positions, trusted, RIGIDITY))


def hidden(positions, start, stop, marker):
    trusted = np.ones(positions.shape[:2], dtype=bool)
    trusted[start:stop, marker] = False
    return trusted


def test_only_nearly_rigid_pairs_have_limits(rng):
    positions = a_heel(rng)
    limits = limits_of(positions, np.ones(positions.shape[:2], dtype=bool))
    assert limits.ends.tolist() == [[0, 1], [0, 2], [1, 2]]
    lengths = np.linalg.norm(positions[:, 0] - positions[:, 1], axis=1)
    assert lengths.min() <= limits.least[0] < limits.largest[0] <= lengths.max()


def test_a_fill_within_the_limits_is_returned_as_it_is(rng):
    positions = a_heel(rng)
    trusted = hidden(positions, 100, 160, 0)
    sd = np.where(trusted, np.nan, 3.0)
    limits = limits_of(positions, trusted)
    inside = positions.copy()
    for _ in range(3):
        inside, _ = limits.restored(inside, sd, trusted, RATE)
    again, same = limits.restored(inside, sd, trusted, RATE)
    np.testing.assert_array_equal(again, inside)
    np.testing.assert_array_equal(same, sd)


def beyond_limits(positions, limits):
    """How far the pair of markers 0 and 1 is beyond its limits in each frame, mm."""
    lengths = np.linalg.norm(positions[:, 0] - positions[:, 1], axis=1)
    return np.abs(np.clip(lengths, limits.least[0], limits.largest[0]) - lengths)


def off_course(positions, offset):
    """Positions with marker 0 off by up to an offset in frames 100 to 160, smoothly."""
    wrong = positions.copy()
    wrong[100:160, 0] += np.sin(np.linspace(0, np.pi, 60))[:, None] * offset
    return wrong


@pytest.mark.parametrize("off", [30.0, 300.0])
def test_a_fill_that_contradicts_measured_partners_is_moved_and_less_sure(rng, off):
    positions = a_heel(rng)
    trusted = hidden(positions, 100, 160, 0)
    sd = np.where(trusted, np.nan, off / 3)
    limits = limits_of(positions, trusted)
    wrong = off_course(positions, [-off, -off, 0.0])
    moved, widened = limits.restored(wrong, sd, trusted, RATE)
    assert beyond_limits(moved, limits).max() < 0.1 * beyond_limits(wrong, limits).max()
    np.testing.assert_array_equal(moved[trusted], wrong[trusted])
    assert np.abs(np.diff(moved - wrong, axis=0)).max() < 0.1 * off
    squares = np.square(moved - wrong).mean(axis=2)
    np.testing.assert_allclose(widened[~trusted], np.sqrt(sd**2 + squares)[~trusted])


def test_of_two_filled_partners_the_less_sure_one_moves(rng):
    positions = a_heel(rng)
    trusted = hidden(positions, 100, 160, [0, 1])
    sd = np.where(trusted, np.nan, 1.0)
    sd[100:160, 1] = 10.0
    limits = limits_of(positions, trusted)
    wrong = positions.copy()
    wrong[120:140, 1] += [50.0, 0.0, 0.0]
    moved, _ = limits.restored(wrong, sd, trusted, RATE)
    change = np.linalg.norm(moved - wrong, axis=2)[120:140]
    assert change[:, 0].max() < 0.05 * change[:, 1].min()


def test_a_take_without_rigid_pairs_has_no_limits(rng):
    positions = 500 * rng.normal(size=(300, 5, 3))
    trusted = hidden(positions, 100, 160, 0)
    limits = limits_of(positions, trusted)
    sd = np.where(trusted, np.nan, 1.0)
    moved, same = limits.restored(positions, sd, trusted, RATE)
    assert moved is positions
    np.testing.assert_array_equal(same, sd)


@pytest.mark.parametrize("measured", [[1, 2], [1]])
def test_a_wrong_fill_is_held_by_however_few_partners(rng, measured):
    positions = a_heel(rng)
    trusted = hidden(positions, 100, 160, [k for k in (0, 1, 2) if k not in measured])
    limits = limits_of(positions, trusted)
    sd, wrong = np.where(trusted, np.nan, 5.0), off_course(positions, -200.0)
    moved, _ = limits.restored(wrong, sd, trusted, RATE)
    assert beyond_limits(moved, limits).max() < 0.1 * beyond_limits(wrong, limits).max()


def test_a_measured_sample_that_contradicts_its_partners_holds_no_fill(rng):
    positions = a_heel(rng)
    trusted = hidden(positions, 100, 160, 0)
    limits = limits_of(positions, trusted)
    sd, swapped = np.where(trusted, np.nan, 1.0), positions.copy()
    # Marker 2 is at another place, as after an exchange of labels.
    swapped[120:140, 2] += [0.0, 150.0, 0.0]
    moved, widened = limits.restored(swapped, sd, trusted, RATE)
    assert np.abs(moved - swapped)[120:140, 0].max() < 3.0
    # The contradiction that is left makes the fill less sure, and no measured sample.
    assert widened[120:140, 0].min() > 10.0
    np.testing.assert_array_equal(np.isnan(widened), np.isnan(sd))


def test_a_distance_far_from_its_median_is_within_three_expected_errors(rng):
    positions = a_heel(rng)
    trusted = hidden(positions, 100, 160, 0)
    limits, sd = limits_of(positions, trusted), np.where(trusted, np.nan, 0.05)
    moved, widened = limits.restored(off_course(positions, [9.0, 9.0, 0.0]), sd, trusted, RATE)
    for k in (0, 1):
        a, b = limits.ends[k]
        off = np.abs(np.linalg.norm(moved[:, a] - moved[:, b], axis=1) - limits.middle[k])[100:160]
        beyond = off > 3.0 * limits.spreads[k]
        assert beyond.any()
        assert (off[beyond] <= 3.0 * np.sqrt(3.0) * widened[100:160, 0][beyond] + 1e-9).all()
