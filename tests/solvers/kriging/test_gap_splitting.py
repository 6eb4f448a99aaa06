import numpy as np

from mocapclean.solvers.kriging.gap_splitting import split_gap


def test_a_gap_is_split_where_its_heavy_neighbours_go():
    known = np.ones((300, 6), dtype=bool)
    known[100:200, 1] = False
    known[150:200, [0, 2, 3]] = False
    weights = np.array([4.0, 0.0, 3.0, 2.0, 1.0, 0.5])
    assert split_gap(known, weights, 100, 200) == [(100, 150), (150, 200)]


def test_a_gap_is_whole_while_half_of_the_weight_stays():
    known = np.ones((300, 6), dtype=bool)
    known[100:200, 1] = False
    known[150:200, 4] = False
    weights = np.array([4.0, 0.0, 3.0, 2.0, 1.0, 0.5])
    assert split_gap(known, weights, 100, 200) == [(100, 200)]
