import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.solvers.kriging.short_gaps import bridge_short_gaps, in_short_gaps


def bridge(positions, trusted, frames_for=None):
    return bridge_short_gaps(positions, trusted, in_short_gaps(trusted, 5), 120.0, frames_for)


def wave(n_frames: int = 300) -> np.ndarray:
    t = np.arange(n_frames)[:, None, None] / 120.0
    return 200 * np.sin(2 * np.pi * t * np.array([[0.7, 1.1, 1.9]]) + np.array([[0.0], [1.0]])[None])


def test_straight_lines_are_continued_exactly():
    track = np.arange(60.0)[:, None, None] * np.array([[[3.0, -2.0, 0.5]]])
    trusted = np.ones((60, 1), dtype=bool)
    trusted[20:24] = trusted[:3] = trusted[-2:] = False
    filled, sd = bridge(np.where(trusted[..., None], track, 0.0), trusted)
    assert np.abs(filled - track).max() < 1e-6
    assert np.isfinite(sd[~trusted]).all()


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), length=st.integers(1, 5))
def test_smooth_motion_is_better_than_by_a_cubic_spline(seed, length):
    truth = wave()
    trusted = np.ones(truth.shape[:2], dtype=bool)
    start = int(np.random.default_rng(seed).integers(30, 260))
    trusted[start : start + length, 0] = False
    filled, sd = bridge(np.where(trusted[..., None], truth, 0.0), trusted)
    known = np.flatnonzero(trusted[:, 0])
    spline = CubicSpline(known, truth[known, 0])(np.arange(start, start + length))
    own = np.abs(filled[start : start + length, 0] - truth[start : start + length, 0]).max()
    assert own <= np.abs(spline - truth[start : start + length, 0]).max() + 1e-3
    assert np.isnan(sd[:, 1]).all()


def test_the_sd_is_that_of_the_noise(rng):
    truth = wave(2000)
    noisy = truth + rng.normal(size=truth.shape)
    trusted = np.ones(truth.shape[:2], dtype=bool)
    trusted[50:1950:40] = False
    filled, sd = bridge(np.where(trusted[..., None], noisy, 0.0), trusted)
    miss = (filled - noisy)[~trusted] / sd[~trusted][:, None]
    assert 0.8 < np.sqrt(np.mean(miss**2)) < 1.25


@pytest.mark.parametrize("n_frames", [1, 5, 11])
def test_gaps_of_markers_with_few_trusted_samples_are_left(n_frames):
    trusted = np.ones((n_frames, 1), dtype=bool)
    trusted[n_frames // 2] = False
    _, sd = bridge(np.zeros((n_frames, 1, 3)), trusted)
    assert np.isnan(sd).all()


def shaken(rng, leap=0.0):
    """Return a shaken marker, its trusted samples, their mask, and frames from neighbours that leap in frame 151."""
    truth = wave()[:, :1] + rng.normal(size=(300, 1, 3)) * 5.0
    carried = truth[:, 0] + [5.0, 1.0, 2.0]
    carried[151, 0] += leap
    trusted = np.ones(truth.shape[:2], dtype=bool)
    trusted[150:153] = False

    def frames_for(marker, frames):
        return BodyFrames(np.broadcast_to(np.eye(3), (len(frames), 3, 3)), carried[frames])

    return truth, np.where(trusted[..., None], truth, 0.0), trusted, frames_for


def test_a_shake_that_the_neighbours_share_is_followed(rng):
    truth, seen, trusted, frames_for = shaken(rng)
    alone, followed = bridge(seen, trusted)[0], bridge(seen, trusted, frames_for)[0]
    assert np.abs(followed - truth).max() < 0.1
    assert np.abs(alone - truth).max() > 3.0


def test_neighbours_that_leap_mislead_by_some_sd_at_most(rng):
    _, seen, trusted, frames_for = shaken(rng, leap=1000.0)
    (alone, sd), followed = bridge(seen, trusted), bridge(seen, trusted, frames_for)[0]
    assert np.linalg.norm((followed - alone)[151, 0]) < 5.0 * np.sqrt(3.0) * sd[151, 0]
    assert np.linalg.norm((followed - alone)[151, 0]) > 3.0 * np.sqrt(3.0) * sd[151, 0]


def test_short_gaps_are_those_up_to_the_longest_of_markers_trusted_often_enough():
    trusted = np.ones((40, 2), dtype=bool)
    trusted[10:15] = trusted[20:26] = False
    trusted[:30, 1] = False
    expected = np.zeros_like(trusted)
    expected[10:15, 0] = True
    assert np.array_equal(in_short_gaps(trusted, 5), expected)
