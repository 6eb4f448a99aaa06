"""Exchanged labels: all are found and undone to the last bit, and none in takes without them."""

import numpy as np
import pytest

from mocapclean.detection.exchanges import exchange, exchanges
from mocapclean.geometry.distances import rigidity
from mocapclean.simulate import perform


@pytest.fixture(scope="module")
def walk():
    return perform("walk", 4.0, 120.0, 1).markers


def swapped(take, a, b, *spans):
    positions = take.positions.copy()
    for start, stop in spans:
        positions[start:stop, [a, b]] = positions[start:stop, [b, a]]
    return positions


def find(take, positions, trusted=None):
    trusted = take.trusted if trusted is None else trusted
    known = np.where(trusted[..., None], positions, np.nan)
    return exchanges(known, rigidity(positions, trusted), take.rate)


def test_nothing_is_exchanged_in_a_clean_take(walk):
    assert find(walk, walk.positions) == ()


@pytest.mark.parametrize("spans", [[(100, 105)], [(50, 160)], [(50, 90), (200, 300)], [(0, 80)], [(400, 480)]])
@pytest.mark.parametrize("names", [("LFHD", "RFHD"), ("LANK", "LTOE"), ("RWRA", "LKNE")])
def test_exchanges_are_found_and_put_back(walk, spans, names):
    a, b = (walk.markers.index(name) for name in names)
    positions = swapped(walk, a, b, *spans)
    pairs = find(walk, positions)
    assert [(pair.first, pair.second) for pair in pairs] == [(min(a, b), max(a, b))]
    expected = np.zeros(len(positions), bool)
    for start, stop in spans:
        expected[start:stop] = True
    np.testing.assert_array_equal(pairs[0].frames, expected)
    assert pairs[0].after < pairs[0].before
    np.testing.assert_array_equal(exchange(positions, pairs), walk.positions)


def test_a_jump_of_two_markers_at_once_is_no_exchange(walk):
    positions = walk.positions.copy()
    for name, offset in (("LANK", 150.0), ("LTOE", -130.0)):
        positions[100:150, walk.markers.index(name)] += offset
    assert find(walk, positions) == ()


def test_a_gap_within_is_passed_over(walk):
    a, b = walk.markers.index("LFHD"), walk.markers.index("RFHD")
    positions, trusted = swapped(walk, a, b, (100, 200)), walk.trusted.copy()
    trusted[140:150, a] = False
    (pair,) = find(walk, positions, trusted)
    np.testing.assert_array_equal(np.flatnonzero(pair.frames), np.r_[100:140, 150:200])
