"""The methods that others publish as programs: their parts, and their authors' own errors where these are at hand."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mocapclean
from mocapclean.evaluation.metrics import error
from mocapclean.geometry.distances import mean_distances
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.simulate import hide, perform, single_gaps
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.pma.kernels import Density, kernel_regression
from mocapclean.solvers.pma.sliding import median_mean
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

PUBLISHED = Path(__file__).resolve().parents[3] / "shared" / "design" / "peers_on_shared_takes.csv"
AS = {"pca": "pca", "pma": "pma", "kalman": "kalman_as_published_code"}


def test_the_moving_origin_is_the_mean_of_what_is_always_seen(rng):
    positions = rng.normal(size=(20, 5, 3))
    trusted = np.ones((20, 5), dtype=bool)
    trusted[3:7, 4] = trusted[10] = False
    origin = moving_origin(np.where(trusted[..., None], positions, np.nan), trusted)
    seen = np.delete(np.arange(20), 10)
    np.testing.assert_allclose(origin[seen], positions[seen, :4].mean(axis=1))


def test_the_moving_origin_of_a_stiff_body_does_not_leap_when_markers_come_and_go(rng):
    path = np.cumsum(rng.normal(size=(60, 3)), axis=0)
    positions = path[:, None] + 300.0 * rng.normal(size=(6, 3))
    trusted = rng.random((60, 6)) < 0.6
    trusted[:, 0] |= ~trusted.any(axis=1)
    origin = moving_origin(np.where(trusted[..., None], positions, np.nan), trusted)
    np.testing.assert_allclose(origin - path, np.broadcast_to((origin - path)[0], path.shape), atol=1e-9)


def test_pair_distances_are_those_of_the_frames_that_have_both(rng):
    positions = rng.normal(size=(700, 4, 3))
    trusted = rng.random((700, 4)) < 0.7
    trusted[:, 3] = False
    mean, deviation = mean_distances(np.where(trusted[..., None], positions, np.nan), trusted, 1000)
    both = trusted[:, 0] & trusted[:, 2]
    distance = np.linalg.norm(positions[both, 0] - positions[both, 2], axis=1)
    assert mean[0, 2] == mean[2, 0] == pytest.approx(distance.mean())
    assert deviation[0, 2] == pytest.approx(distance.std())
    assert np.isinf(mean[3]).all()
    assert np.isinf(deviation[3]).all()


@pytest.fixture(scope="module")
def walk() -> Take:
    return perform("walk", 4.0, 120.0, 0).markers


@pytest.mark.parametrize("parameters", [{"strategy": "R1"}, {"strategy": "R2"}, {"scores": "coded"}])
def test_pca_finds_markers_that_are_a_linear_function_of_others(parameters, rng):
    few = rng.normal(size=(120, 4)) * [300.0, 100.0, 50.0, 20.0]
    truth = few @ rng.normal(size=(4, 10 * 3))
    take = Take(
        positions=truth.reshape(120, 10, 3),
        trusted=np.ones((120, 10), dtype=bool),
        markers=tuple("abcdefghij"),
        rate=120.0,
    )
    missing = np.zeros((120, 10), dtype=bool)
    missing[30:50, 2] = missing[45:60, 7] = True
    params = SOLVERS["pca"].Params(kept=0.9999, bandwidth=1e6, lost_weight=1e-6, near=9.0, **parameters)
    solution = run_method("pca", hide(take, missing), params)
    assert error(take.positions, solution.positions, missing).rmse < 0.05 * take.positions.std()


def test_kalman_is_the_least_squares_path_through_what_is_seen(rng):
    """The smoother's mean minimises the quadratic form of its model, here solved as one system."""
    truth = np.cumsum(rng.normal(size=(25, 4)), axis=0) @ rng.normal(size=(4, 15))
    trusted = np.ones((25, 5), dtype=bool)
    trusted[8:14, 1] = trusted[11:20, 3] = trusted[:3, 0] = False
    take = Take(positions=truth.reshape(25, 5, 3), trusted=trusted, markers=tuple("abcde"), rate=120.0)
    params = SOLVERS["kalman"].Params(noise=0.5, tolerance=1e-6, complete_share=0.0)
    solution = run_method("kalman", take, params)
    complete = trusted.all(axis=1)
    mean = truth[complete].mean(axis=0)
    basis = np.linalg.svd(truth[complete] - mean, full_matrices=False)[2][: solution.facts["components"]].T
    moves = np.diff(truth, axis=0)[complete[1:] & complete[:-1]] @ basis
    precise = np.linalg.inv(moves.T @ moves / len(moves))
    n_states = basis.shape[1]
    system = np.zeros((25 * n_states, 25 * n_states))
    pull = np.zeros(25 * n_states)
    seen = np.repeat(trusted, 3, axis=1)
    for t in range(25):
        here = slice(t * n_states, (t + 1) * n_states)
        rows = basis[seen[t]]
        system[here, here] += rows.T @ rows / 0.25
        pull[here] += rows.T @ (truth[t] - mean)[seen[t]] / 0.25
        if t:
            before = slice((t - 1) * n_states, t * n_states)
            system[here, here] += precise
            system[before, before] += precise
            system[here, before] -= precise
            system[before, here] -= precise
    states = np.linalg.solve(system, pull).reshape(25, n_states)
    expected = (mean + states @ basis.T).reshape(25, 5, 3)
    np.testing.assert_allclose(solution.positions[~trusted], expected[~trusted], atol=1e-3)
    narrow = np.linalg.inv(system).reshape(25, n_states, 25, n_states)
    variance = [np.trace(basis[9:12] @ narrow[t, :, t] @ basis[9:12].T) / 3 + 0.25 for t in range(11, 20)]
    np.testing.assert_allclose(solution.sd[11:20, 3] ** 2, variance, rtol=0.02)


def test_a_rigid_body_is_filled_exactly_by_all_ways_but_pca_which_hardly_counts(rng):
    frames = Rotation.from_rotvec(np.linspace(0.0, 2.5, 90)[:, None] * [0.2, 0.7, 0.4]).as_matrix()
    shape = 200.0 * rng.normal(size=(5, 3))
    truth = shape @ frames.swapaxes(1, 2) + np.cumsum(rng.normal(size=(90, 1, 3)), axis=0)
    take = Take(positions=truth, trusted=np.ones((90, 5), dtype=bool), markers=tuple("abcde"), rate=120.0)
    missing = np.zeros((90, 5), dtype=bool)
    missing[30:60, 1] = missing[80:, 4] = True
    exact = ("local", "polynomial", "kernel", "linear")
    largest = {}
    for methods in (*((way,) for way in exact), exact, ("pca",), (*exact, "pca")):
        solution = run_method("pma", hide(take, missing), SOLVERS["pma"].Params(methods=methods))
        assert solution.filled[missing].all()
        largest[methods] = error(truth, solution.positions, missing).largest
    assert max(largest[methods] for methods in largest if "pca" not in methods) < 1e-9
    assert largest[*exact, "pca"] < 0.5 * largest["pca",]


@pytest.mark.parametrize("way", ["local", "polynomial", "kernel", "linear", "pca"])
def test_every_way_of_pma_meets_the_trusted_samples(way, walk):
    missing = np.zeros_like(walk.trusted)
    missing[200:300, 10] = True
    params = SOLVERS["pma"].Params(methods=(way,), space_constraint=False)
    path = run_method("pma", hide(walk, missing), params).positions[:, 10]
    steps = np.linalg.norm(np.diff(np.where(missing[:, 10, None], path, walk.positions[:, 10]), axis=0), axis=1)
    assert steps[[199, 299]].max() < 2.0 * np.linalg.norm(np.diff(walk.positions[:, 10], axis=0), axis=1).max()


def test_the_output_filter_moves_what_is_filled_and_nothing_else(walk):
    missing = np.zeros_like(walk.trusted)
    missing[200:300, 10] = True
    plain, filtered = (
        run_method("pma", hide(walk, missing), SOLVERS["pma"].Params(output_filter=seconds)).positions
        for seconds in (0.0, 0.07)
    )
    moved = np.abs(filtered - plain).max(axis=-1) > 1e-9
    assert moved.any()
    assert not (moved & ~missing).any()


def test_density_is_that_of_the_samples(rng):
    samples = rng.normal(100.0, 5.0, 500)
    low, middle, high, far = Density(samples).at(np.array([80.0, 100.0, 120.0, 1e6]))
    each = Density(samples)._bandwidth
    expected = np.exp(-0.5 * np.square((100.0 - samples) / each)).mean()
    assert middle == pytest.approx(expected, rel=1e-12)
    assert 0.0 <= far < 1e-200
    assert middle > 100 * max(low, high)
    np.testing.assert_allclose(Density(samples / 1000).at(np.array([0.1])), middle)


def test_kernel_regression_is_the_mean_of_what_is_near():
    features, values = np.array([[0.0], [1.0], [9.0]]), np.array([[2.0], [4.0], [7.0]])
    found = kernel_regression(features, values, np.array([[0.5], [1e6], [0.0]]), 1.0)
    np.testing.assert_allclose(found[:2, 0], [3.0, 7.0])
    assert found[2, 0] == pytest.approx((2.0 + 0.5 * 4.0) / 1.5)


def test_sliding_windows_keep_straight_lines_and_take_spikes_out():
    line = np.linspace(0.0, 1.0, 40)[:, None] * [1.0, -3.0]
    np.testing.assert_allclose(median_mean(line, 9), line)
    spiked = line.copy()
    spiked[20] += 50.0
    assert np.abs(median_mean(spiked, 9) - line).max() < 0.2
    for n in (1, 2, 3, 8):
        np.testing.assert_allclose(median_mean(line[:n], 9), line[:n])


@pytest.mark.parametrize("method", AS)
def test_every_marker_with_a_gap_somewhere_is_still_filled(method, walk):
    missing = np.zeros_like(walk.trusted)
    for k in range(missing.shape[1]):
        missing[10 * k : 10 * k + 15, k] = True
    solution = run_method(method, hide(walk, missing), SOLVERS[method].Params())
    assert solution.filled[20:-20][missing[20:-20]].all()
    linear = run_method("linear", hide(walk, missing), SOLVERS["linear"].Params())
    judged = missing & linear.filled
    assert error(walk.positions, solution.positions, judged).rmse < error(walk.positions, linear.positions, judged).rmse


QUICK = {"kalman": {"noise": 0.0316, "process": "diagonal"}}  # as its authors have it; the default is better and slower


@pytest.mark.skipif(not PUBLISHED.exists(), reason="the authors' errors (../shared/design) are not at hand")
@pytest.mark.parametrize("method", AS)
def test_no_worse_than_the_authors_program_on_the_same_masks(method, captures):
    take = mocapclean.read(captures / "c3d" / "MocapRecovery__data_HDM_mm_01-02_03_120.c3d")
    with PUBLISHED.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    cases = [row for row in rows if (row["take"], row["method"]) == ("HDM_mm", AS[method])]
    cases = cases[:: len(cases) // 6]
    ratios = []
    for row in cases:
        n_out, length, seed = (int(row[key]) for key in ("markers_out", "frames_out", "seed"))
        missing = single_gaps(*take.trusted.shape, n_out, length, np.random.default_rng(seed))
        params = SOLVERS[method].Params(**QUICK.get(method, {}))
        solution = run_method(method, hide(take, missing), params)
        ratios.append(error(take.positions, solution.positions, missing).rmse / float(row["rmse_mm"]))
    assert np.median(ratios) < 1.1
