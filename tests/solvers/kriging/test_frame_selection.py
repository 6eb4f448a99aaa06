import numpy as np
import pytest

from mocapclean.solvers.kriging.frame_selection import (
    adjacent_frames,
    spread_out,
    training_frames,
    window_offsets,
    window_starts,
)

RATE = 120.0


@pytest.mark.parametrize("length", [1, 2, 7, 200])
def test_window_offsets(length):
    inside, adjacent = window_offsets(length, RATE, True, True)
    assert inside[0] == 0
    assert inside[-1] == length - 1
    assert len(inside) == min(length, 6)
    assert ((adjacent < 0) | (adjacent >= length)).all()
    assert {-1, length} <= set(adjacent.tolist())


def test_spread_out_keeps_the_distance():
    kept = spread_out(np.arange(100), 12, 20)
    assert (np.diff(kept) >= 20).all()
    assert kept[0] == 0
    assert not len(spread_out(np.zeros(0, dtype=int), 5, 1))


def test_adjacent_frames_are_usable_and_nearest_first():
    usable = np.ones(100, dtype=bool)
    usable[40:60] = usable[38] = False
    before, after = adjacent_frames(usable, 40, 60, 10, RATE)
    assert before.tolist() == [39, 37, 36, 34, 31]
    assert after.tolist() == [60, 61, 62, 64, 67]
    assert not len(adjacent_frames(usable, 0, 60, 10, RATE)[0])


def test_complete_frames_are_preferred_for_training():
    known, missing_share = np.ones(200, dtype=bool), np.zeros(200)
    missing_share[:50] = 0.5
    frames, incomplete = training_frames(known, missing_share, 300)
    assert frames[0] == 50
    assert not incomplete
    missing_share[:150] = 0.5
    frames, incomplete = training_frames(known, missing_share, 300)
    assert len(frames) == 140
    assert incomplete


def test_windows_lie_where_the_marker_is_known():
    known = np.ones(400, dtype=bool)
    known[100:200] = False
    starts, length = window_starts(known, np.zeros(400), 40, 12, (5, 5), 400)
    assert length == 40
    assert all(known[start - 5 : start + 45].all() for start in starts)


def test_windows_are_shorter_where_none_fits():
    known = np.zeros(400, dtype=bool)
    known[:100] = True
    starts, length = window_starts(known, np.zeros(400), 200, 12, (5, 0), 400)
    assert length == 50
    assert len(starts) >= 3
    assert not len(window_starts(known, np.zeros(400), 40, 0, (5, 5), 400)[0])
