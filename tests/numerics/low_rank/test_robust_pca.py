"""Robust principal component analysis: optimality, recovery of low rank and sparse errors, unknown entries."""

import cvxpy as cp
import numpy as np
import pytest

from mocapclean.numerics.low_rank.robust_pca import robust_pca


def corrupted(rng, shape=(120, 60), rank=3, share=0.05):
    low = rng.normal(size=(shape[0], rank)) @ rng.normal(size=(rank, shape[1]))
    sparse = np.where(rng.random(shape) < share, rng.uniform(-10, 10, shape), 0.0)
    return low, sparse


def test_few_large_errors_and_low_rank_are_told_apart(rng):
    low, sparse = corrupted(rng)
    parts = robust_pca(low + sparse, 120**-0.5)
    assert parts.converged
    assert np.linalg.norm(parts.low - low) < 1e-5 * np.linalg.norm(low)
    assert np.linalg.norm(parts.sparse - sparse) < 1e-5 * np.linalg.norm(sparse)
    np.testing.assert_allclose(parts.low + parts.sparse, low + sparse, atol=1e-5)


def test_known_rank_recovers_from_more_corruption(rng):
    low, sparse = corrupted(rng, rank=10, share=0.1)
    error = {k: np.linalg.norm(robust_pca(low + sparse, 120**-0.5, keep=k).low - low) for k in (0, 10)}
    assert error[10] < 1e-4 * np.linalg.norm(low)
    assert error[0] > 1e-2 * np.linalg.norm(low)


def test_agrees_with_an_interior_point_solver_and_is_optimal(rng):
    low, sparse = corrupted(rng, (9, 7), 1, 0.15)
    matrix, weight = low + sparse + 0.1 * rng.normal(size=(9, 7)), 0.4
    parts = robust_pca(matrix, weight, growth=1.0, tolerance=1e-9, max_iterations=20000)
    assert parts.converged
    A = cp.Variable(matrix.shape)
    best = cp.Problem(cp.Minimize(cp.normNuc(A) + weight * cp.sum(cp.abs(matrix - A)))).solve(solver=cp.CLARABEL)
    mine = np.linalg.norm(parts.low, "nuc") + weight * np.abs(parts.sparse).sum()
    assert mine == pytest.approx(best, rel=1e-6)
    assert np.linalg.norm(parts.multiplier, 2) <= 1 + 1e-6
    assert np.abs(parts.multiplier).max() <= weight + 1e-6
    large = np.abs(parts.sparse) > 1e-4
    np.testing.assert_allclose(parts.multiplier[large], weight * np.sign(parts.sparse[large]), atol=1e-5)
    assert large.any()


def test_unknown_entries_are_not_read_and_are_recovered(rng):
    low, sparse = corrupted(rng)
    known = rng.random(low.shape) < 0.85
    parts = robust_pca(np.where(known, low + sparse, np.nan), 120**-0.5, known=known, growth=1.1)
    assert not parts.sparse[~known].any()
    assert np.linalg.norm((parts.low - low)[~known]) < 1e-5 * np.linalg.norm(low[~known])


def test_zero_matrix_and_the_cap(rng):
    assert robust_pca(np.zeros((5, 4)), 0.5).converged
    parts = robust_pca(rng.normal(size=(6, 5)), 0.3, tolerance=0.0, max_iterations=4)
    assert len(parts.trace) == 4
    assert not parts.converged
