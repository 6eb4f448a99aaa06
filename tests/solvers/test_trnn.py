"""What Hu et al. (2017) promise: the invariants of every iteration, the fixed point, and low rank plus sparse parts."""

import numpy as np
import pytest
from pydantic import ValidationError

from mocapclean.numerics.interpolation import linear
from mocapclean.numerics.low_rank.shrinkage import singular_values, top_singular_directions
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SmoothSparseModel
from mocapclean.solvers import tsmc
from mocapclean.solvers.running import run_method
from mocapclean.solvers.trnn import Alm, Params, ranks_of, separate
from mocapclean.take import Take


def observed(rng: np.random.Generator) -> tuple[np.ndarray, SmoothSparseModel]:
    """A start and an observation (24, 9) of rank 4 with gaps, spikes and a little noise."""
    t = np.linspace(0, 3, 24)[:, None]
    truth = np.sin(t * [0.7, 1.1, 1.9, 2.6] + [0.0, 1.0, 2.0, 0.5]) @ rng.normal(size=(4, 9)) * 3
    data = truth + 0.01 * rng.normal(size=truth.shape)
    data[[4, 15], [1, 0]] += 2.0
    known = np.ones(truth.shape, dtype=bool)
    known[8:12, :3] = known[-2:, 3:6] = False
    start = np.where(known, data, 0.0)
    return start, SmoothSparseModel(data=start, known=known, sparsity=0.3, smoothness=1.5)


def svt(matrix: np.ndarray, threshold: float) -> np.ndarray:
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    return (left * np.maximum(values - threshold, 0)) @ right


@pytest.mark.parametrize("factors", ["joint", "alternating"])
def test_iterates_are_those_of_the_equations(rng, factors):
    X, given = observed(rng)
    r, d, rho, n_iterations = 2, 4, 1.3, 12
    params = Params(penalty=2.0, growth=rho, tolerance=0.0, max_iterations=n_iterations, factors=factors)
    alm = Alm(X, given, r, d, params)
    alm.run()

    D, W, lam, mu, eta = given.data, given.known, given.sparsity, given.smoothness, params.penalty
    OP = -np.diff(np.eye(24), axis=0).T @ np.diff(np.eye(24), axis=0)
    M, S, Y1, Y2 = X.copy(), np.where(W, 0.0, -X), np.zeros_like(X), np.zeros_like(X)
    L = np.linalg.svd(X)[2][:d].T
    R = X @ L
    P, _, Q = np.linalg.svd(X, full_matrices=False)
    for k in range(n_iterations + 1):
        N = (P[:, :r] @ Q[:r] + Y1 + Y2 + eta * (M + np.where(W, D, 0) - S)) / (2 * eta)
        if factors == "alternating":
            across, _, along = np.linalg.svd(N.T @ R, full_matrices=False)
            L = across @ along
        else:
            L = np.linalg.svd(N)[2][:d].T
        R = svt(N @ L, 1 / (2 * eta))
        X = R @ L.T
        P, s, Q = np.linalg.svd(X, full_matrices=False)
        P[:, s < 1e-6 * s[0]] = 0
        if k == n_iterations:
            break
        eta *= rho if k else 1.0
        T = np.where(W, D, 0) - X + Y2 / eta
        S = np.where(W, np.sign(T) * np.maximum(np.abs(T) - lam / eta, 0), T)
        M = np.linalg.solve(eta * np.eye(24) + mu * OP.T @ OP, eta * X - Y1)
        Y1 = Y1 + eta * (M - X)
        Y2 = Y2 + eta * (np.where(W, D, 0) - X - S)
        np.testing.assert_allclose(mu * OP.T @ OP @ M + Y1, 0, atol=1e-9)
        np.testing.assert_allclose(Y2[~W], 0, atol=1e-9)
    np.testing.assert_allclose(alm.low, X, atol=1e-7)


@pytest.mark.parametrize("factors", ["joint", "alternating"])
def test_the_polished_end_is_a_fixed_point(rng, factors):
    start, given = observed(rng)
    params = Params(growth=1.1, polish=5.0, polish_tolerance=1e-7, max_iterations=5000, factors=factors)
    alm = Alm(start, given, 2, 6, params)
    assert alm.run()
    alm.copies.update(alm.penalty)
    Y1, Y2 = alm.copies.multipliers(alm.penalty)
    S = given.outliers(alm.copies.clean)
    np.testing.assert_allclose(alm.copies.smooth, alm.low, atol=2e-5)
    np.testing.assert_allclose(S, np.where(given.known, given.data - alm.low, 0), atol=2e-5)
    np.testing.assert_allclose(Y2[~given.known], 0, atol=1e-9)
    assert np.abs(Y2).max() <= given.sparsity + 1e-9
    left, values, right = np.linalg.svd(alm.low, full_matrices=False)
    k = int(np.count_nonzero(values > 1e-6))
    assert 2 < k <= 6
    P, Q = left[:, :k], right[:k].T
    T = top_singular_directions(alm.low, 2)
    assert np.sum(T * alm.low) == pytest.approx(values[:2].sum())
    G = (T + Y1 + Y2) @ Q
    np.testing.assert_allclose(G, P, atol=1e-3)


def test_without_truncation_it_is_tsmc(rng):
    start, given = observed(rng)
    params = Params(growth=1.1, polish=1.0, polish_tolerance=1e-10, max_iterations=30000)
    alm = Alm(start, given, 0, 9, params)
    assert alm.run()
    copies = tsmc.SplitCopies(start, given)
    low, _ = tsmc.minimise(copies, tsmc.Params(tolerance=1e-10, max_iterations=20000))
    np.testing.assert_allclose(alm.low, low, atol=1e-6)


def test_rank_never_exceeds_the_dimension(rng):
    start, given = observed(rng)
    for factors in ("joint", "alternating"):
        alm = Alm(start, given, 2, 3, Params(growth=1.3, factors=factors))
        alm.run()
        assert singular_values(alm.low)[3] < 1e-6


def test_low_rank_and_sparse_parts_are_told_apart(rng):
    low = rng.normal(size=(200, 5)) @ rng.normal(size=(5, 40))
    sparse = np.where(rng.random(low.shape) < 0.05, rng.uniform(-10, 10, low.shape), 0.0)
    found, noise, n_iterations = separate(low + sparse, 5)
    assert np.linalg.norm(found - low) < 1e-5 * np.linalg.norm(low)
    np.testing.assert_allclose(noise, sparse, atol=1e-3)
    assert n_iterations < 200
    assert separate(low + sparse, 5, max_iterations=3)[2] == 3


def long_gaps(rng: np.random.Generator) -> tuple[Take, np.ndarray]:
    t = np.arange(200)[:, None] / 60
    truth = 300 * np.sin(2 * np.pi * t * [0.7, 0.7, 1.4, 1.4, 0.3] + [0, 1.6, 0, 1.6, 0]) @ rng.normal(size=(5, 30))
    truth = truth.reshape(200, 10, 3)
    trusted = np.ones((200, 10), dtype=bool)
    trusted[60:160, [1, 4, 7]] = False
    take = Take(positions=np.where(trusted[..., None], truth, 0), trusted=trusted, markers=tuple("abcdefghij"), rate=60)
    return take, truth


def test_a_slow_ramp_fills_long_gaps_better_than_the_printed_one(rng):
    take, truth = long_gaps(rng)
    gap = ~take.trusted
    error = {}
    for growth in (1.02, 1.4):
        estimate = run_method("trnn", take, Params(rank=5, dimension=5, growth=growth)).positions
        error[growth] = np.abs((estimate - truth)[gap]).mean()
    straight = np.abs((linear(take.positions, take.trusted) - truth)[gap]).mean()
    assert error[1.02] < 0.1 * straight
    assert error[1.02] < 0.8 * error[1.4]


def test_ranks_are_chosen_from_the_spectrum_and_kept_in_range(rng):
    start = 100 * rng.normal(size=(50, 4)) @ rng.normal(size=(4, 12)) + 1e-4 * rng.normal(size=(50, 12))
    assert ranks_of(start, Params()) == (4, 4)
    assert ranks_of(start, Params(rank_limit=2)) == (2, 4)
    assert ranks_of(start, Params(rank=6)) == (6, 6)
    assert ranks_of(start, Params(rank=99, dimension=1)) == (12, 12)
    assert ranks_of(0 * start, Params()) == (0, 1)


@pytest.mark.parametrize(
    "wrong",
    [{"rank": -1}, {"rank": "most"}, {"dimension": 0}, {"growth": 0.9}, {"growth": 11.0}, {"penalty": 0.0},
     {"unit": 0.0}, {"start": "x"}, {"factors": "both"}, {"polish": -1.0}, {"max_iterations": 0}],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        Params(**wrong)
