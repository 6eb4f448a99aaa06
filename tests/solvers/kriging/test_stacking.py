import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from mocapclean.solvers.kriging.stacking import stacking_weights


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(2, 5))
def test_weights_are_the_constrained_minimiser(seed, n):
    errors = np.random.default_rng(seed).normal(size=(n, 40)) * np.arange(1, n + 1)[:, None]
    moments = errors @ errors.T
    moments = 0.7 * moments + 0.3 * np.diag(np.diag(moments))
    weights = stacking_weights(errors, 0.3)
    assert weights.sum() == pytest.approx(1.0)
    assert (weights >= 0).all()
    best = minimize(
        lambda w: w @ moments @ w,
        np.full(n, 1 / n),
        bounds=[(0, 1)] * n,
        constraints={"type": "eq", "fun": lambda w: w.sum() - 1},
        options={"ftol": 1e-12},
    )
    assert weights @ moments @ weights <= best.fun * (1 + 1e-4)


def test_without_errors_all_count_alike():
    assert np.allclose(stacking_weights(np.zeros((4, 0)).reshape(4, 0), 0.3), 0.25)
    assert np.allclose(stacking_weights(np.zeros((3, 5)), 0.3), 1 / 3)
