"""What Wang et al. (2016) promise: the code is the optimum it is said to be, and the dictionary recovers a motion."""

import dataclasses

import cvxpy as cp
import numpy as np
import pytest
from small_dictionaries import learn

from mocapclean.errors import UsageError
from mocapclean.numerics.coding.locality import affine_weights, locality_ridge, reconstruct
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.solvers.llc import Params
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

CODING = {"neighbours": 0, "weight": 10.0, "bandwidth": 0.5, "exponent": 2}


def swing(n_frames: int, phase: float = 0.0) -> np.ndarray:
    """(F, 12, 3) mm: a trunk of three markers under way and two limbs that swing."""
    t = np.arange(n_frames) / 60.0
    trunk = np.stack([700 * t, 30 * np.sin(5 * t + phase), 900 + 20 * np.sin(9 * t)], axis=1)[:, None]
    rest = np.array([[0, 0, 0], [0, -120, -20], [0, 120, -20.0]])
    limbs = []
    for k in range(9):
        angle = 0.6 * np.sin((4 if k < 5 else 5) * t + phase + k / 4)
        reach = 100.0 + 60 * (k % 5)
        limbs.append(np.stack([reach * np.sin(angle), (-1) ** (k < 5) * 150 + 0 * t, -reach * np.cos(angle)], axis=1))
    return np.concatenate([trunk + rest, trunk + np.stack(limbs, axis=1)], axis=1)


def make_take(positions: np.ndarray, trusted: np.ndarray) -> Take:
    names = tuple(f"m{k}" for k in range(12))
    return Take(positions=np.where(trusted[..., None], positions, 0.0), trusted=trusted, markers=names, rate=60.0)


@pytest.fixture(scope="module")
def dictionary():
    return learn(swing(400), 60.0)


def problem(rng, exponent=2):
    atoms, point = rng.normal(size=(7, 5)), rng.normal(size=5)
    distance = np.linalg.norm(atoms - point, axis=1)
    return atoms, point, locality_ridge(distance, distance.max(), 0.3, 2.0, exponent)


@pytest.mark.parametrize("exponent", [1, 2])
def test_weights_are_the_optimum_of_an_independent_solver(rng, exponent):
    atoms, point, ridge = problem(rng, exponent)
    found = affine_weights((atoms - point) @ (atoms - point).T, ridge)
    w = cp.Variable(7)
    cost = cp.sum_squares(point - atoms.T @ w) + cp.sum(cp.multiply(ridge, cp.square(w)))
    cp.Problem(cp.Minimize(cost), [cp.sum(w) == 1]).solve(solver=cp.CLARABEL)
    assert found == pytest.approx(w.value, abs=1e-5)


def test_only_the_squared_penalty_is_the_printed_objective(rng):
    atoms, point, squared = problem(rng)
    g = np.sqrt(squared / 0.3)

    def objective(w):
        return np.sum((point - w @ atoms) ** 2) + 0.3 * np.sum((g * w) ** 2)

    covariance = (atoms - point) @ (atoms - point).T
    assert objective(affine_weights(covariance, squared)) < objective(affine_weights(covariance, 0.3 * g)) - 1e-6


def test_optimality_conditions(rng):
    atoms, point, ridge = problem(rng)
    covariance = (atoms - point) @ (atoms - point).T
    weights = affine_weights(covariance, ridge)
    slope = (covariance + np.diag(ridge)) @ weights
    assert weights.sum() == pytest.approx(1.0)
    assert slope == pytest.approx(np.full(7, slope.mean()), rel=1e-5)


def test_holes_leave_the_reduced_problem(rng):
    atoms, points = rng.normal(size=(9, 8)), rng.normal(size=(4, 8))
    observed = np.ones((4, 8), dtype=bool)
    observed[0, :2] = observed[1, 1:7] = observed[2, 3] = False
    rebuilt = reconstruct(atoms, points, observed, **CODING)
    for row in range(4):
        seen = observed[row]
        apart = atoms[:, seen] - points[row, seen]
        distance = np.linalg.norm(apart, axis=1)
        weights = affine_weights(apart @ apart.T, locality_ridge(distance, distance.max(), 10.0, 0.5, 2))
        assert rebuilt[row] == pytest.approx(weights @ atoms, abs=1e-6)


def test_shifting_all_shifts_the_answer_and_hidden_entries_are_not_read(rng):
    atoms, points, observed = rng.normal(size=(9, 6)), rng.normal(size=(3, 6)), rng.random((3, 6)) > 0.3
    plain = reconstruct(atoms, points, observed, **CODING)
    shift = rng.normal(size=6)
    assert reconstruct(atoms + shift, points + shift, observed, **CODING) == pytest.approx(plain + shift, abs=1e-6)
    assert np.array_equal(reconstruct(atoms, np.where(observed, points, np.nan), observed, **CODING), plain)


@pytest.mark.parametrize("bandwidth", [0.0, 0.2])
def test_a_point_on_an_atom_is_that_atom(rng, bandwidth):
    atoms = rng.normal(size=(9, 6))
    observed = np.ones((1, 6), dtype=bool)
    observed[0, 4] = False
    options = {**CODING, "weight": 1e-7, "bandwidth": bandwidth, "neighbours": 3}
    assert reconstruct(atoms, atoms[3:4], observed, **options)[0] == pytest.approx(atoms[3], abs=1e-4)


def test_all_atoms_or_as_many_neighbours_are_the_same(rng):
    atoms, points, observed = rng.normal(size=(9, 6)), rng.normal(size=(3, 6)), rng.random((3, 6)) > 0.3
    every = reconstruct(atoms, points, observed, **CODING)
    assert np.allclose(every, reconstruct(atoms, points, observed, **{**CODING, "neighbours": 50}), atol=1e-9)


@pytest.mark.parametrize("form", ["local", "nearest"])
def test_a_motion_like_the_training_is_recovered(dictionary, form):
    truth = swing(200, phase=0.3)
    trusted = np.ones((200, 12), dtype=bool)
    trusted[60:110, [4, 9]] = trusted[140:180, 1] = False
    solution = run_method("llc", make_take(truth, trusted), Params(form=form), dictionary=dictionary)
    error = np.linalg.norm(solution.positions - truth, axis=2)[~trusted]
    assert np.sqrt(np.mean(error**2)) < 15.0
    assert solution.facts["windows"] > 0


def test_blended_seams_have_no_jump(dictionary):
    truth = swing(200, phase=0.3)
    trusted = np.ones((200, 12), dtype=bool)
    trusted[60:110, 4] = False
    take = make_take(truth, trusted)

    def jump(seams):
        filled = run_method("llc", take, Params(seams=seams), dictionary=dictionary).positions[[60, 109], 4]
        return np.linalg.norm(filled - truth[[60, 109], 4], axis=1).max()

    assert jump("blend") < min(jump("paper"), 3.0)


def test_denoising_moves_trusted_samples_and_says_so(dictionary, rng):
    truth = swing(150)
    trusted = np.ones((150, 12), dtype=bool)
    trusted[40:60, 5] = False
    noisy = make_take(truth + rng.normal(scale=2.0, size=truth.shape), trusted)
    plain, smooth = (run_method("llc", noisy, Params(denoise=d), dictionary=dictionary) for d in (0.0, 20.0))
    assert plain.moved is None
    assert np.array_equal(smooth.moved, trusted)
    errors = [np.sqrt(np.mean((s.positions - truth)[trusted] ** 2)) for s in (smooth, noisy)]
    assert errors[0] < 0.7 * errors[1]


CASES = {
    "one frame": make_take(swing(1), np.eye(12, dtype=bool)[:1] == 0),
    "two frames": make_take(swing(2), np.arange(24).reshape(2, 12) != 5),
    "constant": make_take(np.full((20, 12, 3), 7.0), np.arange(240).reshape(20, 12) != 60),
    "all at the origin": make_take(np.zeros((20, 12, 3)), np.arange(240).reshape(20, 12) != 60),
    "a kilometre away": make_take(swing(30) + 1e6, np.arange(360).reshape(30, 12) != 60),
    "trunk never seen": make_take(
        swing(40), np.broadcast_to(np.arange(12) > 2, (40, 12)) & (np.arange(40) != 7)[:, None]
    ),
    "a part never seen": make_take(swing(40), np.broadcast_to(np.arange(12) < 8, (40, 12))),
    "nothing trusted": make_take(swing(6), np.zeros((6, 12), dtype=bool)),
    "no frames": make_take(swing(0), np.zeros((0, 12), dtype=bool)),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("method", ["llc", "srmmp"])
def test_degenerate_takes_get_a_sane_answer(dictionary, method, case):
    take, params = CASES[case], SOLVERS[method].Params()
    solution = run_method(method, take, params, dictionary=dictionary)
    # Dropouts that are bridged over time come on top.
    assert not (fillable(take.trusted) & ~solution.filled).any()
    assert not (solution.filled & ~(fillable(take.trusted) | enclosed(take.trusted))).any()
    if solution.filled.any():
        middle = take.positions[take.trusted].mean(axis=0)
        assert np.abs(solution.positions[solution.filled] - middle).max() < 2000.0


@pytest.mark.parametrize("method", ["llc", "srmmp"])
def test_a_dictionary_of_others_is_refused(dictionary, method):
    params, take = SOLVERS[method].Params(), make_take(swing(20), np.arange(240).reshape(20, 12) != 60)
    with pytest.raises(UsageError, match="--dictionary"):
        run_method(method, take, params)
    renamed = dataclasses.replace(take, markers=(*take.markers[:-1], "nose"))
    with pytest.raises(UsageError, match="only the take has nose; only the dictionary has m11"):
        run_method(method, renamed, params, dictionary=dictionary)
    with pytest.raises(UsageError, match="30 Hz"):
        run_method(method, dataclasses.replace(take, rate=30.0), params, dictionary=dictionary)
    prefixed = dataclasses.replace(take, markers=tuple(f"Ann:{name}" for name in take.markers))
    assert run_method(method, prefixed, params, dictionary=dictionary).filled.any()
