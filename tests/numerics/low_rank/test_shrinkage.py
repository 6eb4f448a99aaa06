"""Proximal maps, each against the full singular value decomposition or its own optimality condition."""

import numpy as np
import pytest

from mocapclean.numerics.low_rank.shrinkage import (
    shrink_singular_values,
    shrink_truncated,
    singular_values,
    spectral_gap_rank,
    top_singular_directions,
)


def matrix_of(rng: np.random.Generator, shape: tuple[int, int], spectrum: list[float]) -> np.ndarray:
    left = np.linalg.qr(rng.normal(size=(shape[0], len(spectrum))))[0]
    right = np.linalg.qr(rng.normal(size=(shape[1], len(spectrum))))[0]
    return (left * spectrum) @ right.T


@pytest.mark.parametrize("shape", [(40, 7), (7, 40), (1, 5), (5, 1), (0, 4), (4, 0)])
@pytest.mark.parametrize("keep", [0, 2])
@pytest.mark.parametrize("threshold", [0.0, 1e-9, 0.8, 100.0])
def test_shrinking_is_that_of_the_full_decomposition(rng, shape, keep, threshold):
    matrix = rng.normal(size=shape)
    shrunk, values = shrink_singular_values(matrix, threshold, keep=keep)
    left, sigma, right = np.linalg.svd(matrix, full_matrices=False)
    expected = np.where(np.arange(len(sigma)) < keep, sigma, np.maximum(sigma - threshold, 0))
    np.testing.assert_allclose(shrunk, (left * expected) @ right, atol=1e-12)
    np.testing.assert_allclose(values, expected, atol=1e-12)
    out = np.empty(shape)
    assert np.shares_memory(shrink_singular_values(matrix, threshold, keep=keep, out=out)[0], out) or not out.size
    np.testing.assert_allclose(out, shrunk, atol=0)


def test_a_tiny_threshold_costs_no_accuracy(rng):
    matrix = matrix_of(rng, (60, 9), [1e6, 1.0, 1e-3, 1e-4])
    shrunk, _ = shrink_singular_values(matrix, 1e-5)
    np.testing.assert_allclose(np.linalg.svd(shrunk)[1][:4], [1e6 - 1e-5, 1 - 1e-5, 1e-3 - 1e-5, 9e-5], atol=2e-9)


@pytest.mark.parametrize("shape", [(50, 8), (8, 50)])
def test_singular_values_and_top_directions(rng, shape):
    matrix = matrix_of(rng, shape, [9.0, 5.0, 2.0])
    np.testing.assert_allclose(singular_values(matrix)[:3], [9, 5, 2], atol=1e-12)
    top = top_singular_directions(matrix, 2)
    assert np.sum(top * matrix) == pytest.approx(14.0)
    np.testing.assert_allclose(singular_values(top)[:3], [1, 1, 0], atol=1e-6)
    everything = top_singular_directions(matrix, 8)
    assert np.linalg.norm(everything, 2) == pytest.approx(1.0)
    assert np.sum(everything * matrix) == pytest.approx(16.0)
    assert not top_singular_directions(0 * matrix, 3).any()


def test_spectral_gap_rank(rng):
    matrix = matrix_of(rng, (30, 12), [90.0, 50.0, 49.0, 20.0, 19.5, 19.0])
    assert [spectral_gap_rank(matrix, gap, 15) for gap in (60.0, 35.0, 25.0, 0.9)] == [0, 1, 3, 6]
    assert spectral_gap_rank(matrix, 0.9, 4) == 4


@pytest.mark.parametrize("shape", [(40, 7), (7, 40), (1, 5), (5, 1)])
@pytest.mark.parametrize(("dimension", "rank"), [(7, 0), (3, 2), (1, 1), (7, 7)])
@pytest.mark.parametrize("threshold", [1e-9, 2.0, 100.0])
def test_truncated_step_and_directions_are_those_of_the_full_decomposition(rng, shape, dimension, rank, threshold):
    matrix = rng.normal(size=shape)
    left, sigma, right = np.linalg.svd(matrix, full_matrices=False)
    places = np.arange(len(sigma))
    lessened = np.where(places < dimension, np.maximum(sigma - threshold, 0), 0)
    chosen = (places < rank) & (lessened > 0)
    out = np.empty(shape)
    top = shrink_truncated(matrix, threshold, dimension, rank, out)
    np.testing.assert_allclose(out, (left * lessened) @ right, atol=1e-12)
    np.testing.assert_allclose(top, (left * chosen) @ right, atol=1e-12)
