"""Windows cover all frames, and the mean over them gives back what was cut."""

import pytest

from mocapclean.numerics import windows


@pytest.mark.parametrize(("n_frames", "length", "stride"), [(30, 7, 1), (30, 7, 4), (30, 7, 20), (7, 7, 3)])
def test_cut_and_mean_are_inverse_where_covered(rng, n_frames, length, stride):
    frames, first = rng.normal(size=(n_frames, 5)), windows.starts(n_frames, length, stride)
    rows = windows.cut(frames, first, length)
    assert rows.shape == (len(first), 5 * length)
    assert rows[-1] == pytest.approx(frames[-length:].ravel())
    mean, covered = windows.overlap_mean(rows, first, n_frames, length)
    assert covered.all() == (stride <= length)
    assert mean[covered] == pytest.approx(frames[covered])


def test_every_start_is_taken():
    assert windows.starts(10, 4).tolist() == list(range(7))
    assert windows.starts(10, 4, 4).tolist() == [0, 4, 6]
