"""Innovations, their thresholds, and the samples off the path of a marker."""

import numpy as np
import pytest

from mocapclean.detection import breaks, paths


def smooth(rng, n_frames=400):
    """A position and a residual (F, 1, 3) of a marker that moves smoothly, with noise of 0.2 mm."""
    t = np.arange(n_frames)[:, None, None] / 60
    position = 400 * np.sin(t + np.array([0.0, 1.0, 2.0]))
    residual = 3 * np.sin(0.3 * t + np.array([2.0, 0.0, 1.0])) + rng.normal(size=(n_frames, 1, 3)) * 0.2
    return position + residual, residual


def off(position, residual, link=150.0, end=60.0):
    innovation = breaks.innovations(position, residual)
    usable = np.isfinite(residual[..., 0])
    threshold = breaks.break_thresholds(innovation, usable, np.zeros_like(residual))
    above = innovation > threshold
    costs = paths.PathCosts(link=link, end=end)
    return paths.deviations(position[:, 0], residual[:, 0], above[:, 0], threshold[:, 0], usable[:, 0], costs)


def shifted(rng, *spans, size=40.0):
    position, residual = smooth(rng)
    for start, stop in spans:
        position[start:stop], residual[start:stop] = position[start:stop] + size, residual[start:stop] + size
    return position, residual


def test_a_smooth_path_has_nothing_off_it(rng):
    path = off(*smooth(rng))
    assert not path.distance.any()
    assert path.cost == 0.0


@pytest.mark.parametrize("spans", [[(50, 51)], [(50, 53), (200, 260)], [(10, 110)], [(0, 30)], [(370, 400)]])
def test_excursions_are_off_the_path_and_nothing_else(rng, spans):
    path = off(*shifted(rng, *spans))
    expected = np.zeros(400, bool)
    for start, stop in spans:
        expected[start:stop] = True
    np.testing.assert_array_equal(path.distance > 0, expected)
    assert path.cost == expected.sum() + 60 * (expected[0] or expected[-1])


def test_a_lasting_step_is_on_the_path_but_costs(rng):
    path = off(*shifted(rng, (200, 400)))
    assert not path.distance.any()
    assert path.cost == 150.0 + 60.0


@pytest.mark.parametrize(("start", "stop"), [(40, 280), (90, 330), (60, 300)])
def test_an_excursion_is_off_the_path_even_if_it_lasts_longer_than_the_rest(rng, start, stop):
    distance = off(*shifted(rng, (start, stop))).distance
    np.testing.assert_array_equal(np.flatnonzero(distance), np.arange(start, stop))


def test_an_end_near_the_median_of_the_path_lies_on_it(rng):
    position, residual = smooth(rng)
    slide = 60.0 * np.linspace(0, 1, 30)[:, None, None] ** 2
    position[250:280], residual[250:280] = position[250:280] + slide, residual[250:280] + slide
    distance = off(position, residual).distance
    assert not distance[:200].any()
    assert not distance[280:].any()


def test_time_reversal_gives_the_same_frames(rng):
    position, residual = shifted(rng, (50, 53), (120, 180))
    forwards = off(position, residual).distance
    backwards = off(position[::-1], residual[::-1]).distance
    np.testing.assert_array_equal(forwards > 0, backwards[::-1] > 0)


def test_only_one_of_position_and_residual_is_no_break(rng):
    position, residual = smooth(rng)
    wild = residual.copy()
    wild[100:140] += 50.0
    assert not off(position, wild).distance.any()
    wild = position.copy()
    wild[100:140] += 50.0
    assert not off(wild, residual).distance.any()


def test_the_tail_of_normal_noise_is_rarely_exceeded_and_faults_do_not_lift_it(rng):
    noise = np.linalg.norm(rng.normal(size=(200_000, 1, 3)), axis=2)
    _, rare = breaks.noise_tail(noise)
    assert (noise > rare).mean() < 1e-4
    assert rare[0] < 2.5 * noise.max()
    noise[: len(noise) // 12] = 500.0
    assert breaks.noise_tail(noise)[1][0] < 1.3 * rare[0]


def test_bursts_of_noise_are_found(rng):
    position, residual = smooth(rng)
    noise = rng.normal(size=(10, 1, 3)) * 12
    position[150:160], residual[150:160] = position[150:160] + noise, residual[150:160] + noise
    innovation = breaks.innovations(position, residual)
    burst = breaks.bursts(innovation, np.ones((400, 1), bool), np.zeros_like(residual))[:, 0]
    assert burst[150:160].sum() >= 8
    assert not burst[:149].any()
    assert not burst[161:].any()


@pytest.mark.parametrize("n_frames", [1, 2, 3, 5])
def test_tiny_takes_are_answered(rng, n_frames):
    position, residual = (path[:n_frames] for path in smooth(rng))
    assert off(position, residual).distance.shape == (n_frames,)
