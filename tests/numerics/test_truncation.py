"""The truncated shrinkage against the full decomposition, and its gradient against differences."""

import numpy as np
import pytest

from mocapclean.numerics.truncation import shrink_truncated


@pytest.mark.parametrize("shape", [(40, 7), (7, 40), (1, 5), (5, 1)])
@pytest.mark.parametrize(("dimension", "rank"), [(7, 0), (3, 2), (1, 1), (7, 7)])
@pytest.mark.parametrize("threshold", [1e-9, 2.0, 100.0])
def test_step_and_directions_are_those_of_the_full_decomposition(rng, shape, dimension, rank, threshold):
    matrix = rng.normal(size=shape)
    left, sigma, right = np.linalg.svd(matrix, full_matrices=False)
    places = np.arange(len(sigma))
    lessened = np.where(places < dimension, np.maximum(sigma - threshold, 0), 0)
    chosen = (places < rank) & (lessened > 0)
    out = np.empty(shape)
    top = shrink_truncated(matrix, threshold, dimension, rank, out)
    np.testing.assert_allclose(out, (left * lessened) @ right, atol=1e-12)
    np.testing.assert_allclose(top, (left * chosen) @ right, atol=1e-12)
