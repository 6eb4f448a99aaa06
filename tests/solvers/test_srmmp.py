"""What the l1-sparse representation promises: each pose is the optimum of its lasso."""

import cvxpy as cp
import numpy as np
import pytest
from small_dictionaries import learn
from test_llc import make_take, swing

from mocapclean.numerics.coding.dictionary_learning import normalised
from mocapclean.numerics.coding.sparse_coding import lasso
from mocapclean.solvers.running import run_method
from mocapclean.solvers.srmmp import Params


@pytest.mark.parametrize("penalty", [0.5, 0.02])
def test_codes_meet_the_optimality_conditions(rng, penalty):
    atoms, signal, observed = normalised(rng.normal(size=(40, 15))), rng.normal(size=15), rng.random(15) > 0.3
    codes, optimal = lasso(atoms, np.where(observed, signal, np.nan), observed, penalty, np.zeros(40))
    pull = atoms[:, observed] @ (signal - codes @ atoms)[observed]
    assert optimal
    assert np.abs(pull).max() <= penalty + 1e-7
    assert pull[codes != 0] == pytest.approx(penalty * np.sign(codes[codes != 0]), abs=1e-7)


@pytest.mark.parametrize("warm", [False, True])
def test_codes_are_those_of_an_independent_solver(rng, warm):
    atoms, signal = normalised(rng.normal(size=(20, 8))), rng.normal(size=8)
    start = rng.normal(size=20) * (rng.random(20) > 0.7) if warm else np.zeros(20)
    codes, _ = lasso(atoms, signal, np.ones(8, dtype=bool), 0.1, start)
    w = cp.Variable(20)
    cp.Problem(cp.Minimize(0.5 * cp.sum_squares(signal - atoms.T @ w) + 0.1 * cp.norm1(w))).solve(solver=cp.CLARABEL)

    def cost(c):
        return 0.5 * np.sum((signal - c @ atoms) ** 2) + 0.1 * np.abs(c).sum()

    assert cost(codes) <= cost(w.value) + 1e-7


def test_a_large_penalty_gives_nothing_and_twins_do_no_harm(rng):
    atoms = normalised(rng.normal(size=(5, 6)))
    signal, everything = rng.normal(size=6), np.ones(6, dtype=bool)
    assert not lasso(atoms, signal, everything, 1.01 * np.abs(atoms @ signal).max(), np.zeros(5))[0].any()
    twice = np.concatenate([atoms, atoms])
    codes, optimal = lasso(twice, signal, everything, 0.01, np.zeros(10))
    single, _ = lasso(atoms, signal, everything, 0.01, np.zeros(5))
    assert optimal
    assert codes @ twice == pytest.approx(single @ atoms, abs=1e-6)


def test_a_motion_like_the_training_is_recovered_sparsely():
    truth = swing(200, phase=0.3)
    trusted = np.ones((200, 12), dtype=bool)
    trusted[60:110, [4, 9]] = False
    solution = run_method("srmmp", make_take(truth, trusted), Params(), dictionary=learn(swing(400), 60.0))
    error = np.linalg.norm(solution.positions - truth, axis=2)[~trusted]
    assert np.sqrt(np.mean(error**2)) < 15.0
    assert solution.facts["frames_not_optimal"] == 0
    assert 0 < solution.facts["mean_active_poses"] < 36
