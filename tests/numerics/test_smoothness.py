"""The roughness of columns and its proximal map, against the cosine transform and the dense matrix."""

import numpy as np
import pytest
from scipy.fft import dct, idct

from mocapclean.numerics.smoothness import roughness, roughness_bands, smooth


def operator(n_frames: int, order: int, flat_ends: bool = True) -> np.ndarray:
    D = np.diff(np.eye(n_frames), axis=0)
    return D if order == 1 else -D.T @ D if flat_ends else np.diff(D, axis=0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 9])
def test_bands_and_roughness_are_those_of_the_operator(rng, n_frames, order):
    OP = operator(n_frames, order)
    bands, normal = roughness_bands(n_frames, order), OP.T @ OP
    for k in range(min(3, n_frames)):
        np.testing.assert_allclose(bands[k, : n_frames - k], np.diag(normal, -k), atol=1e-14)
    assert np.count_nonzero(np.tril(normal, -3)) == 0
    values = rng.normal(size=(n_frames, 5))
    assert roughness(values, order) == pytest.approx(np.sum((OP @ values) ** 2))


def test_the_second_difference_has_first_differences_at_its_ends():
    OP = operator(6, 2)
    np.testing.assert_array_equal(OP[0], [-1, 1, 0, 0, 0, 0])
    np.testing.assert_array_equal(OP[2], [0, 1, -2, 1, 0, 0])
    np.testing.assert_array_equal(OP[-1], [0, 0, 0, 0, 1, -1])


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("n_frames", [1, 2, 5, 31])
@pytest.mark.parametrize("weight", [0.0, 0.3, 1e7])
def test_smoothing_is_the_filter_in_the_cosine_domain(rng, n_frames, order, weight):
    values = rng.normal(size=(n_frames, 4))
    gain = 1 / (1 + weight * (4 * np.sin(np.pi * np.arange(n_frames) / (2 * n_frames)) ** 2) ** order)
    expected = idct(gain[:, None] * dct(values, axis=0, norm="ortho"), axis=0, norm="ortho")
    np.testing.assert_allclose(smooth(values, weight, order), expected, atol=1e-8)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 31])
def test_with_free_ends_it_is_the_dense_least_squares_and_leaves_steady_motion_alone(rng, n_frames):
    values, OP = rng.normal(size=(n_frames, 4)), operator(n_frames, 2, flat_ends=False)
    expected = np.linalg.solve(np.eye(n_frames) + 7.0 * OP.T @ OP, values)
    np.testing.assert_allclose(smooth(values, 7.0, 2, flat_ends=False), expected, atol=1e-12)
    steady = np.arange(n_frames)[:, None] * np.array([10.0, -3.0])
    np.testing.assert_allclose(smooth(steady, 7.0, 2, flat_ends=False), steady, atol=1e-9)
