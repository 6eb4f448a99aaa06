import numpy as np
import pytest

from mocapclean.solvers.kriging.regression_kriging import Bridges, Layout, Operators, krige, spread_out, window_offsets

RATE = 120.0


def layout(n_frames: int = 600, start: int = 300, length: int = 30, *, after: bool = True) -> Layout:
    known = np.delete(np.arange(n_frames), np.s_[start : start + length if after else n_frames])
    inside, beside = window_offsets(length, RATE, True, after, 10)
    starts = np.array([60, 120, 180, 240] if not after else [60, 120, 180, 400, 460, 520])
    frames = starts[:, None] + np.append(inside, beside)
    return Layout(
        learnt=known,
        windows=frames,
        inside=inside,
        beside=beside,
        beside_known=np.isin(frames, known)[:, len(inside) :],
        sides=known[(known >= start - 40) & (known < start + length + 40)],
        gap=np.arange(start, start + length),
    )


def answer(features: np.ndarray, target: np.ndarray, plan: Layout):
    hidden = target[plan.frames].copy()
    hidden[plan.parts[3]] = np.nan
    return krige(features[plan.frames], hidden, plan, Bridges(plan, Operators(RATE)), plan.hidden(3), 1e-4)


def test_what_neighbours_tell_is_told(rng):
    features = np.cumsum(rng.normal(size=(600, 6)), axis=0)
    target = features @ rng.normal(size=(6, 3)) + 5.0
    plan = layout()
    found = answer(features, target, plan)
    assert np.abs(found.values - target[plan.gap]).max() < 0.05
    assert np.sqrt(np.mean(found.misses**2)) < 0.05


def test_what_neighbours_do_not_tell_is_bridged(rng):
    t = np.arange(600) / RATE
    target = 30 * np.stack([np.sin(3 * t), np.cos(4 * t), np.sin(5 * t)], axis=1)
    plan = layout()
    found = answer(rng.normal(size=(600, 4)), target, plan)
    assert np.abs(found.values - target[plan.gap]).max() < 1.5


def test_the_windows_tell_the_error_of_the_gap(rng):
    ratios = []
    for _ in range(20):
        features = np.cumsum(rng.normal(size=(600, 3)), axis=0)
        noise = np.cumsum(rng.normal(size=(600, 3)), axis=0)
        target = features @ rng.normal(size=(3, 3)) + noise
        plan = layout()
        found = answer(features, target, plan)
        ratios.append(np.mean((found.values - target[plan.gap]) ** 2) / np.mean(found.misses**2))
    assert 0.5 < np.median(ratios) < 2.0


def test_a_gap_at_the_end_is_bridged_from_one_side(rng):
    features = np.cumsum(rng.normal(size=(600, 4)), axis=0)
    target = features @ rng.normal(size=(4, 3))
    plan = layout(start=570, after=False)
    found = answer(features, target, plan)
    assert found.values.shape == (30, 3)
    assert found.shape[-1] > found.shape[0]


@pytest.mark.parametrize("length", [1, 2, 7, 200])
def test_window_offsets(length):
    inside, beside = window_offsets(length, RATE, True, True, 10)
    assert inside[0] == 0
    assert inside[-1] == length - 1
    assert len(inside) == min(length, 10)
    assert ((beside < 0) | (beside >= length)).all()
    assert {-1, length} <= set(beside.tolist())


def test_spread_out_keeps_the_distance():
    kept = spread_out(np.arange(100), 12, 20)
    assert (np.diff(kept) >= 20).all()
    assert kept[0] == 0
    assert not len(spread_out(np.zeros(0, dtype=int), 5, 1))
