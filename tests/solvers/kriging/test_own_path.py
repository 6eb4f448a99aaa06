"""What rests stays, what flies flies on, and neighbours that predict better are used."""

import numpy as np
import pytest

from mocapclean.simulate import hide
from mocapclean.solvers.kriging import Params
from mocapclean.solvers.kriging.rest import Rest, noise_of
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take

RATE, NOISE = 100.0, 0.2
CORNERS = np.array([[1500.0, 800, 50], [1650, 800, 50], [1500, 950, 50], [1575, 875, 120]])


def walker(n_frames: int, rng: np.random.Generator, speed: float = 1200.0) -> np.ndarray:
    """(F, 10, 3) mm: a trunk of five markers that travels and sways, and an arm of five that swings on it."""
    t = np.arange(n_frames) / RATE
    trunk = np.stack([30 * np.sin(6 * t), speed * t, 950 + 20 * np.sin(12 * t)], axis=1)
    arm = trunk + 300 * np.stack([np.sin(0.5 * np.sin(6 * t)), 0 * t, -np.cos(0.5 * np.sin(6 * t))], axis=1)
    shape = rng.normal(size=(5, 3)) * 80
    return np.concatenate([trunk[:, None] + shape, arm[:, None] + shape], axis=1)


def beside(rng: np.random.Generator, props: np.ndarray, **options: float) -> Take:
    """The walker with props (F, n, 3) beside him, everything with noise."""
    positions = np.concatenate([walker(len(props), rng, **options), props], axis=1)
    positions = positions + NOISE * rng.normal(size=positions.shape)
    names = tuple(f"m{k}" for k in range(positions.shape[1]))
    return Take(positions=positions, trusted=np.ones(positions.shape[:2], bool), markers=names, rate=RATE)


def filled(take: Take, props: list[int], start: int, stop: int) -> tuple[Solution, np.ndarray, np.ndarray]:
    """The solution with some props (by number) hidden, its errors (n, 3), and its sd (n,)."""
    missing = np.zeros_like(take.trusted)
    missing[start:stop, [10 + k for k in props]] = True
    solution = run_method("kriging", hide(take, missing), Params())
    assert solution.filled[missing].all()
    return solution, (solution.positions - take.positions)[missing], solution.sd[missing]


@pytest.mark.parametrize("n_frames", [150, 600])
@pytest.mark.parametrize("span", [(0.0, 0.25), (0.4, 0.7), (0.8, 1.0)])
def test_a_box_at_rest_stays_where_it_is(rng, n_frames, span):
    take = beside(rng, np.repeat(CORNERS[None], n_frames, axis=0))
    _, errors, sd = filled(take, [0, 1, 2, 3], *(int(share * n_frames) for share in span))
    # The hidden samples have noise of their own, and the fill meets the noisy samples beside it.
    assert np.sqrt(np.square(errors).mean()) < 2.5 * NOISE
    assert np.abs(errors).max() < 8 * NOISE
    assert (np.abs(errors) <= 1.645 * sd[:, None]).mean() > 0.8


def carried(n_frames: int, at: int) -> np.ndarray:
    """(F, 4, 3) mm: the box at rest, and in a third of a second from ``at`` on carried to another place."""
    share = np.clip((np.arange(n_frames) - at) / (RATE / 3), 0, 1)
    share = share**2 * (3 - 2 * share)
    offset = share[:, None] * [300.0, 200, 0] + np.sin(np.pi * share)[:, None] * [0.0, 0, 150]
    return CORNERS + offset[:, None]


def test_a_cup_that_is_moved_once_rests_before_and_after(rng):
    take = beside(rng, carried(500, 250))
    for start, stop in ((60, 110), (400, 450), (460, 500)):
        _, errors, sd = filled(take, [0, 1, 2, 3], start, stop)
        assert np.abs(errors).max() < 6 * NOISE
        # At the end of the take it may have been moved again, as one window has it.
        assert stop == 500 or np.sqrt(np.square(sd).mean()) < 3 * NOISE


def test_one_marker_of_a_cup_follows_the_others_through_the_move(rng):
    _, errors, _ = filled(beside(rng, carried(500, 250)), [0], 240, 300)
    assert np.abs(errors).max() < 15.0


def test_a_move_inside_the_gap_makes_the_error_bar_as_large(rng):
    _, errors, sd = filled(beside(rng, carried(500, 250)), [0, 1, 2, 3], 240, 300)
    assert (np.abs(errors) <= 1.645 * sd[:, None]).mean() > 0.85
    assert np.sqrt(3 * np.square(sd).mean()) > 30.0


def test_a_ball_at_rest_until_its_throw_stays_until_then(rng):
    t = np.maximum(np.arange(500) - 300, 0) / RATE
    ball = CORNERS[0] + np.stack([1500 * t, 800 * t, 3000 * t - 4905 * t**2], axis=1)
    take = beside(rng, ball[:, None])
    for span in ((100, 150), (255, 298)):
        assert np.abs(filled(take, [0], *span)[1]).max() < 6 * NOISE
    # In flight its own path leads it on.
    assert np.abs(filled(take, [0], 360, 375)[1]).max() < 10.0


def test_a_hand_that_comes_back_to_its_place_follows_its_arm(rng):
    # A punch from rest and back within the gap: the rest of the arm is seen.
    t = np.arange(600) / RATE
    out = sum(np.exp(-0.5 * ((t - at) / 0.08) ** 2) for at in (1.0, 2.0, 3.0, 4.0, 5.0))
    hand = CORNERS + (250.0 * out[:, None] * [1.0, 0.2, 0.1])[:, None]
    _, errors, _ = filled(beside(rng, hand, speed=0.0), [0], 260, 340)
    assert np.abs(errors).max() < 5.0


def test_where_nobody_else_is_seen_a_gap_follows_its_own_path():
    t = np.arange(400) / RATE
    track = np.stack([300 * np.sin(2 * t), 200 * np.cos(3 * t), 50 * t], axis=1)
    positions = np.stack([track, track[::-1] + 500.0], axis=1)
    take = Take(positions=positions, trusted=np.ones((400, 2), bool), markers=("a", "b"), rate=RATE)
    missing = np.zeros((400, 2), dtype=bool)
    missing[200:212, 0] = missing[:100, 1] = True
    solution = run_method("kriging", hide(take, missing), Params())
    assert solution.filled[missing].all()
    assert np.abs(solution.positions - positions)[200:212, 0].max() < 1.0


def test_rest_is_told_on_each_side_and_at_one_place(rng):
    track = np.zeros((200, 3))
    track[100:120, 0] = np.linspace(0, 300, 20)
    track[120:, 0] = 300.0
    track += 0.1 * rng.normal(size=track.shape)
    known = np.ones(200, dtype=bool)
    rest = Rest(track, known, 120.0, 2.0)
    starts, length, edges = np.array([20, 90, 108, 150]), 14, (5, 5)
    # At rest on both sides at one place; before only; after only; on both sides at one place.
    assert rest.kinds(starts, length, edges).tolist() == [0b111, 0b001, 0b010, 0b111]
    for start, kind in zip(starts, rest.kinds(starts, length, edges), strict=True):
        before, after = track[start - 5 : start][::-1], track[start + length : start + length + 5]
        assert rest.kind(before, after) == kind
    # At rest on both sides, and at two places.
    assert rest.kinds(np.array([95]), 30, edges).tolist() == [0b011]
    assert noise_of(track, known) == pytest.approx(0.1, rel=0.2)
