"""What the model of Feng et al. (2014) promises: its optimality conditions, at every iteration and at the end."""

from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from pydantic import ValidationError

from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SmoothSparseModel, SplitCopies
from mocapclean.solvers import tsmc
from mocapclean.solvers.running import run_method
from mocapclean.solvers.tsmc import Params
from mocapclean.take import Take

TIGHT = Params(tolerance=1e-11, max_iterations=20000)


def operator(n_frames: int, order: int) -> np.ndarray:
    D = np.diff(np.eye(n_frames), axis=0)
    return D if order == 1 else -D.T @ D


def noisy(
    rng: np.random.Generator, n_frames: int = 20, n: int = 6, order: int = 2
) -> tuple[np.ndarray, SmoothSparseModel]:
    """A start and an observation: smooth, of rank 3, with gaps and three spikes."""
    t = np.linspace(0, 3, n_frames)[:, None]
    truth = np.sin(t * [0.7, 1.1, 1.9] + [0.0, 1.0, 2.0]) @ rng.normal(size=(3, n)) * 3
    data = truth + 0.01 * rng.normal(size=truth.shape)
    data[4, 1] += 2.0
    data[11, 3] -= 3.0
    data[15, 0] += 1.0
    known = np.ones(truth.shape, dtype=bool)
    known[6:10, :3] = known[-2:, 3:] = False
    data[~known] = 77.0
    return np.where(known, data, 0.0), SmoothSparseModel(
        data=data, known=known, sparsity=0.2, smoothness=1.5, order=order
    )


def minimised(
    start: np.ndarray, observation: SmoothSparseModel, params: Params
) -> tuple[np.ndarray, SplitCopies, list[float]]:
    copies = SplitCopies(start, observation)
    low, trace = tsmc.minimise(copies, params)
    copies.update(params.penalty)
    return low, copies, trace


def objective(low: np.ndarray, observation: SmoothSparseModel) -> float:
    return float(np.linalg.svd(low, compute_uv=False).sum()) + observation.cost(low)


@pytest.mark.parametrize("order", [1, 2])
def test_agrees_with_an_interior_point_solver(rng, order):
    start, given = noisy(rng, 16, 5, order)
    X, OP = cp.Variable(start.shape), operator(16, order)
    seen = given.known.astype(float)
    absolute = cp.sum(cp.abs(cp.multiply(seen, np.where(given.known, given.data, 0.0) - X)))
    cost = cp.normNuc(X) + given.sparsity * absolute + given.smoothness / 2 * cp.sum_squares(OP @ X)
    value = cp.Problem(cp.Minimize(cost)).solve(solver=cp.CLARABEL)
    low, _, _ = minimised(start, given, TIGHT)
    assert objective(low, given) == pytest.approx(value, rel=1e-6)
    np.testing.assert_allclose(low, X.value, atol=1e-3)


@pytest.mark.parametrize("penalty", [0.3, 3.0])
@pytest.mark.parametrize("order", [1, 2])
def test_multipliers_at_every_iteration(rng, order, penalty):
    start, given = noisy(rng, order=order)
    copies, OP = SplitCopies(start, given), operator(20, order)
    low = np.empty(start.shape, order="F")
    shares = []
    for _ in range(12):
        shrink_singular_values(copies.update(penalty), 0.5 / penalty, out=low)
        Y1, Y2 = copies.multipliers(penalty)
        S = given.outliers(copies.clean)
        np.testing.assert_allclose(given.smoothness * OP.T @ OP @ copies.smooth + Y1, 0, atol=1e-10)
        np.testing.assert_allclose(Y2[~given.known], 0, atol=1e-12)
        assert np.abs(Y2).max() <= given.sparsity + 1e-12
        np.testing.assert_allclose(Y2[S != 0], given.sparsity * np.sign(S[S != 0]), atol=1e-12)
        shares.append(np.count_nonzero(S))
        copies.state, _ = copies.next_state(low)
    assert max(shares) > 0


def test_the_end_is_stationary_and_the_same_for_every_penalty_and_memory(rng):
    start, given = noisy(rng)
    low, copies, trace = minimised(start, given, TIGHT)
    assert trace[-1] <= TIGHT.tolerance
    G = sum(copies.multipliers(TIGHT.penalty))
    left, values, right = np.linalg.svd(low, full_matrices=False)
    k = int(np.count_nonzero(values > 1e-7))
    assert 0 < k < 6
    P, Q = left[:, :k], right[:k].T
    np.testing.assert_allclose(P.T @ G, Q.T, atol=1e-6)
    np.testing.assert_allclose(G @ Q, P, atol=1e-6)
    assert np.linalg.norm(G - P @ Q.T, 2) <= 1 + 1e-6
    for other in (replace(TIGHT, memory=0, penalty=0.5), replace(TIGHT, penalty=4.0)):
        np.testing.assert_allclose(minimised(start, given, other)[0], low, atol=1e-6)


def test_extrapolation_needs_fewer_iterations(rng):
    start, given = noisy(rng, 60, 12)
    fast, slow = (len(minimised(start, given, replace(TIGHT, memory=m, tolerance=1e-8))[2]) for m in (10, 0))
    assert fast < slow / 2


def test_spikes_are_found_and_gaps_are_not_read(rng):
    start, given = noisy(rng)
    given = replace(given, sparsity=0.5, smoothness=20.0)
    low, copies, _ = minimised(start, given, TIGHT)
    S = given.outliers(copies.clean)
    np.testing.assert_allclose(S[[4, 11, 15], [1, 3, 0]], [2.0, -3.0, 1.0], atol=0.8)
    assert not S[~given.known].any()
    other = replace(given, data=np.where(given.known, given.data, -5e5))
    np.testing.assert_array_equal(minimised(start, other, TIGHT)[0], low)


def test_without_weight_on_the_differences_there_is_one_copy(rng):
    start, given = noisy(rng)
    plain, tiny = (replace(given, smoothness=mu) for mu in (0.0, 1e-9))
    assert SplitCopies(start, plain).n_copies == 1
    one, two = (objective(minimised(start, g, TIGHT)[0], g) for g in (plain, tiny))
    assert one == pytest.approx(two, rel=1e-6)


def spiked_take(rng: np.random.Generator, gap: bool = True) -> tuple[Take, np.ndarray]:
    t = np.arange(90)[:, None] / 60
    truth = (300 * np.sin(2 * np.pi * t * [0.7, 1.4, 0.3] + [0, 1.6, 0]) @ rng.normal(size=(3, 15))).reshape(90, 5, 3)
    positions, trusted = truth.copy(), np.ones((90, 5), dtype=bool)
    positions[30, 2] += [0.0, 150.0, 0.0]
    if gap:
        trusted[50:60, 1] = False
        positions[~trusted] = np.nan
    return Take(positions=positions, trusted=trusted, markers=tuple("abcde"), rate=60.0), truth


def test_outliers_are_told_and_moved_only_when_asked(rng):
    take, truth = spiked_take(rng)
    plain, asked = (run_method("tsmc", take, Params(denoise=d)) for d in (False, True))
    assert plain.moved is None
    assert plain.outliers[30, 2, 1] == pytest.approx(150, abs=15)
    assert not asked.outliers[~take.trusted].any()
    assert np.array_equal(asked.moved, asked.outliers.any(axis=2))
    assert np.array_equal(asked.positions[take.trusted & ~asked.moved], take.positions[take.trusted & ~asked.moved])
    assert np.abs(asked.positions[30, 2] - truth[30, 2]).max() < 15


def test_a_complete_take_is_denoised_when_asked(rng):
    take, truth = spiked_take(rng, gap=False)
    assert run_method("tsmc", take, Params()).outliers is None
    solution = run_method("tsmc", take, Params(denoise=True))
    assert not solution.filled.any()
    assert solution.moved[30, 2]
    assert np.abs(solution.positions[30, 2] - truth[30, 2]).max() < 15


@pytest.mark.parametrize(
    "wrong",
    [{"sparsity": 0.0}, {"smoothness": -1.0}, {"order": 3}, {"unit": 0.0}, {"penalty": float("nan")},
     {"memory": -1}, {"memory": 51}, {"denoise": 1}, {"max_iterations": 0}],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        Params(**wrong)
