import numpy as np

from mocapclean.solvers.kriging.radial_basis import pose_nearness
from tests.solvers.kriging.batches import training_batch


def nearness_of(features: np.ndarray, n_training: int, n_poses: int) -> np.ndarray:
    """The features (N, k) of one segment."""
    return pose_nearness(features[None], training_batch([n_training]), n_poses)[0]


def test_a_pose_is_nearest_to_itself(rng):
    features = rng.normal(size=(50, 6)) * 30
    nearness = nearness_of(features, 20, 20)
    assert nearness.shape == (50, 20)
    assert np.all(nearness[:20].argmax(axis=0) == np.arange(20))
    assert np.allclose(np.diag(nearness), nearness.max())


def test_units_scale_the_features_and_rotations_do_not_change_them(rng):
    features = rng.normal(size=(40, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    once = nearness_of(features, 30, 8)
    assert np.allclose(nearness_of(1000.0 * features @ turn + 5.0, 30, 8), 1000.0 * once)


def test_poses_that_do_not_differ_have_no_nearness():
    assert np.all(nearness_of(np.ones((10, 6)), 5, 20) == 0.0)
    assert nearness_of(np.ones((10, 6)), 5, 20).shape == (10, 20)


def test_rows_that_are_not_in_use_are_not_read(rng):
    features = rng.normal(size=(2, 30, 4))
    batch = training_batch([20, 12])
    together = pose_nearness(features, batch, 5)
    assert np.allclose(together[1], nearness_of(features[1], 12, 5))
