from mocapclean.solvers.kriging.predictors import PREDICTORS, applicable


def test_many_neighbours_allow_all_predictors():
    assert applicable(30, True) == list(PREDICTORS)
    assert not any(predictor.hinged for predictor in applicable(30, False))


def test_few_neighbours_allow_each_distinct_predictor_once():
    predictors = applicable(4, False)
    assert len(set(predictors)) == len(predictors)
    assert max(predictor.n_features for predictor in predictors) == 4
    assert [predictor.n_framing for predictor in applicable(2, False)] == [0]
