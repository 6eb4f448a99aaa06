import numpy as np
import pytest

from mocapclean.solvers.kriging.matern import bridges, matern


def test_covariance_matrices_are_positive_definite():
    times = np.arange(40.0)
    own = matern(times[:, None] - times, 12.0)
    assert np.linalg.eigvalsh(own).min() > 0
    assert own[0, 0] == 1.0
    assert (np.diff(own[0]) < 0).all()


def test_a_bridge_is_the_gaussian_conditional():
    known, wanted = np.array([0, 1, 2, 9, 10]), np.arange(3, 9)
    everything = np.concatenate([known, wanted])
    joint = matern(everything[:, None] - everything, 7.0) + 0.01 * np.diag([1.0] * 5 + [0.0] * 6)
    precision = np.linalg.inv(joint)
    (_, weights), (_, variance) = (
        of_one[0] for of_one in bridges(known[None], wanted[None], np.array([90.0, 7.0]), np.array([0.5, 0.01]))
    )
    assert np.allclose(weights, -np.linalg.solve(precision[5:, 5:], precision[5:, :5]))
    assert np.allclose(variance, np.diag(np.linalg.inv(precision[5:, 5:])))


def test_a_bridge_joins_the_known_values_without_a_corner():
    known = np.array([*range(-30, 0), *range(20, 50)])
    wanted = np.arange(-1, 21)
    values = np.sin(known / 9)
    ((weights,),), _ = bridges(known[None], wanted[None], np.array([30.0]), np.array([1e-9]))
    filled = weights @ values
    assert filled[[0, -1]] == pytest.approx(np.sin(wanted[[0, -1]] / 9), abs=1e-4)
    assert np.diff(filled)[0] == pytest.approx(values[29] - values[28], abs=0.02)


def test_without_known_times_there_are_no_weights():
    weights, variance = bridges(np.zeros((1, 0), dtype=int), np.arange(3)[None], np.array([5.0]), np.array([0.0]))
    assert weights.shape == (1, 1, 3, 0)
    assert (variance == 1.0).all()
