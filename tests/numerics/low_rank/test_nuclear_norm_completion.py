"""Completion: the iteration as written, the optimum of the convex problems, and what each norm can recover."""

import cvxpy as cp
import numpy as np
import pytest

from mocapclean.numerics.low_rank.nuclear_norm_completion import NuclearNormCompletion
from mocapclean.numerics.low_rank.shrinkage import top_singular_directions


def problem(rng: np.random.Generator, shape: tuple[int, int] = (14, 9)) -> tuple[np.ndarray, np.ndarray]:
    """A noisy matrix of rank 2 and which of its entries are known; the others are 0."""
    truth = rng.normal(size=(shape[0], 2)) @ rng.normal(size=(2, shape[1])) + 0.05 * rng.normal(size=shape)
    known = rng.random(shape) < 0.75
    return np.where(known, truth, 0.0), known


@pytest.mark.parametrize(("keep", "relaxation"), [(0, 1.0), (0, 1.6), (2, 1.0)])
@pytest.mark.parametrize("with_tangent", [False, True])
def test_iterates_are_those_of_the_alternating_directions(rng, keep, relaxation, with_tangent):
    values, known = problem(rng)
    mu, n = 0.7, 20
    tangent = top_singular_directions(values, 2) if with_tangent else np.zeros_like(values)
    completion = NuclearNormCompletion(values, known, penalty=mu, relaxation=relaxation)
    completion.run(keep=keep, tangent=tangent, tolerance=0.0, change_tolerance=0.0, max_iterations=n)
    W, Y = values.copy(), np.where(known, 0.0, tangent)
    for _ in range(n):
        u, s, v = np.linalg.svd(W + Y / mu, full_matrices=False)
        lessened = np.maximum(s - 1 / mu, 0)
        lessened[:keep] = s[:keep]
        X = (u * lessened) @ v
        moved = relaxation * X + (1 - relaxation) * W
        Y = Y + mu * np.where(known, values - moved, 0)
        W = np.where(known, values, moved)
    np.testing.assert_allclose(completion.low, X, atol=1e-9)
    np.testing.assert_allclose(completion.filled, W, atol=1e-9)
    np.testing.assert_allclose(completion.multiplier, Y, atol=1e-9)
    assert np.array_equal(completion.filled[known], values[known])


def test_penalty_grows_only_when_the_iterate_has_settled_and_keeps_the_multiplier(rng):
    values, known = problem(rng)
    completion = NuclearNormCompletion(values, known, penalty=0.5)
    completion.run(tolerance=0.0, change_tolerance=0.0, max_iterations=5, growth=2.0, settled=0.0)
    assert completion.penalty == 0.5
    before = completion.multiplier.copy()
    completion.run(tolerance=0.0, change_tolerance=0.0, max_iterations=1, growth=2.0, settled=np.inf)
    assert completion.penalty == 1.0
    step = np.where(known, 0.5 * (values - completion.low), 0.0)
    np.testing.assert_allclose(completion.multiplier, before + step, atol=1e-12)


@pytest.mark.parametrize("rank", [0, 1])
def test_convex_problem_agrees_with_an_interior_point_solver(rng, rank):
    values, known = problem(rng, (9, 7))
    tangent = top_singular_directions(values, rank)
    completion = NuclearNormCompletion(values, known, penalty=2.0, relaxation=1.7)
    assert completion.run(tangent=tangent, tolerance=1e-9, change_tolerance=1e-9, max_iterations=50000)
    X = cp.Variable(values.shape)
    cost = cp.normNuc(X) - cp.sum(cp.multiply(tangent, X))
    best = cp.Problem(cp.Minimize(cost), [cp.multiply(known.astype(float), X) == values]).solve(solver=cp.CLARABEL)
    mine = np.linalg.norm(completion.filled, "nuc") - np.sum(tangent * completion.filled)
    assert mine == pytest.approx(best, rel=1e-6)
    np.testing.assert_allclose(completion.filled, X.value, atol=1e-3)


def test_multiplier_is_a_subgradient_of_the_nuclear_norm(rng):
    values, known = problem(rng)
    completion = NuclearNormCompletion(values, known, penalty=2.0, relaxation=1.7)
    assert completion.run(tolerance=1e-9, change_tolerance=1e-9, max_iterations=50000)
    Y = completion.multiplier
    u, s, v = np.linalg.svd(completion.filled, full_matrices=False)
    rank = int((s > 1e-6 * s[0]).sum())
    assert rank < min(values.shape)
    assert np.linalg.norm(Y, 2) <= 1 + 1e-6
    np.testing.assert_allclose(u[:, :rank].T @ Y @ v[:rank].T, np.eye(rank), atol=1e-4)
    assert not Y[~known].any()


def test_free_singular_values_recover_what_the_nuclear_norm_shrinks(rng):
    truth = rng.normal(size=(40, 3)) @ rng.normal(size=(3, 20))
    known = rng.random(truth.shape) < 0.45
    error = {}
    for keep in (0, 3):
        completion = NuclearNormCompletion(np.where(known, truth, 0.0), known, penalty=1.0)
        completion.run(tolerance=1e-8, change_tolerance=1e-8, max_iterations=1000)
        completion.run(keep=keep, tolerance=1e-8, change_tolerance=1e-8, max_iterations=4000)
        error[keep] = np.linalg.norm(completion.filled - truth) / np.linalg.norm(truth)
    assert error[3] < 1e-5
    assert error[0] > 1e-3


@pytest.mark.parametrize("rank", [0, 1])
def test_extrapolation_comes_to_the_same_answer_sooner_and_keeps_what_is_known(rng, rank):
    values, known = problem(rng)
    tangent = top_singular_directions(values, rank)
    completions = []
    for memory in (0, 6):
        completion = NuclearNormCompletion(values, known, penalty=0.3, memory=memory)
        assert completion.run(tangent=tangent, tolerance=1e-9, change_tolerance=1e-9, max_iterations=20000)
        completions.append(completion)
    plain, fast = completions
    assert 2 * len(fast.trace) < len(plain.trace)
    np.testing.assert_allclose(fast.filled, plain.filled, atol=1e-6)
    np.testing.assert_allclose(fast.multiplier, plain.multiplier, atol=1e-6)
    assert np.array_equal(fast.filled[known], values[known])
