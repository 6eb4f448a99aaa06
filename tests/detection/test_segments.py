"""Segments of a path, and the best chain of them against every chain, one by one."""

from itertools import combinations

import numpy as np
import pytest

from mocapclean.detection.segments import SegmentEnds, best_chain, cut_segments


def test_segments_end_at_cuts_and_at_invalid_frames():
    valid = np.array([1, 1, 1, 0, 1, 1, 1, 1], dtype=bool)
    cuts = np.array([1, 0, 1, 0, 1, 0, 0, 1], dtype=bool)
    assert cut_segments(valid, cuts).tolist() == [[0, 2], [2, 3], [4, 7], [7, 8]]


def test_a_straight_path_is_predicted_by_both_of_its_ends(rng):
    path = rng.normal(size=3) + np.arange(20)[:, None] * rng.normal(size=3)
    segments = np.array([[0, 5], [6, 7], [12, 20]])
    _, forward, backward = SegmentEnds.of(path, segments).misses(np.array([2, 2]), np.array([0, 1]), np.array([8, 6]))
    np.testing.assert_allclose(forward[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(backward, 0.0, atol=1e-12)
    np.testing.assert_allclose(forward[1], np.linalg.norm(path[12] - path[6]))


def value(chain, segments, links, end):
    """Return the length of a chain of segments less the costs of its links and ends."""
    lengths = sum(int(segments[i, 1] - segments[i, 0]) for i in chain)
    ends = (chain[0] > 0) + (chain[-1] < len(segments) - 1)
    return lengths - sum(links[i, j] for i, j in zip(chain[1:], chain[:-1], strict=True)) - end * ends


@pytest.mark.parametrize("end", [0.0, 4.0])
@pytest.mark.parametrize("seed", range(20))
def test_the_chain_is_the_best_of_all(seed, end):
    rng = np.random.default_rng(seed)
    lengths = rng.integers(1, 12, size=7)
    stops = np.cumsum(lengths + rng.integers(0, 3, size=7))
    segments = np.column_stack([stops - lengths, stops])
    links = rng.choice([0.0, 3.0, 15.0, np.inf], size=(7, 7))
    chosen, cost = best_chain(segments, int(stops[-1]), lambda later, earlier: links[later, earlier], end)
    chains = [chain for size in range(1, 8) for chain in combinations(range(7), size)]
    best = max(value(chain, segments, links, end) for chain in chains)
    assert chosen.sum() - cost == best
    kept = tuple(i for i, (start, _) in enumerate(segments) if chosen[start])
    assert value(kept, segments, links, end) == best
    assert chosen.sum() == lengths[list(kept)].sum()
