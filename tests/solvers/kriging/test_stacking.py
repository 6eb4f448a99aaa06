import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from mocapclean.solvers.kriging.regression_kriging import KrigingResult
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan
from mocapclean.solvers.kriging.stacking import combine, stacking_weights


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


def test_without_errors_all_weights_are_equal():
    assert np.allclose(stacking_weights(np.zeros((4, 0)).reshape(4, 0), 0.3), 0.25)
    assert np.allclose(stacking_weights(np.zeros((3, 5)), 0.3), 1 / 3)


def result(positions: float, error: float) -> KrigingResult:
    return KrigingResult(
        positions=np.full((8, 3), positions),
        window_errors=error * np.random.default_rng(int(100 * error)).normal(size=(12, 4, 3)),
        gap_variance=np.ones(8),
        window_variance=np.ones(4),
    )


def plan() -> SamplingPlan:
    empty = np.zeros(0, dtype=int)
    return SamplingPlan(
        training=empty,
        windows=np.zeros((12, 4), dtype=int),
        inside=np.array([0, 2, 5, 7]),
        adjacent=empty,
        adjacent_known=np.zeros((12, 0), dtype=bool),
        gap_adjacent=empty,
        gap=np.arange(8),
    )


def test_the_sd_of_a_stack_is_the_error_in_windows():
    _, sd = combine([result(5.0, 1.0), result(5.0, 1.5)], plan(), 0.03, 0.3)
    assert np.all((sd > 0.5) & (sd < 1.2))


def test_the_sd_grows_where_predictors_disagree():
    agreeing, close = combine([result(5.0, 1.0), result(5.0, 1.5)], plan(), 0.03, 0.3)
    stacked, wide = combine([result(0.0, 1.0), result(50.0, 1.5)], plan(), 0.03, 0.3)
    assert np.allclose(agreeing, 5.0)
    assert np.all((stacked > 0.0) & (stacked < 50.0))
    assert np.all(wide > 3 * close)
