import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mocapclean.numerics.graduation import graduated


@given(st.integers(0, 10_000), st.integers(1, 12), st.floats(0.01, 1e4))
def test_the_result_is_that_of_the_dense_system(seed, n, strength):
    rng = np.random.default_rng(seed)
    values, weights = rng.normal(size=(n, 3)), rng.uniform(0.1, 10.0, n)
    differences = np.diff(np.eye(n), 2, axis=0)
    dense = np.diag(weights) + strength * differences.T @ differences
    np.testing.assert_allclose(
        graduated(values, weights, strength), np.linalg.solve(dense, weights[:, None] * values), atol=1e-8
    )


@pytest.mark.parametrize("strength", [1.0, 1e6])
def test_a_straight_line_stays(strength):
    line = np.arange(50.0)[:, None] * [1.0, -2.0, 0.5] + [3.0, 4.0, 5.0]
    np.testing.assert_allclose(graduated(line, np.ones(50), strength), line, atol=1e-7)
