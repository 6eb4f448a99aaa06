import numpy as np

from mocapclean.geometry.distances import exact_pairs, mean_distances


def test_exact_pairs_are_computed_points_and_not_the_joints_of_a_skeleton(rng):
    measured = np.cumsum(rng.normal(size=(300, 4, 3)), axis=0)
    computed = measured[:, [2]] + [10.0, 20, 30]
    points = np.concatenate([measured, computed], axis=1)
    _, deviation = mean_distances(points, np.ones((300, 5), bool), 300)
    pairs = exact_pairs(deviation, 0.01)
    assert np.argwhere(pairs).tolist() == [[2, 4], [4, 2]]
    # Where every point has an exact partner nothing is measured, and a point that is never seen does not change that.
    only, trusted = points[:, [2, 4, 0]], np.ones((300, 3), bool)
    trusted[:, 2] = False
    _, deviation = mean_distances(only, trusted, 300)
    assert not exact_pairs(deviation, 0.01).any()
