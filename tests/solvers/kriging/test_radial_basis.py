import numpy as np

from mocapclean.solvers.kriging.radial_basis import pose_nearness


def test_a_pose_is_nearest_to_itself(rng):
    features = rng.normal(size=(50, 6)) * 30
    nearness = pose_nearness(features, 20, 20)
    assert nearness.shape == (50, 20)
    assert np.all(nearness[:20].argmax(axis=0) == np.arange(20))
    assert np.allclose(np.diag(nearness), nearness.max())


def test_units_scale_the_features_and_rotations_do_not_change_them(rng):
    features = rng.normal(size=(40, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    once = pose_nearness(features, 30, 8)
    assert np.allclose(pose_nearness(1000.0 * features @ turn + 5.0, 30, 8), 1000.0 * once)


def test_poses_that_do_not_differ_have_no_nearness():
    assert np.all(pose_nearness(np.ones((10, 6)), 5, 20) == 0.0)
    assert pose_nearness(np.ones((10, 6)), 5, 20).shape == (10, 5)
