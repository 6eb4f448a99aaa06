"""Ridge regressions of several markers at once against the same one by one, written out."""

import numpy as np

from mocapclean.detection.robust_ridge import Rows, penalty, regress, slopes


def test_the_penalty_has_the_least_score_of_generalised_cross_validation(rng):
    inputs, wanted = rng.normal(size=(60, 5)), rng.normal(size=(60, 3))
    wanted += inputs @ rng.normal(size=(5, 3))
    gram, moment = inputs.T @ inputs, inputs.T @ wanted
    largest = np.linalg.eigvalsh(gram)[-1]
    scores = {}
    for share in np.logspace(-6, 1, 15):
        hat = inputs @ np.linalg.solve(gram + share * largest * np.eye(5), inputs.T)
        freedom = np.trace(hat)
        if freedom < 0.95 * 6:
            scores[share * largest] = ((wanted - hat @ wanted) ** 2).sum() / max(1 - freedom / 6, 0.05) ** 2
    rows = Rows.of([np.arange(60)])
    found = penalty(gram[None], moment[None], np.array([(wanted**2).sum()]), rows)
    np.testing.assert_allclose(found[0], min(scores, key=scores.get), rtol=1e-9)
    expected = np.linalg.solve(gram + found[0] * np.eye(5), moment)
    np.testing.assert_allclose(slopes(gram[None], moment[None], found)[0], expected, rtol=1e-9)


def test_inputs_that_never_change_say_nothing(rng):
    inputs, wanted = np.full((1, 50, 4), 0.1), rng.normal(size=(1, 50, 3))
    fit = regress(inputs, wanted, Rows.of([np.arange(50)]))
    assert np.isfinite(fit.slopes).all()
    np.testing.assert_allclose(fit.at(inputs), np.broadcast_to(fit.middle, (1, 50, 3)), atol=1e-9)


def test_rows_that_nothing_explains_count_little(rng):
    inputs, truth = rng.normal(size=(1, 200, 4)), rng.normal(size=(4, 3))
    wanted = inputs @ truth + 2.0
    wanted[0, ::10] += 500.0 * rng.normal(size=(20, 3))
    fit = regress(inputs, wanted, Rows.of([np.arange(200)]))
    np.testing.assert_allclose(fit.slopes[0], truth, atol=0.05)
    np.testing.assert_allclose(fit.at(np.zeros((1, 1, 4)))[0, 0], 2.0, atol=0.1)
