from mocapclean.solvers.kriging.predictors import (
    IN_LONG_SEGMENTS,
    IN_SHORT_SEGMENTS,
    PREDICTORS,
    applicable,
)


def test_many_neighbours_allow_all_predictors_of_the_length():
    assert applicable(30, True, is_long=False) == [*PREDICTORS, *IN_SHORT_SEGMENTS]
    assert applicable(30, True, is_long=True) == [*PREDICTORS, *IN_LONG_SEGMENTS]
    assert not any(predictor.hinged for predictor in applicable(30, False, is_long=False))


def test_few_neighbours_allow_each_distinct_predictor_once():
    for is_long in (False, True):
        predictors = applicable(4, False, is_long=is_long)
        limited = {(min(p.n_framing, 4), min(p.n_features, 4), p.hinged, p.n_poses, p.moving) for p in predictors}
        assert len(limited) == len(predictors)
        assert [predictor.n_framing for predictor in applicable(2, False, is_long=is_long)] == [0]
        assert applicable(0, False, is_long=is_long) == []
