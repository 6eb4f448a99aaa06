"""What Imamura & Okuda (2018) promise: a fixed point, a bound on every multiplier, an objective that only falls."""

from itertools import pairwise

import cvxpy as cp
import numpy as np
import pytest
from pydantic import ValidationError

from mocapclean.numerics.low_rank.shrinkage import top_singular_directions
from mocapclean.solvers.running import run_method
from mocapclean.solvers.trnn2 import Admm, Params
from mocapclean.take import Take

TIGHT = {"tolerance": 1e-9, "inner_iterations": 20000, "max_iterations": 20000}


def square_differences(n_frames: int, d2: str) -> tuple[np.ndarray, np.ndarray]:
    """D₁ with a zero last row and D₂ = D₁D₁, without its last first difference where d2 is clean."""
    d_1 = np.eye(n_frames) - np.eye(n_frames, k=1)
    d_1[-1] = 0
    d_2 = d_1 @ d_1
    if d2 == "clean":
        d_2[-2] = 0
    return d_1, d_2


def problem(rng: np.random.Generator, n_frames: int = 24, n_markers: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """A smooth matrix (F, 3M) of unit spread and what is missing of it, (F, M)."""
    t = np.linspace(0, 3, n_frames)[:, None]
    x = np.sin(t * rng.uniform(0.5, 2, 4) + rng.uniform(0, 6, 4)) @ rng.normal(size=(4, 3 * n_markers))
    x += 0.05 * rng.normal(size=x.shape)
    missing = np.zeros((n_frames, n_markers), dtype=bool)
    missing[n_frames // 3 : n_frames // 2, 0] = missing[-3:, 1] = missing[2, -1] = True
    return x / x.std(), missing


def flaw(x: np.ndarray, missing: np.ndarray) -> np.ndarray:
    return np.where(np.repeat(missing, 3, axis=1), 0.3, x)


def entries(missing: np.ndarray) -> np.ndarray:
    return np.repeat(missing, 3, axis=1)


@pytest.mark.parametrize("d2", ["clean", "paper"])
@pytest.mark.parametrize("form", ["uniform", "paper"])
@pytest.mark.parametrize("x_step", ["exact", "paper"])
def test_iterates_are_those_of_the_equations(rng, form, x_step, d2):
    truth, missing = problem(rng)
    start, free = flaw(truth, missing), entries(missing)
    params = Params(first_weight=0.3, second_weight=0.7, penalty=0.8, form=form, x_step=x_step, d2=d2)
    rho, n_iterations, rank = params.penalty, 15, 2
    admm = Admm(start.copy(), missing, Params(**{**vars(params), "inner_iterations": n_iterations, "tolerance": 0.0}))
    admm.minimise(rank)

    d_1, d_2 = square_differences(len(start), d2)
    c3, c4, t3, t4 = (0.3, 0.7, 1.0, 1.0) if form == "paper" else (1.0, 1.0, 0.3, 0.7)
    blocks = [(1.0, np.eye(len(start))), (1.0, np.eye(len(start))), (c3, d_1), (c4, d_2)]
    H = sum(c * G.T @ G for c, G in blocks)
    left, _, right = np.linalg.svd(start, full_matrices=False)
    AB = left[:, :rank] @ right[:rank]
    X = start.copy()
    W = [G @ X for _, G in blocks]
    Y = [np.zeros_like(X), -AB, np.zeros_like(X), np.zeros_like(X)]

    def svt(matrix, threshold):
        u, s, v = np.linalg.svd(matrix, full_matrices=False)
        return (u * np.maximum(s - threshold, 0)) @ v

    for _ in range(n_iterations):
        R = sum(c * G.T @ (w - y / rho) for (c, G), w, y in zip(blocks, W, Y, strict=True))
        if x_step == "paper":
            X = np.where(free, np.linalg.solve(H, R), start)
        else:
            for column in range(X.shape[1]):
                u, o = free[:, column], ~free[:, column]
                X[u, column] = np.linalg.solve(H[np.ix_(u, u)], R[u, column] - H[np.ix_(u, o)] @ start[o, column])
        Z = [G @ X + y / rho for (_, G), y in zip(blocks, Y, strict=True)]
        W = [svt(Z[0], 1 / rho), Z[1] + AB / rho, Z[2] - np.clip(Z[2], -t3 / rho, t3 / rho), svt(Z[3], t4 / rho)]
        Y = [y + rho * (G @ X - w) for (_, G), w, y in zip(blocks, W, Y, strict=True)]
    np.testing.assert_allclose(admm.x, X, atol=1e-10)
    np.testing.assert_allclose(admm.u1 * rho, Y[0], atol=1e-10)
    np.testing.assert_allclose(admm.u4 * rho, Y[3][: len(admm.u4)], atol=1e-10)
    np.testing.assert_allclose(Y[1], -AB, atol=1e-12)


@pytest.mark.parametrize("form", ["uniform", "paper"])
def test_stationary_on_the_missing_and_exact_on_the_trusted_entries(rng, form):
    truth, missing = problem(rng)
    params = Params(first_weight=0.2, second_weight=1.5, form=form, **TIGHT)
    admm = Admm(flaw(truth, missing), missing, params)
    start = admm.x.copy()
    assert admm.minimise(2)
    assert np.array_equal(admm.x[~entries(missing)], truth[~entries(missing)])
    AB = top_singular_directions(start, 2)
    d_1, d_2 = square_differences(len(start), "clean")
    c3, c4 = (0.2, 1.5) if form == "paper" else (1.0, 1.0)
    Y1, Y3, Y4 = (params.penalty * u for u in (admm.u1, admm.u3, admm.u4))
    slope = Y1 - AB + c3 * d_1[:-1].T @ Y3 + c4 * d_2[:-2].T @ Y4
    assert np.abs(slope[entries(missing)]).max() < 1e-6
    assert np.abs(slope[~entries(missing)]).max() > 1e-3


@pytest.mark.parametrize(("form", "bound3", "bound4"), [("uniform", 0.2, 1.5), ("paper", 1.0, 1.0)])
def test_multipliers_stay_within_their_dual_norm_balls(rng, form, bound3, bound4):
    truth, missing = problem(rng)
    params = Params(first_weight=0.2, second_weight=1.5, penalty=2.0, form=form, inner_iterations=1)
    admm = Admm(flaw(truth, missing), missing, params)
    reached = np.zeros(3)
    for _ in range(30):
        admm.minimise(2)
        norms = [np.linalg.norm(admm.u1, 2), np.abs(admm.u3).max(), np.linalg.norm(admm.u4, 2)]
        reached = np.maximum(reached, 2.0 * np.array(norms))
    np.testing.assert_allclose(reached, [1.0, bound3, bound4], rtol=1e-9)


def convex_optimum(start, missing, rank, beta1, beta2, d2="clean"):
    """Value and minimiser of the inner problem by an interior-point solver, with the tangent taken at start."""
    d_1, d_2 = square_differences(len(start), d2)
    X, AB = cp.Variable(start.shape), top_singular_directions(start, rank)
    value = cp.normNuc(X) - cp.sum(cp.multiply(AB, X))
    value += beta1 * cp.sum(cp.abs(d_1 @ X)) + beta2 * cp.normNuc(d_2 @ X)
    known = (~entries(missing)).astype(float)
    optimum = cp.Problem(cp.Minimize(value), [cp.multiply(known, X) == known * start])
    return optimum.solve(solver=cp.CLARABEL), X.value


@pytest.mark.parametrize(("rank", "beta1", "beta2", "d2"), [(0, 0.0, 0.0, "clean"), (2, 0.1, 2.0, "paper")])
def test_inner_problem_agrees_with_an_interior_point_solver(rng, rank, beta1, beta2, d2):
    truth, missing = problem(rng, 12, 2)
    start = flaw(truth, missing)
    value, minimiser = convex_optimum(start, missing, rank, beta1, beta2, d2)
    admm = Admm(start.copy(), missing, Params(first_weight=beta1, second_weight=beta2, d2=d2, **TIGHT))
    tangent = top_singular_directions(start, rank)
    assert admm.minimise(rank)
    mine = admm.objective(0) - np.sum(tangent * admm.x)
    assert mine == pytest.approx(value, rel=1e-6)
    np.testing.assert_allclose(admm.x, minimiser, atol=1e-4)


def test_both_forms_reach_the_same_objective_and_the_printed_x_step_a_higher_one(rng):
    truth, missing = problem(rng)
    reached = {}
    for form, x_step in (("uniform", "exact"), ("paper", "exact"), ("uniform", "paper")):
        params = Params(first_weight=0.2, second_weight=1.5, form=form, x_step=x_step, **TIGHT)
        admm = Admm(flaw(truth, missing), missing, params)
        admm.minimise(0)
        reached[form, x_step] = admm.objective(0)
    assert reached["paper", "exact"] == pytest.approx(reached["uniform", "exact"], rel=1e-8)
    assert reached["uniform", "paper"] > reached["uniform", "exact"] + 1e-3


def test_outer_steps_never_raise_the_objective(rng):
    truth, missing = problem(rng)
    params = Params(first_weight=0.1, second_weight=1.0, **{**TIGHT, "max_iterations": 10**6})
    admm = Admm(flaw(truth, missing), missing, params)
    objectives = [admm.objective(2)]
    for _ in range(5):
        admm.minimise(2)
        objectives.append(admm.objective(2))
    assert all(b <= a + 1e-7 for a, b in pairwise(objectives))
    assert objectives[-1] < objectives[0] - 0.1


def test_rank_of_the_data_and_no_smoothness_recovers_a_low_rank_matrix(rng):
    truth = rng.normal(size=(40, 2)) @ rng.normal(size=(2, 12))
    missing = rng.random((40, 4)) < 0.15
    missing[0] = False
    admm = Admm(
        flaw(truth, missing), missing, Params(first_weight=0.0, second_weight=0.0, tolerance=1e-9, inner_iterations=200)
    )
    for _ in range(40):
        admm.minimise(2)
        if admm.objective(2) < 1e-6:
            break
    assert admm.objective(2) < 1e-5
    np.testing.assert_allclose(admm.x, truth, atol=1e-4)


def walking_take(rng: np.random.Generator) -> tuple[Take, np.ndarray]:
    """Three gaps of 100 frames at once in a take of rank 5, some 300 mm in spread."""
    t = np.arange(200)[:, None] / 60
    truth = 300 * np.sin(2 * np.pi * t * [0.7, 0.7, 1.4, 1.4, 0.3] + [0, 1.6, 0, 1.6, 0]) @ rng.normal(size=(5, 30))
    truth = truth.reshape(200, 10, 3)
    trusted = np.ones((200, 10), dtype=bool)
    trusted[60:160, [1, 4, 7]] = False
    names = tuple("abcdefghij")
    return Take(positions=np.where(trusted[..., None], truth, 0), trusted=trusted, markers=names, rate=60.0), truth


def test_automatic_rank_is_the_last_wide_gap_of_the_spectrum(rng):
    take, _ = walking_take(rng)
    rank = run_method("trnn2", take, Params()).facts["rank"]
    assert 5 <= rank <= 15
    assert run_method("trnn2", take, Params(rank_limit=4)).facts["rank"] == 4
    assert run_method("trnn2", take, Params(rank=3)).facts["rank"] == 3
    assert run_method("trnn2", take, Params(rank=999, max_iterations=2)).facts["rank"] == 30


def test_rank_continuation_escapes_the_interpolated_start(rng):
    take, truth = walking_take(rng)
    gap = ~take.trusted
    error = {}
    for name, schedule in (("raised", (0, 2, 4)), ("fixed", ())):
        solution = run_method("trnn2", take, Params(rank=5, rank_schedule=schedule))
        error[name] = np.sqrt(np.mean((solution.positions - truth)[gap] ** 2))
    assert error["raised"] < 0.5 * error["fixed"]


def test_turning_the_world_turns_the_answer_without_the_first_difference(rng):
    take, _ = walking_take(rng)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turned = Take(positions=take.positions @ rotation, trusted=take.trusted, markers=take.markers, rate=take.rate)
    params = Params(rank=5, first_weight=0.0)
    one, other = (run_method("trnn2", t, params).positions for t in (take, turned))
    np.testing.assert_allclose(other, one @ rotation, atol=1e-4)


@pytest.mark.parametrize(
    "wrong",
    [{"rank": -1}, {"rank": "most"}, {"rank": 2.5}, {"penalty": 0.0}, {"penalty": float("nan")}, {"form": "f2"},
     {"rank_schedule": (1, -2)}, {"rank_schedule": ("1",)}, {"max_iterations": 0}, {"second_weight": "10"}],
)  # fmt: skip
def test_parameters_out_of_range_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        Params(**wrong)
