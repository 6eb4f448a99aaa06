"""The search for steps: the correlation time of noise, against the sum written out."""

import numpy as np
import pytest

from mocapclean.detection import step_search
from mocapclean.detection.robust_ridge import Rows, Sample, regress


@pytest.mark.parametrize("n_rows", [41, 300, 801])
def test_the_correlation_time_is_the_sum_of_the_autocorrelation(rng, n_rows):
    noise = rng.normal(size=(3, 3, n_rows))
    for each, share in zip(noise, (0.0, 0.7, 0.97), strict=True):
        for row in range(1, n_rows):
            each[:, row] += share * each[:, row - 1]
    times = step_search._correlation_times(noise, np.full(3, n_rows))
    for each, time in zip(noise, times, strict=True):
        total = 1.0
        for lag in range(1, min(200, n_rows // 4)):
            along = (each[:, lag:] * each[:, :-lag]).sum() / (each**2).sum()
            if along < 0.1:
                break
            total += 2.0 * along
        np.testing.assert_allclose(time, total, rtol=1e-9)
    assert times[2] > 3.0 * times[0]


def test_the_length_of_a_transform_is_the_least_with_one_small_factor():
    allowed = sorted(part * 2**power for part in (1, 3, 5) for power in range(14))
    for least in (1, 2, 3, 41, 200, 1000, 1001, 4097):
        assert step_search._fast_length(least) == min(size for size in allowed if size >= least)


@pytest.mark.parametrize("size", [20.0, 60.0])
@pytest.mark.parametrize("n_rows", [150, 700])
def test_the_screen_lets_every_step_through_that_the_full_search_finds(rng, n_rows, size):
    n_markers = 6
    inputs = np.cumsum(rng.normal(size=(n_markers, 9, n_rows)), axis=2) / 5
    targets = rng.normal(size=(n_markers, 3, 9)) @ inputs + rng.normal(size=(n_markers, 3, n_rows))
    start = n_rows // 3
    targets[: n_markers // 2, :, start:] += size * np.array([[0.0], [0.6], [0.8]])
    sample = Sample.of(inputs, targets, Rows.of([np.arange(n_rows)] * n_markers))
    every = step_search.find_steps(np.arange(n_markers), sample, 30)
    screened = step_search.find_steps(np.arange(n_markers), sample, 30, regress(sample).penalties)
    credible = [(step.marker, step.start) for step in every if step.score > 6.0]
    assert {marker for marker, _ in credible} >= set(range(n_markers // 2))
    assert set(credible) <= {(step.marker, step.start) for step in screened}
