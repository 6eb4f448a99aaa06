"""The difference operators and the banded systems, each against its dense matrix."""

import numpy as np
import pytest

from mocapclean.numerics.low_rank.differences import FreeSystem, add_adjoint, difference, normal_bands, times_bands


def dense(n_frames: int, keep_end: bool) -> np.ndarray:
    return difference(np.eye(n_frames), keep_end=keep_end)


@pytest.mark.parametrize("n_frames", [0, 1, 2, 3, 7])
@pytest.mark.parametrize("keep_end", [False, True])
def test_difference_and_its_adjoint(rng, n_frames, keep_end):
    matrix = dense(n_frames, keep_end)
    expected = np.eye(n_frames) - np.eye(n_frames, k=1)
    assert np.array_equal(matrix, expected if keep_end else expected[: max(n_frames - 1, 0)])
    target, rows = rng.normal(size=(n_frames, 4)), rng.normal(size=(len(matrix), 4))
    summed = target + matrix.T @ rows
    add_adjoint(target, rows, keep_end=keep_end)
    np.testing.assert_allclose(target, summed, atol=1e-14)


@pytest.mark.parametrize("n_frames", [1, 2, 3, 4, 9])
@pytest.mark.parametrize("keep_end", [False, True])
def test_normal_bands(rng, n_frames, keep_end):
    first = dense(n_frames, False)
    second = difference(first, keep_end=keep_end)
    H = 1.5 * np.eye(n_frames) + 0.7 * first.T @ first + 0.4 * second.T @ second
    bands = normal_bands(n_frames, 1.5, 0.7, 0.4, keep_end=keep_end)
    for k in range(min(3, n_frames)):
        np.testing.assert_allclose(bands[k, : n_frames - k], np.diag(H, -k), atol=1e-14)
    values = rng.normal(size=(n_frames, 5))
    np.testing.assert_allclose(times_bands(bands, values), H @ values, atol=1e-13)


@pytest.mark.parametrize("n_frames", [1, 2, 5, 30])
@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_free_system_solves_marker_by_marker(rng, n_frames, share):
    free = rng.random((n_frames, 6)) < share
    free[:, 0], free[:, 1] = True, False
    bands = normal_bands(n_frames, 2.0, 1.0, 3.0)
    H = sum(np.diag(bands[k, : n_frames - k], -k) for k in range(min(3, n_frames)))
    H = H + np.tril(H, -1).T
    right = rng.normal(size=(n_frames, 6, 3))
    system = FreeSystem(bands, free)
    solution = np.full((n_frames * 6, 3), np.nan)
    solution[system.places] = system.solve(right.reshape(-1, 3)[system.places])
    solution = solution.reshape(n_frames, 6, 3)
    assert np.array_equal(np.isfinite(solution[..., 0]), free)
    for marker in range(6):
        u = np.flatnonzero(free[:, marker])
        np.testing.assert_allclose(solution[u, marker], np.linalg.solve(H[np.ix_(u, u)], right[u, marker]), atol=1e-12)


def test_free_system_needs_a_positive_definite_matrix():
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        FreeSystem(normal_bands(4, -1.0, 0.0, 0.0), np.ones((4, 1), dtype=bool))
