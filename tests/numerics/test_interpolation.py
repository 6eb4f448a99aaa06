"""Interpolation and the masks of what may be filled, on takes small enough to work out by hand."""

import numpy as np

from mocapclean.numerics.interpolation import linear, monotone
from mocapclean.solvers.fillable import enclosed, fillable

NAN = np.nan


def one_marker(*values: float) -> tuple[np.ndarray, np.ndarray]:
    """A marker (F, 1, 3) that runs on x, twice on y, and rests on z; NaN is untrusted."""
    x = np.array(values)
    return np.stack([x, 2 * x, 0 * x + 5], axis=1)[:, None], np.isfinite(x)[:, None]


def test_linear_joins_the_sides_and_holds_the_ends():
    filled = linear(*one_marker(NAN, 1, NAN, NAN, 7, NAN))
    np.testing.assert_allclose(filled[:, 0, 0], [1, 1, 3, 5, 7, 7])
    np.testing.assert_allclose(filled[:, 0, 1], [2, 2, 6, 10, 14, 14])
    np.testing.assert_allclose(filled[:, 0, 2], 5)


def test_monotone_follows_a_line_and_a_curve_without_overshoot():
    filled = monotone(*one_marker(NAN, 0, 1, NAN, NAN, 4, 5, NAN))
    np.testing.assert_allclose(filled[1:7, 0, 0], np.arange(6), atol=1e-12)
    assert filled[0, 0, 0] == filled[7, 0, 0] == 0
    flat = monotone(*one_marker(0, 0, NAN, NAN, NAN, 10, 10))[:, 0, 0]
    assert (np.diff(flat) >= 0).all()
    assert flat.max() <= 10
    np.testing.assert_allclose(flat[2:5], [10 * u * u * (3 - 2 * u) for u in (0.25, 0.5, 0.75)])


def test_monotone_needs_two_samples_and_reads_no_others():
    assert not monotone(*one_marker(NAN, NAN, NAN)).any()
    lone = monotone(*one_marker(NAN, 3, NAN))[:, 0, 0]
    np.testing.assert_allclose(lone, [0, 3, 0])


def test_fillable_and_enclosed():
    trusted = np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0], [1, 1, 0], [0, 1, 0]], dtype=bool)
    assert fillable(trusted).astype(int).tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]]
    assert enclosed(trusted).astype(int).tolist() == [[0, 0, 0], [0, 1, 0], [1, 1, 0], [1, 0, 0], [0, 0, 0], [0, 0, 0]]
