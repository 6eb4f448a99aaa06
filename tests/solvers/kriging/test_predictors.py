from mocapclean.solvers.kriging.predictors import PREDICTORS, applicable


def test_many_neighbours_allow_all_predictors():
    assert applicable(30, True) == list(PREDICTORS)
    assert not any(predictor.hinged for predictor in applicable(30, False))


def test_few_neighbours_allow_each_distinct_predictor_once():
    predictors = applicable(4, False)
    limited = {(min(p.n_framing, 4), min(p.n_features, 4), p.hinged, p.n_poses) for p in predictors}
    assert len(limited) == len(predictors)
    assert [predictor.n_framing for predictor in applicable(2, False)] == [0]
    assert applicable(0, False) == []
