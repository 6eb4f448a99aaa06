"""Thresholding with bounds, by dual ascent and by splitting: cones, step bound, kick-start, and one convex optimum."""

import cvxpy as cp
import numpy as np
import pytest

from mocapclean.numerics.low_rank import thresholding_by_newton as newton_module
from mocapclean.numerics.low_rank.determined_samples import with_determined
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds, no_bounds
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import (
    DualIterate,
    Iterate,
    project_to_cones,
    threshold_by_dual_ascent,
)
from mocapclean.numerics.low_rank.thresholding_by_newton import threshold_by_newton
from mocapclean.numerics.low_rank.thresholding_by_splitting import FeasiblePairs, threshold_by_splitting

TAU = 30.0


def chain(rng: np.random.Generator, n_frames: int = 10) -> tuple[np.ndarray, np.ndarray, DistanceBounds, tuple]:
    """A swinging chain of 4 joints in unit bones, joint 3 hidden for 4 frames and joint 2 for 2 of them."""
    swing = np.cumsum(0.3 * rng.normal(size=(n_frames, 3)), axis=0)
    steps = np.stack([np.sin(swing), np.cos(swing), 0.2 * np.ones_like(swing)], axis=2)
    steps /= np.linalg.norm(steps, axis=2, keepdims=True)
    joints = np.concatenate([np.zeros((n_frames, 1, 3)), np.cumsum(steps, axis=1)], axis=1)
    joints += np.cumsum(0.2 * rng.normal(size=(n_frames, 1, 3)), axis=0) + 2.0
    trusted = np.ones((n_frames, 4), dtype=bool)
    trusted[3:7, 3] = trusted[4:6, 2] = False
    start, end = np.array([0, 1, 2]), np.array([1, 2, 3])
    frames, bones = np.nonzero(~(trusted[:, start] & trusted[:, end]))
    first, second = 4 * frames + start[bones], 4 * frames + end[bones]
    lengths = np.full(len(frames), 0.3)
    known = np.repeat(trusted, 3, axis=1)
    values = np.where(known, joints.reshape(n_frames, 12), 0.0)
    return values, known, DistanceBounds(first, second, lengths, 4 * n_frames), (first, second, lengths)


def climb(values, known, bounds, *, step, tolerance=1e-8, max_iterations=60000) -> DualIterate:
    return threshold_by_dual_ascent(
        values, known, bounds, threshold=TAU, step=step, tolerance=tolerance, excess_tolerance=tolerance,
        max_iterations=max_iterations,
    )  # fmt: skip


def split(values, known, bounds, *, memory=10, penalty=20.0, tolerance=1e-9, max_iterations=20000) -> Iterate:
    return threshold_by_splitting(
        values, known, bounds, threshold=TAU, penalty=penalty, memory=memory, tolerance=tolerance,
        excess_tolerance=tolerance, max_iterations=max_iterations,
    )  # fmt: skip


def newton(values, known, bounds, *, tolerance=1e-10, max_iterations=2000) -> Iterate:
    return threshold_by_newton(
        values, known, bounds, threshold=TAU, tolerance=tolerance, excess_tolerance=tolerance,
        max_iterations=max_iterations,
    )  # fmt: skip


def svt(matrix: np.ndarray, threshold: float) -> np.ndarray:
    u, s, v = np.linalg.svd(matrix, full_matrices=False)
    return (u * np.maximum(s - threshold, 0)) @ v


def test_projection_gives_the_nearest_point_of_the_cone(rng):
    vectors, heights = rng.normal(size=(200, 3)), 2 * rng.normal(size=200)
    near, lifted = project_to_cones(vectors, heights)
    assert (np.linalg.norm(near, axis=1) <= lifted + 1e-12).all()
    residual, rise = vectors - near, heights - lifted
    np.testing.assert_allclose((residual * near).sum(axis=1) + rise * lifted, 0, atol=1e-12)
    assert (np.linalg.norm(residual, axis=1) <= -rise + 1e-12).all()
    assert (lifted > heights + 0.1).any()
    assert (lifted == heights).any()
    assert ((lifted == 0) & (heights < 0)).any()


def test_curvature_is_a_tight_bound_on_a_tree_and_a_bound_with_a_cycle(rng):
    for ends in (((0, 1), (1, 2), (2, 3)), ((0, 1), (1, 2), (0, 2))):
        first, second = np.array(ends).T
        known = np.repeat(np.array([[True, False, True, True]]), 3, axis=1)
        matrix = np.diag([1.0, 0.0, 1.0, 1.0])
        for a, b in ends:
            difference = np.eye(4)[a] - np.eye(4)[b]
            matrix += np.outer(difference, difference)
        largest = np.linalg.eigvalsh(matrix)[-1]
        bound = DistanceBounds(first, second, np.ones(3), 4).curvature(known)
        assert largest - 1e-12 <= bound
        if (2, 3) in ends:
            assert bound <= 1.05 * largest
    assert no_bounds(4).curvature(known) == 1.0


def test_one_missing_end_joint_has_the_curvature_that_explains_the_printed_step():
    known = np.repeat(np.array([[True, True, False]]), 3, axis=1)
    end = DistanceBounds(np.array([1]), np.array([2]), np.ones(1), 3).curvature(known)
    assert end == pytest.approx((3 + 5**0.5) / 2, rel=1e-3)
    known = np.repeat(np.array([[True, False, True]]), 3, axis=1)
    inner = DistanceBounds(np.array([0, 1]), np.array([1, 2]), np.ones(2), 3).curvature(known)
    assert inner == pytest.approx(2 + 2**0.5, rel=1e-3)


@pytest.mark.parametrize("with_bounds", [False, True])
def test_printed_iteration_and_kick_start_are_those_of_the_equations(rng, with_bounds):
    values, known, bounds, (first, second, lengths) = chain(rng)
    if not with_bounds:
        bounds, first, second, lengths = no_bounds(values.size // 3), first[:0], second[:0], lengths[:0]
    step, n = 0.1, 30
    mine = climb(values, known, bounds, step=step, tolerance=0.0, max_iterations=n)
    assert mine.skipped > 3
    y, p, s = values.copy(), np.zeros((len(lengths), 3)), np.zeros(len(lengths))
    for _ in range(n + mine.skipped):
        total = y.copy().reshape(-1, 3)
        np.add.at(total, first, p)
        np.subtract.at(total, second, p)
        z = svt(total.reshape(values.shape), TAU)
        y += step * np.where(known, values - z, 0)
        samples = z.reshape(-1, 3)
        p, s = project_to_cones(p - step * (samples[first] - samples[second]), s - step * lengths)
    np.testing.assert_allclose(mine.matrix, z, atol=1e-9)
    np.testing.assert_allclose(mine.equality, y, atol=1e-9)
    np.testing.assert_allclose(mine.vectors, p, atol=1e-9)
    assert np.abs(mine.matrix).max() > 0.1
    assert not with_bounds or np.abs(mine.vectors).max() > 1e-3


def test_feasible_pairs_are_the_nearest_by_least_squares(rng):
    values, known, bounds, (first, second, _) = chain(rng)
    matrix, vectors = rng.normal(size=values.shape), rng.normal(size=(len(first), 3))
    rows = np.eye(values.size // 3)[first] - np.eye(values.size // 3)[second]
    free = ~known[:, ::3].ravel()
    system = np.concatenate([np.eye(values.size // 3)[:, free], rows[:, free]])
    goal = np.concatenate([matrix.reshape(-1, 3), vectors]) - np.concatenate(
        [np.eye(len(free)), rows]
    ) @ values.reshape(-1, 3)
    expected = values.reshape(-1, 3).copy()
    expected[free] = np.linalg.lstsq(system, goal, rcond=None)[0]
    nearest, differences = FeasiblePairs(values, known, bounds).nearest(matrix, vectors)
    np.testing.assert_allclose(nearest.reshape(-1, 3), expected, atol=1e-12)
    np.testing.assert_allclose(differences, rows @ expected, atol=1e-12)


def least_by_interior_points(values, known, ends) -> tuple[np.ndarray, float]:
    """Z and the cost of the minimum, by an independent solver."""
    Z = cp.Variable(values.shape)
    rules = [cp.multiply(known.astype(float), Z) == values]
    for a, b, length in zip(*ends, strict=True):
        (row, one), (_, other) = divmod(a, 4), divmod(b, 4)
        rules.append(cp.norm(Z[row, 3 * one : 3 * one + 3] - Z[row, 3 * other : 3 * other + 3]) <= length)
    cost = TAU * cp.normNuc(Z) + 0.5 * cp.sum_squares(Z)
    best = cp.Problem(cp.Minimize(cost), rules).solve(solver=cp.CLARABEL)
    return Z.value, best


def cost_of(matrix: np.ndarray) -> float:
    return TAU * np.linalg.norm(matrix, "nuc") + 0.5 * np.sum(matrix**2)


@pytest.mark.parametrize("with_bounds", [False, True])
def test_splitting_agrees_with_an_interior_point_solver_whatever_speeds_it_up(rng, with_bounds):
    values, known, bounds, ends = chain(rng, 8)
    if not with_bounds:
        bounds, ends = no_bounds(values.size // 3), (np.zeros(0, int),) * 2 + (np.zeros(0),)
    result = split(values, known, bounds)
    assert result.converged
    matrix, best = least_by_interior_points(values, known, ends)
    assert cost_of(result.matrix) == pytest.approx(best, rel=1e-6)
    np.testing.assert_allclose(result.matrix, matrix, atol=2e-3)
    for settings in ({"memory": 0, "tolerance": 1e-7}, {"penalty": 80.0}):
        np.testing.assert_allclose(split(values, known, bounds, **settings).matrix, result.matrix, atol=1e-4)


@pytest.mark.parametrize("with_bounds", [False, True])
def test_newton_agrees_with_an_interior_point_solver_and_with_itself_to_many_digits(rng, monkeypatch, with_bounds):
    values, known, bounds, ends = chain(rng, 8)
    if not with_bounds:
        bounds, ends = no_bounds(values.size // 3), (np.zeros(0, int),) * 2 + (np.zeros(0),)
    result = newton(values, known, bounds)
    assert result.converged
    matrix, best = least_by_interior_points(values, known, ends)
    assert cost_of(result.matrix) == pytest.approx(best, rel=1e-6)
    np.testing.assert_allclose(result.matrix, matrix, atol=2e-3)
    np.testing.assert_allclose(result.matrix, split(values, known, bounds).matrix, atol=1e-5)
    monkeypatch.setattr(newton_module, "_FIRST_PENALTY", 1000.0)
    norm = np.linalg.norm(result.matrix)
    assert np.linalg.norm(newton(values, known, bounds).matrix - result.matrix) <= 1e-8 * norm


def test_newton_converges_faster_than_linearly(rng):
    values, known, bounds, _ = chain(rng, 60)
    result = newton(values, known, bounds)
    assert result.converged
    assert result.residual <= 1e-10
    assert result.excess <= 1e-10
    assert result.trace[-1] / result.trace[-2] <= 0.02 < result.trace[2] / result.trace[1]


def test_newton_stops_at_its_limit_and_reports_it(rng):
    values, known, bounds, _ = chain(rng)
    result = newton(values, known, bounds, max_iterations=3)
    assert not result.converged
    assert 1 <= len(result.trace) <= 3


def test_newton_gives_up_bounds_that_exclude_each_other(rng):
    _, trusted, values, bounds = straight_limb(rng)
    short = DistanceBounds(bounds.first, bounds.second, 0.8 * bounds.lengths, 40)
    result = newton(values, np.repeat(trusted, 3, axis=1), short)
    assert result.contradictory
    assert not result.converged
    assert len(result.trace) < 40
    fine = newton(values, np.repeat(trusted, 3, axis=1), bounds, tolerance=1e-9)
    assert fine.converged
    assert not fine.contradictory


def straight_limb(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, DistanceBounds]:
    """Ten frames of a limb of four joints, stretched out in the first half; the two joints between its ends unknown."""
    lengths = np.array([3.0, 1.0, 2.0])
    steps = rng.normal(size=(10, 3, 3))
    steps[:5] = steps[:5, :1]
    steps *= (lengths / np.linalg.norm(steps, axis=2))[..., None]
    joints = np.concatenate([np.zeros((10, 1, 3)), np.cumsum(steps, axis=1)], axis=1) + rng.normal(size=(10, 1, 3))
    trusted = np.ones((10, 4), dtype=bool)
    trusted[:, 1:3] = False
    frames, bones = np.indices((10, 3)).reshape(2, -1)
    bounds = DistanceBounds(4 * frames + bones, 4 * frames + bones + 1, lengths[bones], 40)
    return joints.reshape(10, 12), trusted, np.where(np.repeat(trusted, 3, axis=1), joints.reshape(10, 12), 0.0), bounds


def test_joints_of_a_stretched_limb_are_put_in_their_place_and_others_are_not(rng):
    truth, trusted, values, bounds = straight_limb(rng)
    placed, known = with_determined(values, np.repeat(trusted, 3, axis=1), bounds)
    assert known[:5].all()
    assert np.array_equal(known[5:, ::3], trusted[5:])
    np.testing.assert_allclose(placed[:5], truth[:5], atol=1e-9)
    assert np.array_equal(placed[5:], values[5:])


def test_a_stretched_limb_does_not_keep_newton_from_its_tolerance(rng):
    truth, trusted, values, bounds = straight_limb(rng)
    result = newton(values, np.repeat(trusted, 3, axis=1), bounds, tolerance=1e-9)
    assert result.converged
    np.testing.assert_allclose(result.matrix[:5], truth[:5], atol=1e-6)


def test_a_bone_of_no_length_puts_its_ends_together(rng):
    values = rng.normal(size=(3, 6))
    known = np.ones((3, 6), dtype=bool)
    known[1, 3:] = False
    bounds = DistanceBounds(np.array([3]), np.array([2]), np.zeros(1), 6)
    placed, determined = with_determined(np.where(known, values, 0.0), known, bounds)
    assert determined.all()
    assert np.array_equal(placed[1, 3:], values[1, :3])


def test_splitting_needs_far_fewer_iterations_than_the_ascent_for_the_same_answer(rng):
    values, known, bounds, _ = chain(rng)
    plain = climb(values, known, bounds, step=1.9 / bounds.curvature(known), tolerance=1e-2)
    fast = split(values, known, bounds, tolerance=1e-2)
    assert plain.converged
    assert 3 * len(fast.trace) < len(plain.trace)
    np.testing.assert_allclose(fast.matrix[known], plain.matrix[known], atol=0.1)
    assert not plain.equality[~known].any()
    assert (np.linalg.norm(plain.vectors, axis=1) <= plain.heights + 1e-9).all()
    assert plain.heights.max() > 0.01


def test_bounds_matter_here(rng):
    values, known, bounds, (first, second, lengths) = chain(rng)
    for limits, holds in ((bounds, True), (no_bounds(values.size // 3), False)):
        samples = split(values, known, limits).matrix.reshape(-1, 3)
        longest = np.linalg.norm(samples[first] - samples[second], axis=1).max()
        assert longest <= lengths[0] + 1e-7 if holds else longest > lengths[0] + 0.01


def test_zero_matrix_is_answered_at_once():
    nothing = np.zeros((4, 6)), np.ones((4, 6), bool), no_bounds(8)
    for result in (climb(*nothing, step=1.0), split(*nothing), newton(*nothing)):
        assert result.converged
        assert len(result.trace) == 1
        assert not result.matrix.any()
