import numpy as np

from mocapclean.solvers.kriging.radial_basis import nearness


def test_a_pose_is_nearest_to_itself(rng):
    features = rng.normal(size=(50, 6)) * 30
    found = nearness(features, 20, 20)
    assert found.shape == (50, 20)
    assert np.all(found[:20].argmax(axis=0) == np.arange(20))
    assert np.allclose(np.diag(found), found.max())


def test_units_scale_the_answer_and_turns_do_not_change_it(rng):
    features = rng.normal(size=(40, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    once = nearness(features, 30, 8)
    assert np.allclose(nearness(1000.0 * features @ turn + 5.0, 30, 8), 1000.0 * once)


def test_poses_that_do_not_differ_tell_nothing():
    assert np.all(nearness(np.ones((10, 6)), 5, 20) == 0.0)
    assert nearness(np.ones((10, 6)), 5, 20).shape == (10, 5)
