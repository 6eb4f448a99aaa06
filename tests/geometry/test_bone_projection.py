"""Projection onto bone lengths: exact where there is a formula, and as a general optimiser finds it elsewhere."""

import numpy as np
import pytest
from scipy.optimize import minimize

from mocapclean.geometry.bone_projection import project_to_bone_lengths, tied_points

CHAIN = np.array([[0, 1], [1, 2], [2, 3]])
OPTIONS = {"ftol": 1e-15, "maxiter": 500}


def chain(rng: np.random.Generator, n_frames: int, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Targets (F, 4, 3) near a chain of three bones of given lengths, and which of its points may move."""
    lengths = np.array([0.4, 0.3, 0.2])
    steps = rng.normal(size=(n_frames, 3, 3))
    steps *= lengths[:, None] / np.linalg.norm(steps, axis=2, keepdims=True)
    points = np.concatenate([np.zeros((n_frames, 1, 3)), np.cumsum(steps, axis=1)], axis=1)
    movable = np.tile([False, True, True, False], (n_frames, 1))
    movable[::3, 2] = False
    return points + noise * rng.normal(size=points.shape) * movable[..., None], lengths, movable


def stretch(points: np.ndarray, ends: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, ends[:, 0]] - points[:, ends[:, 1]], axis=2) - lengths


@pytest.mark.parametrize("weight", [np.inf, 3.0])
def test_one_bone_is_shortened_along_itself(weight):
    targets = np.array([[[0.0, 0, 0], [0, 0.6, 0]]])
    movable = np.array([[False, True]])
    points, errors = project_to_bone_lengths(targets, movable, ~movable, np.array([[0, 1]]), np.array([0.5]), weight)
    assert errors[0] < 1e-12
    y = points[0, 1, 1]
    slope = y - 0.6 + weight * (y * y - 0.25) / 1.0 * (y / 0.5) if np.isfinite(weight) else y - 0.5
    assert slope == pytest.approx(0.0, abs=1e-8)
    assert np.array_equal(points[0, 0], targets[0, 0])


def test_bones_hold_and_the_kkt_system_is_solved(rng):
    targets, lengths, movable = chain(rng, 40, 0.05)
    points, errors = project_to_bone_lengths(targets, movable, ~movable, CHAIN, lengths)
    assert errors.max() < 1e-9
    active = movable[:, CHAIN].any(axis=2)
    assert np.abs(stretch(points, CHAIN, lengths))[active].max() < 1e-8
    assert np.abs(stretch(targets, CHAIN, lengths))[active].max() > 1e-2
    assert np.array_equal(points[~movable], targets[~movable])


@pytest.mark.parametrize("weights", [np.inf, 5.0, np.array([np.inf, 2.0, 8.0])])
def test_agrees_with_a_general_optimiser(rng, weights):
    targets, lengths, movable = chain(rng, 4, 0.03)
    points, _ = project_to_bone_lengths(targets, movable, ~movable, CHAIN, lengths, weights)
    weights = np.broadcast_to(weights, 3)
    for frame in range(4):
        own = movable[frame]
        active = own[CHAIN].any(axis=1)

        def place(y, frame=frame, own=own):
            whole = targets[frame].copy()
            whole[own] = y.reshape(-1, 3)
            return whole

        def bends(y, active=active, place=place):
            offset = place(y)[CHAIN[active, 0]] - place(y)[CHAIN[active, 1]]
            return (np.sum(offset**2, axis=1) - lengths[active] ** 2) / (2 * lengths[active])

        soft = np.isfinite(weights[active])

        def cost(y, frame=frame, own=own, bends=bends, soft=soft, active=active):
            miss = np.sum((y - targets[frame, own].ravel()) ** 2)
            return miss + np.sum(weights[active][soft] * bends(y)[soft] ** 2)

        def ties(y, bends=bends, soft=soft):
            return bends(y)[~soft]

        start = targets[frame, own].ravel()
        best = minimize(cost, start, method="SLSQP", constraints={"type": "eq", "fun": ties}, options=OPTIONS)
        np.testing.assert_allclose(points[frame, own].ravel(), best.x, atol=1e-5)


def test_more_bones_than_freedom_that_disagree_are_met_halfway():
    anchors = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]])
    targets = np.concatenate([anchors, [[0.1, 0.1, 0.1]]])[None]
    movable = np.array([[False] * 5 + [True]])
    ends = np.array([[k, 5] for k in range(5)])
    points, _ = project_to_bone_lengths(targets, movable, ~movable, ends, np.array([1.01, 1.01, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(points[0, 5], 0.0, atol=2e-3)


def test_nothing_moves_without_a_bone_that_counts(rng):
    targets, lengths, movable = chain(rng, 6, 0.05)
    nowhere = np.zeros_like(movable)
    points, errors = project_to_bone_lengths(targets, nowhere, ~nowhere, CHAIN, lengths)
    assert np.array_equal(points, targets)
    assert not errors.any()
    points, _ = project_to_bone_lengths(targets, movable, nowhere, CHAIN[:1], lengths[:1])
    assert np.array_equal(points, targets)


def test_tied_points_are_the_movable_points_on_a_bone_with_a_known_or_movable_end():
    movable = np.array([[True, False, False, True], [False, True, True, False], [True, True, False, True]])
    anchored = np.array([[False, True, False, False], [False, False, False, False], [False, False, False, True]])
    expected = [[True, False, False, False], [False, True, True, False], [True, True, False, False]]
    assert np.array_equal(tied_points(movable, CHAIN, anchored & ~movable), expected)
