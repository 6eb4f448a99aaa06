from mocapclean.solvers.kriging.predictors import (
    IN_LONG_SEGMENTS,
    IN_SHORT_SEGMENTS,
    LONG_SEGMENT,
    PREDICTORS,
    applicable,
)

SHORT = 0.5 * LONG_SEGMENT


def test_many_neighbours_allow_all_predictors_of_the_length():
    assert applicable(30, True, SHORT) == [*PREDICTORS, *IN_SHORT_SEGMENTS]
    assert applicable(30, True, LONG_SEGMENT) == [*PREDICTORS, *IN_LONG_SEGMENTS]
    assert not any(predictor.hinged for predictor in applicable(30, False, SHORT))


def test_few_neighbours_allow_each_distinct_predictor_once():
    for seconds in (SHORT, LONG_SEGMENT):
        predictors = applicable(4, False, seconds)
        limited = {(min(p.n_framing, 4), min(p.n_features, 4), p.hinged, p.n_poses, p.moving) for p in predictors}
        assert len(limited) == len(predictors)
        assert [predictor.n_framing for predictor in applicable(2, False, seconds)] == [0]
        assert applicable(0, False, seconds) == []
