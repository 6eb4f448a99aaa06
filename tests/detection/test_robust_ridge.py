"""Robust ridge regressions of several markers at once, against the same written out for one."""

import numpy as np

from mocapclean.detection.robust_ridge import Rows, Sample, gcv_penalties, regress, ridge_slopes


def test_the_penalty_has_the_least_score_of_generalised_cross_validation(rng):
    inputs, targets = rng.normal(size=(60, 5)), rng.normal(size=(60, 3))
    targets += inputs @ rng.normal(size=(5, 3))
    gram, moment = inputs.T @ inputs, inputs.T @ targets
    largest = np.linalg.eigvalsh(gram)[-1]
    scores = {}
    for share in np.logspace(-6, 1, 15):
        hat = inputs @ np.linalg.solve(gram + share * largest * np.eye(5), inputs.T)
        freedom = np.trace(hat)
        if freedom < 0.95 * 6:
            scores[share * largest] = ((targets - hat @ targets) ** 2).sum() / max(1 - freedom / 6, 0.05) ** 2
    rows = Rows.of([np.arange(60)])
    penalties = gcv_penalties(gram[None], moment[None], np.array([(targets**2).sum()]), rows)
    np.testing.assert_allclose(penalties[0], min(scores, key=scores.get), rtol=1e-9)
    expected = np.linalg.solve(gram + penalties[0] * np.eye(5), moment)
    np.testing.assert_allclose(ridge_slopes(gram[None], moment[None], penalties)[0], expected, rtol=1e-9)


def test_constant_inputs_predict_the_mean(rng):
    inputs, targets = np.full((1, 4, 50), 0.1), rng.normal(size=(1, 3, 50))
    fit = regress(Sample.of(inputs, targets, Rows.of([np.arange(50)])))
    assert np.isfinite(fit.slopes).all()
    np.testing.assert_allclose(fit.predict(inputs), np.broadcast_to(fit.target_mean, (1, 3, 50)), atol=1e-9)


def test_outlying_rows_get_small_weights(rng):
    inputs, truth = rng.normal(size=(1, 4, 200)), rng.normal(size=(3, 4))
    targets = truth @ inputs + 2.0
    targets[0, :, ::10] += 500.0 * rng.normal(size=(3, 20))
    fit = regress(Sample.of(inputs, targets, Rows.of([np.arange(200)])))
    np.testing.assert_allclose(fit.slopes[0], truth, atol=0.05)
    np.testing.assert_allclose(fit.predict(np.zeros((1, 4, 1)))[0, :, 0], 2.0, atol=0.1)
