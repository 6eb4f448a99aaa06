"""Parts of a gap meet each other and the known samples, and what moves is what was least sure."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocapclean.solvers.kriging.joining import ERROR_SCALE, OUTLYING, join_parts

RATE = 120.0


def joined(track, sd, known, parts):
    """The joined copies of a track (F, 3) and its SD (F,)."""
    track, sd = track.copy(), sd.copy()
    join_parts(track, sd, known, parts, RATE)
    return track, sd


def sd_of(n_frames, parts, values):
    sd = np.full(n_frames, np.nan)
    for (start, stop), value in zip(parts, values, strict=True):
        sd[start:stop] = value
    return sd


def a_walk(n_frames):
    t = np.arange(n_frames)[:, None] / RATE
    return np.concatenate([900 * t, 30 * np.sin(9 * t), 900 + 20 * np.cos(7 * t)], axis=1)


def test_a_smooth_path_stays():
    parts = [(100, 140), (140, 200)]
    track, known = np.arange(300)[:, None] * [3.0, -1.0, 0.5], np.ones(300, dtype=bool)
    known[100:200] = False
    sd = sd_of(300, parts, [5.0, 2.0])
    moved, widened = joined(track, sd, known, parts)
    np.testing.assert_allclose(moved, track, atol=1e-9)
    np.testing.assert_array_equal(widened, sd)


def test_the_part_with_the_larger_sd_moves_more():
    parts = [(100, 150), (150, 200)]
    truth, known = a_walk(300), np.ones(300, dtype=bool)
    known[100:200] = False
    track = truth.copy()
    track[150:200] += 8.0
    moved, _ = joined(track, sd_of(300, parts, [1.0, 6.0]), known, parts)
    change = np.abs(moved - track)
    assert change[150] == pytest.approx([8.0] * 3, abs=0.5)
    assert change[149].max() < 0.2 * change[150].min()
    assert (
        np.linalg.norm(np.diff(moved, axis=0), axis=1).max() < np.linalg.norm(np.diff(truth, axis=0), axis=1).max() + 1
    )
    np.testing.assert_array_equal(moved[known], track[known])


@pytest.mark.parametrize("start", [0, 100])
@pytest.mark.parametrize("stop", [200, 300])
def test_a_part_meets_the_known_samples_on_both_sides(start, stop):
    truth, known = a_walk(300), np.ones(300, dtype=bool)
    known[start:stop] = False
    track = truth.copy()
    track[start:stop] += [12.0, -7.0, 4.0]
    moved, _ = joined(track, sd_of(300, [(start, stop)], [15.0]), known, [(start, stop)])
    if start == 0 and stop == 300:
        np.testing.assert_array_equal(moved, track)
    for edge in {start, stop} - {0, 300}:
        own = truth[edge] - truth[edge - 1]
        assert np.linalg.norm(moved[edge] - moved[edge - 1] - own) < 1.0
        assert np.linalg.norm(track[edge] - track[edge - 1] - own) > 14.0


def test_parts_with_a_break_between_them_are_not_joined():
    track = np.zeros((30, 3))
    track[10:20] = np.nan
    track[20:] = 100.0
    parts = [(0, 10), (20, 30)]
    moved, _ = joined(track, sd_of(30, parts, [5.0, 5.0]), np.zeros(30, dtype=bool), parts)
    np.testing.assert_array_equal(moved, track)


def test_the_sd_grows_by_jumps_that_it_does_not_allow_and_never_falls():
    parts = [(100, 150), (150, 200)]
    track, known = a_walk(300), np.ones(300, dtype=bool)
    known[100:200] = False
    sd = sd_of(300, parts, [1.0, 1.0])
    expected, beyond = track.copy(), track.copy()
    expected[150:200] += 0.5
    beyond[150:200] += 50.0
    np.testing.assert_array_equal(joined(expected, sd, known, parts)[1], sd)
    assert joined(beyond, sd, known, parts)[1][100:200].min() > 10.0


@given(
    seed=st.integers(0, 10_000),
    edges=st.lists(st.integers(22, 58), min_size=1, max_size=4, unique=True),
    ends=st.tuples(st.booleans(), st.booleans()),
)
def test_the_correction_is_the_conditional_mean_of_the_errors(seed, edges, ends):
    """Compared with the conditional mean from the full covariance of all errors and a row of signs for each jump."""
    rng = np.random.default_rng(seed)
    n, first, last = 80, 20 if ends[0] else 0, 60 if ends[1] else 80
    bounds = [first, *sorted(edges), last]
    parts = [(a, b) for a, b in pairwise(bounds) if b > a]
    known = np.ones(n, dtype=bool)
    known[first:last] = False
    track, sd = rng.normal(size=(n, 3)).cumsum(axis=0), sd_of(n, parts, rng.uniform(0.5, 5.0, len(parts)))
    owner = np.full(n, -1)
    for k, part in enumerate(parts):
        owner[slice(*part)] = k
    covariance, signs, jumps = np.zeros((n, n)), [], []
    for s in range(n):
        for t in range(n):
            if owner[s] == owner[t] >= 0:
                lag = np.sqrt(3) * abs(s - t) / (ERROR_SCALE * RATE)
                covariance[s, t] = sd[s] * sd[t] * (1 + lag) * np.exp(-lag)
    for edge in [part[0] for part in parts if part[0] > 0] + ([last] if last < n else []):
        velocities = [
            sign * (track[other] - track[own])
            for own, other, sign in ((edge - 1, edge - 2, -1), (edge, edge + 1, 1))
            if 0 <= other < n and owner[own] == owner[other]
        ]
        if velocities:
            row = np.zeros(n)
            row[edge], row[edge - 1] = 1.0, -1.0
            signs.append(row)
            jumps.append(track[edge] - track[edge - 1] - np.mean(velocities, axis=0))
    second = [
        np.square(track[k - 1] - 2 * track[k] + track[k + 1]) for k in range(1, n - 1) if known[k - 1 : k + 2].all()
    ]
    moved, _ = joined(track, sd, known, parts)
    if not jumps:
        np.testing.assert_array_equal(moved, track)
        return
    signs = np.array(signs)
    noise = np.mean(second) if second else 0.0
    total = signs @ covariance @ signs.T + noise * np.eye(len(signs))
    for k, jump in enumerate(jumps):
        before, after = np.flatnonzero(signs[k])
        if min(owner[before], owner[after]) < 0:
            total[k, k] = max(total[k, k], np.mean(jump**2) / OUTLYING**2)
    weights = covariance @ signs.T @ np.linalg.inv(total)
    np.testing.assert_allclose(moved, track - weights @ np.array(jumps), atol=1e-8)


def test_a_known_sample_that_is_off_by_itself_moves_the_fill_little():
    truth, known = a_walk(300), np.ones(300, dtype=bool)
    known[100:200] = False
    sd = sd_of(300, [(100, 200)], [1.0])
    off = truth.copy()
    off[200:] += [0.0, 30.0, 0.0]
    moved, _ = joined(off, sd, known, [(100, 200)])
    assert np.abs(moved - off).max() < 3.0
