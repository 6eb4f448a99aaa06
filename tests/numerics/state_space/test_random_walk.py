"""The unseen values of a random walk against one big Gaussian, conditioned by dense algebra."""

import numpy as np
import pytest

from mocapclean.numerics.state_space import random_walk as module
from mocapclean.numerics.state_space.random_walk import expect_unseen, random_walk
from mocapclean.numerics.state_space.smoother import Masks

STATES, GROUPS, COLUMNS, NOISE, START = 4, 5, 3, 0.3, 50.0


def system(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Loadings (n, H), and a full process covariance whose variances are 10⁴ apart."""
    axes = np.linalg.qr(rng.normal(size=(STATES, STATES)))[0]
    return rng.normal(size=(GROUPS * COLUMNS, STATES)), (axes * np.geomspace(1e-3, 10.0, STATES)) @ axes.T


def dense(loadings, process, start, known, values) -> tuple[np.ndarray, np.ndarray]:
    """Posterior means and variances (T, n) of all columns, noise included, from the precision of all states."""
    n_frames = len(values)
    jump = np.eye(n_frames) - np.eye(n_frames, k=-1)
    steps = np.kron(np.diag(np.arange(n_frames) > 0), np.linalg.inv(process))
    steps[:STATES, :STATES] = np.eye(STATES) / start
    jumps, rows = np.kron(jump, np.eye(STATES)), np.kron(np.eye(n_frames), loadings)
    seen = rows[known.ravel()]
    covariance = np.linalg.inv(jumps.T @ steps @ jumps + seen.T @ seen / NOISE)
    means = covariance @ (seen.T @ values[known]) / NOISE
    variances = np.einsum("ij,jk,ik->i", rows, covariance, rows) + NOISE
    return (rows @ means).reshape(values.shape), variances.reshape(values.shape)


def masks_of(kind: str, n_frames: int, rng: np.random.Generator) -> np.ndarray:
    seen = np.ones((n_frames, GROUPS), dtype=bool)
    if kind == "scattered":
        seen = rng.random((n_frames, GROUPS)) < 0.6
    if kind == "blocks":
        seen[:7, 3] = seen[5:45, 0] = seen[30:60, 1] = seen[70:73] = seen[75:76, 2] = seen[-14:, 2] = False
    if kind == "one gap":
        seen[40:60, 1] = False
    if kind == "dropout":
        seen[20:50] = False
    return seen


@pytest.mark.parametrize("stored", [1, 2**23])
@pytest.mark.parametrize("n_frames", [1, 2, 3, 90])
@pytest.mark.parametrize("kind", ["scattered", "blocks", "one gap", "dropout"])
def test_unseen_values_are_those_of_one_big_gaussian(rng, monkeypatch, kind, n_frames, stored):
    monkeypatch.setattr(module, "_MOST_STORED_ENTRIES", stored)
    (loadings, process), seen = system(rng), masks_of(kind, n_frames, rng)
    known = np.repeat(seen, COLUMNS, axis=1)
    values = np.where(known, 10.0 * rng.normal(size=known.shape), 0.0)
    expected, variances = dense(loadings, process, START, known, values)
    means, ours = expect_unseen(random_walk(loadings, process, START, NOISE), values, Masks(seen))
    np.testing.assert_allclose(means, np.where(known, 0.0, expected), atol=1e-8)
    grouped = variances.reshape(n_frames, GROUPS, COLUMNS).mean(axis=2)
    np.testing.assert_allclose(ours, np.where(seen, 0.0, grouped), rtol=1e-8)


def test_a_start_of_no_knowledge_is_that_of_great_variance(rng):
    (loadings, process), seen = system(rng), masks_of("blocks", 90, rng)
    seen[0] = False
    values = np.where(np.repeat(seen, COLUMNS, axis=1), rng.normal(size=(90, GROUPS * COLUMNS)), 0.0)
    vague, vaguer = (
        expect_unseen(random_walk(loadings, process, start, NOISE), values, Masks(seen)) for start in (1e9, 1e14)
    )
    np.testing.assert_allclose(vague[0], vaguer[0], atol=1e-6)
    np.testing.assert_allclose(vague[1], vaguer[1], rtol=1e-6)


def test_a_run_of_one_set_of_columns_costs_one_step_however_long_it_is(rng, monkeypatch):
    inverse, calls = module._inverse, []
    monkeypatch.setattr(module, "_inverse", lambda matrix: calls.append(1) or inverse(matrix))
    loadings, process = system(rng)
    for n_frames, length in ((100, 20), (20000, 5000)):
        calls.clear()
        seen = np.ones((n_frames, GROUPS), dtype=bool)
        seen[40 : 40 + length, 1] = False
        expect_unseen(random_walk(loadings, process, START, NOISE), np.ones((n_frames, GROUPS * COLUMNS)), Masks(seen))
        assert len(calls) == 4  # before the gap, its end, after it, and the first frame
