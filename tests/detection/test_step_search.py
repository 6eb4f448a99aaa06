"""The search for steps: the correlation time of noise, against the sum written out."""

import numpy as np
import pytest

from mocapclean.detection import step_search


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
