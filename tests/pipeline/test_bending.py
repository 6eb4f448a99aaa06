"""Gaps are left where the answer makes a rigid pair worse, the fewest that are needed, and no others."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.pipeline.bending import bending
from mocapclean.take import Take

FRAMES = 200
GAPS = ((20, 40), (90, 110), (150, 170))


def pair(errors: tuple[float, ...], noise: float = 0.0) -> tuple[Take, Take]:
    """Return a take of a moving pair, 100 mm long, with three gaps in marker B, and it filled with these errors, mm."""
    time = np.arange(FRAMES)
    start = np.stack([3.0 * time, 100.0 * np.sin(time / 20.0), np.zeros(FRAMES)], axis=1)
    rng = np.random.default_rng(3)
    end = start + np.array([0.0, 0.0, 100.0]) + noise * rng.standard_normal((FRAMES, 1)) * np.array([0.0, 0.0, 1.0])
    positions = np.stack([start, end], axis=1)
    trusted = np.ones((FRAMES, 2), dtype=bool)
    after = positions.copy()
    for (first, stop), error in zip(GAPS, errors, strict=True):
        trusted[first:stop, 1] = False
        after[first:stop, 1, 2] += error
    take = Take(positions=positions, trusted=trusted, markers=("A", "B"), rate=100.0)
    return take, replace(take, positions=after, filled=~trusted)


def gaps_of(bent: np.ndarray) -> list[int]:
    """Return which of the three gaps are bent, all of their frames or none."""
    assert not bent[:, 0].any()
    spans = [bent[first:stop, 1] for first, stop in GAPS]
    assert all(span.all() or not span.any() for span in spans)
    assert sum(int(span.sum()) for span in spans) == bent.sum()
    return [k for k, span in enumerate(spans) if span.all()]


@pytest.mark.parametrize(
    ("errors", "noise", "expected"),
    [
        ((0.0, 0.0, 0.0), 0.0, []),
        # The RMS over 200 frames of 20 frames that are 15 mm off is 4.7 mm, of 20 mm 6.3 mm.
        ((15.0, 0.0, 0.0), 0.0, []),
        ((0.0, 20.0, 0.0), 0.0, [1]),
        # Only the worst gap has to go; the others stay.
        ((14.0, 40.0, 2.0), 0.0, [1]),
        ((60.0, 1.0, 40.0), 0.0, [0, 2]),
        # What is accepted rises with the deviation before.
        ((0.0, 20.0, 0.0), 2.5, []),
    ],
)
def test_the_fewest_gaps_are_left(errors: tuple[float, ...], noise: float, expected: list[int]) -> None:
    assert gaps_of(bending(*pair(errors, noise))) == expected


def test_a_pair_that_is_not_rigid_is_not_judged() -> None:
    before, after = pair((200.0, 0.0, 0.0), noise=20.0)
    assert not bending(before, after).any()
