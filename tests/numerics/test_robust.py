"""The median that ignores NaN, against NumPy's."""

import warnings

import numpy as np
import pytest

from mocapclean.numerics.robust import nan_median


@pytest.mark.parametrize("missing", [0.0, 0.4])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("shape", [(1, 1, 1), (4, 5, 3), (7, 6, 2)])
def test_it_agrees_with_numpy(rng, shape, axis, missing):
    values = rng.normal(size=shape)
    values[rng.random(shape) < missing] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        expected = np.nanmedian(values, axis=axis)
    np.testing.assert_array_equal(nan_median(values, axis), expected)
