"""The filter and smoother against one big Gaussian, conditioned by dense algebra."""

import numpy as np
import pytest

from mocapclean.numerics.state_space.linear_dynamics import LinearSystem, expectation_step
from mocapclean.numerics.state_space.smoother import Dynamics, Masks, Smoothed, kalman_filter, measure, rts_smoother

STATES, GROUPS, NOISE = 3, 3, 0.2


def system(rng: np.random.Generator, start: float = 0.5) -> LinearSystem:
    root = rng.normal(size=(STATES, STATES))
    rotation = np.linalg.qr(rng.normal(size=(STATES, STATES)))[0]
    dynamics = Dynamics(
        transition=0.95 * rotation,
        process=0.1 * root @ root.T + 0.05 * np.eye(STATES),
        start=rng.normal(size=STATES),
        start_covariance=start * np.eye(STATES),
    )
    return LinearSystem(dynamics=dynamics, loadings=rng.normal(size=(2 * GROUPS, STATES)), noise_variance=NOISE)


def dense(known: np.ndarray, values: np.ndarray, of: LinearSystem) -> tuple[np.ndarray, np.ndarray, float]:
    """Posterior means (T, H) and covariance (TH, TH) of all states together, and the log-likelihood of the values."""
    n_frames, dynamics = len(values), of.dynamics
    jump = np.eye(n_frames * STATES)
    for t in range(1, n_frames):
        jump[t * STATES : (t + 1) * STATES, (t - 1) * STATES : t * STATES] = -dynamics.transition
    noise = np.kron(np.eye(n_frames), dynamics.process)
    noise[:STATES, :STATES] = dynamics.start_covariance
    shift = np.zeros(n_frames * STATES)
    shift[:STATES] = dynamics.start
    mean, covariance = np.linalg.solve(jump, shift), np.linalg.solve(jump, np.linalg.solve(jump, noise).T)
    rows = np.kron(np.eye(n_frames), of.loadings)[known.ravel()]
    innovation = values.ravel()[known.ravel()] - rows @ mean
    seen = rows @ covariance @ rows.T + of.noise_variance * np.eye(len(rows))
    gain = np.linalg.solve(seen, rows @ covariance).T
    likelihood = -0.5 * (
        len(rows) * np.log(2 * np.pi) + np.linalg.slogdet(seen)[1] + innovation @ np.linalg.solve(seen, innovation)
    )
    return (mean + gain @ innovation).reshape(-1, STATES), covariance - gain @ rows @ covariance, likelihood


def masks_of(kind: str, n_frames: int, rng: np.random.Generator) -> np.ndarray:
    seen = np.ones((n_frames, GROUPS), dtype=bool)
    if kind == "scattered":
        seen = rng.random((n_frames, GROUPS)) < 0.6
    if kind == "blocks":
        seen[5:45, 0] = seen[30:60, 1] = seen[70:73] = seen[-4:, 2] = False
    if kind == "nothing":
        seen[:] = False
    return seen


def block(matrix: np.ndarray, row: int, column: int) -> np.ndarray:
    return matrix[row * STATES : (row + 1) * STATES, column * STATES : (column + 1) * STATES]


@pytest.mark.parametrize("n_frames", [1, 2, 120])
@pytest.mark.parametrize("kind", ["all", "scattered", "blocks", "nothing"])
def test_posterior_is_that_of_one_big_gaussian(rng, kind, n_frames):
    of, seen = system(rng), masks_of(kind, n_frames, rng)
    known = np.repeat(seen, 2, axis=1)
    values = np.where(known, rng.normal(size=known.shape), 0.0)
    means, covariance, likelihood = dense(known, values, of)
    smoothed, ours = expectation_step(of, values, Masks(seen))
    np.testing.assert_allclose(smoothed.means, means, atol=1e-10)
    for t in range(n_frames):
        np.testing.assert_allclose(smoothed.covariances[smoothed.index[t]], block(covariance, t, t), atol=1e-10)
    lagged = sum((block(covariance, t + 1, t) for t in range(n_frames - 1)), np.zeros((STATES, STATES)))
    np.testing.assert_allclose(smoothed.lagged, lagged, atol=1e-9)
    assert ours == pytest.approx(likelihood, rel=1e-10, abs=1e-10)


def test_covariances_are_computed_no_further_once_they_settle(rng):
    of, seen = system(rng), masks_of("blocks", 3000, rng)
    values = np.where(np.repeat(seen, 2, axis=1), rng.normal(size=(3000, 6)), 0.0)
    filtered = kalman_filter(of.dynamics, measure(of.loadings, of.noise_variance, values, Masks(seen)))
    smoothed = rts_smoother(of.dynamics, filtered)
    assert len(filtered.covariances) < 300
    assert len(smoothed.covariances) < 400
    assert len(smoothed.index) == len(filtered.index) == 3000


def test_a_start_of_no_knowledge_is_no_trouble(rng):
    of, seen = system(rng, start=1e12), masks_of("blocks", 40, rng)
    values = np.where(np.repeat(seen, 2, axis=1), rng.normal(size=(40, 6)), 0.0)
    shifted = Dynamics(**{**vars(of.dynamics), "start": of.dynamics.start + 100})
    one = expectation_step(of, values, Masks(seen))[0].means
    other = expectation_step(
        LinearSystem(dynamics=shifted, loadings=of.loadings, noise_variance=of.noise_variance), values, Masks(seen)
    )[0].means
    np.testing.assert_allclose(one, other, atol=1e-6)


def test_second_moments_are_weighted_sums_over_frames(rng):
    index = np.array([0, 1, 1, 1, 2, 2])
    roots = rng.normal(size=(3, STATES, STATES))
    smoothed = Smoothed(
        means=rng.normal(size=(6, STATES)),
        covariances=roots @ roots.swapaxes(1, 2),
        index=index,
        lagged=np.zeros((STATES, STATES)),
    )
    weights = rng.random((2, 6))
    each = smoothed.covariances[index] + smoothed.means[:, :, None] * smoothed.means[:, None]
    np.testing.assert_allclose(smoothed.second_moments(weights), np.einsum("gt,tij->gij", weights, each), rtol=1e-12)


def test_predicted_values_leave_the_mean_to_the_seen_columns_and_narrow_the_covariance(rng):
    of, seen = system(rng), masks_of("blocks", 40, rng)
    values = np.where(np.repeat(seen, 2, axis=1), rng.normal(size=(40, 6)), 0.0)
    plain, predicting = (measure(of.loadings, of.noise_variance, values, Masks(seen), predict=p) for p in (False, True))
    filtered = kalman_filter(of.dynamics, predicting)
    everything = kalman_filter(of.dynamics, measure(of.loadings, of.noise_variance, values, Masks(np.ones_like(seen))))
    np.testing.assert_allclose(filtered.covariances[filtered.index], everything.covariances[everything.index])
    t = 30
    V, G = filtered.covariances[filtered.index[t]], plain.information[plain.index[t]]
    expected = filtered.predicted_means[t] + V @ (plain.vectors[t] - G @ filtered.predicted_means[t])
    np.testing.assert_allclose(filtered.means[t], expected, atol=1e-12)
