"""What ialm, psvt and tnnr promise: exact trusted samples, reductions to each other, an objective that only falls."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mocapclean.solvers import SOLVERS, ialm, psvt, tnnr, trnn
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

TIGHT = {"tolerance": 1e-7, "max_iterations": 30000}


def swaying(rng: np.random.Generator, rank: int = 4, noise: float = 0.0) -> tuple[Take, np.ndarray]:
    """A take (80, 8, 3) of so low a rank, 300 mm in spread, in which three markers have a gap."""
    t = np.arange(80)[:, None] / 60
    sway = np.sin(t * rng.uniform(2, 9, rank) + rng.uniform(0, 6, rank))
    truth = 300 * sway @ rng.normal(size=(rank, 24)) + noise * rng.normal(size=(80, 24))
    truth = truth.reshape(80, 8, 3)
    truth -= truth.mean(axis=(0, 1))
    trusted = np.ones((80, 8), dtype=bool)
    trusted[10:40, 1] = trusted[30:60, 4] = trusted[50:75, 6] = False
    positions = np.where(trusted[..., None], truth, 0)
    return Take(positions=positions, trusted=trusted, markers=tuple("abcdefgh"), rate=60.0), truth


def error(solution, truth: np.ndarray, take: Take) -> float:
    return float(np.sqrt(np.mean((solution.positions - truth)[~take.trusted] ** 2)))


@pytest.mark.parametrize("method", ["ialm", "psvt", "tnnr"])
def test_trusted_samples_are_exact(rng, method):
    take, _ = swaying(rng, noise=2.0)
    solution = run_method(method, take, SOLVERS[method].Params())
    np.testing.assert_allclose(solution.positions[take.trusted], take.positions[take.trusted], atol=1e-9)


def test_both_schedules_tend_to_the_same_answer(rng):
    take, _ = swaying(rng, noise=2.0)
    fixed = run_method("ialm", take, ialm.Params(**TIGHT))
    paper = run_method("ialm", take, ialm.Params(schedule="paper"))
    assert fixed.converged
    assert paper.converged
    np.testing.assert_allclose(paper.positions, fixed.positions, atol=5.0)
    nuclear = [np.linalg.norm(s.positions.reshape(80, 24) - np.tile(s_mean(take), 8), "nuc") for s in (fixed, paper)]
    assert nuclear[0] <= nuclear[1] * (1 + 1e-6)


def s_mean(take: Take) -> np.ndarray:
    return take.positions[take.trusted].mean(axis=0)


def test_rank_nought_is_ialm(rng):
    take, _ = swaying(rng, noise=2.0)
    least = run_method("ialm", take, ialm.Params(**TIGHT)).positions
    partial = run_method("psvt", take, psvt.Params(rank=0, **TIGHT)).positions
    truncated = run_method("tnnr", take, tnnr.Params(rank=0, inner_iterations=30000, **TIGHT)).positions
    np.testing.assert_allclose(partial, least, atol=0.5)
    np.testing.assert_allclose(truncated, least, atol=0.5)


@pytest.mark.parametrize("method", ["psvt", "tnnr"])
def test_the_right_rank_does_better_than_the_nuclear_norm(rng, method):
    take, truth = swaying(rng)
    rank = error(run_method(method, take, SOLVERS[method].Params(rank=4)), truth, take)
    assert rank < 0.2 * error(run_method("ialm", take, ialm.Params()), truth, take)


def test_outer_steps_never_raise_the_truncated_norm(rng):
    take, _ = swaying(rng, noise=5.0)
    params = tnnr.Params(rank=3, rank_schedule=(), outer_tolerance=0.0, outer_iterations=6, tolerance=1e-8,
                         inner_iterations=5000, max_iterations=10**6)  # fmt: skip
    trace = run_method("tnnr", take, params).trace
    assert len(trace) == 6
    assert all(b <= a * (1 + 1e-6) for a, b in pairwise(trace))
    assert trace[-1] < 0.99 * trace[0]


@pytest.mark.parametrize("method", ["ialm", "psvt"])
def test_spikes_become_outliers_in_mode_robust(rng, method):
    take, truth = swaying(rng, rank=2)
    spikes = np.zeros(truth.shape)
    spikes[5::17, 2] = (400.0, -300.0, 500.0)
    spiked = Take(positions=take.positions + spikes, trusted=take.trusted, markers=take.markers, rate=60.0)
    keep = {"rank": 2} if method == "psvt" else {}
    solution = run_method(method, spiked, SOLVERS[method].Params(mode="robust", **keep))
    assert solution.converged
    assert solution.outliers is not None
    assert not solution.outliers[~take.trusted].any()
    np.testing.assert_allclose(solution.outliers[5::17, 2], spikes[5::17, 2], atol=30.0)
    total = (solution.positions + solution.outliers)[take.trusted]
    np.testing.assert_allclose(total, spiked.positions[take.trusted], atol=0.01)
    assert np.sqrt(np.mean((solution.positions - truth)[take.trusted] ** 2)) < 5.0


@pytest.mark.parametrize("method", ["ialm", "psvt", "tnnr"])
def test_rank_above_the_matrix_and_a_kilometre_away(rng, method):
    take, _ = swaying(rng)
    rank = {"rank": 999} if method != "ialm" else {}
    far = Take(positions=take.positions + 1e6, trusted=take.trusted, markers=take.markers, rate=60.0)
    one, other = (
        run_method(method, t, SOLVERS[method].Params(max_iterations=60, **rank)).positions for t in (take, far)
    )
    np.testing.assert_allclose((other - 1e6)[~take.trusted], one[~take.trusted], atol=1e-3)


@pytest.mark.parametrize("method", ["psvt", "tnnr"])
def test_the_automatic_rank_is_the_one_of_trnn(rng, method):
    take, _ = swaying(rng)
    rule = {"rank_gap": 50.0, "rank_limit": 3}
    solution = run_method(method, take, SOLVERS[method].Params(rank="auto", **rule))
    chosen = run_method("trnn", take, trnn.Params(max_iterations=1, **rule)).facts["rank"]
    assert chosen == 3
    assert solution.facts["rank" if method == "tnnr" else "kept"] == chosen
    nothing = replace(take, trusted=np.zeros_like(take.trusted))
    assert not run_method(method, nothing, SOLVERS[method].Params(rank="auto")).filled.any()
