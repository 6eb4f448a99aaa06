from dataclasses import replace

import numpy as np

from mocapclean.solvers.kriging.bridging import BridgeWeights, PlanBridges
from mocapclean.solvers.kriging.frame_selection import window_offsets
from mocapclean.solvers.kriging.regression_kriging import KrigingResult, krige
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan
from mocapclean.solvers.kriging.segment_batch import batch_frames, batch_of

RATE = 120.0


def plan_of(n_frames: int = 600, start: int = 300, length: int = 30, *, after: bool = True) -> SamplingPlan:
    known = np.delete(np.arange(n_frames), np.s_[start : start + length if after else n_frames])
    inside, adjacent = window_offsets(length, RATE, True, after)
    starts = np.array([60, 120, 180, 240] if not after else [60, 120, 180, 400, 460, 520])
    frames = starts[:, None] + np.append(inside, adjacent)
    return SamplingPlan(
        training=known,
        windows=frames,
        inside=inside,
        adjacent=adjacent,
        adjacent_known=np.isin(frames, known)[:, len(inside) :],
        gap_adjacent=known[(known >= start - 40) & (known < start + length + 40)],
        gap=np.arange(start, start + length),
    )


def kriged(features: np.ndarray, target: np.ndarray, plan: SamplingPlan):
    return kriged_together([features], [target], [plan])[0]


def kriged_together(features: list[np.ndarray], targets: list[np.ndarray], plans: list[SamplingPlan]):
    """The results of several segments of one batch."""
    frames = batch_frames(plans)
    values = np.stack([target[rows] for target, rows in zip(targets, frames, strict=True)])
    bridges = [PlanBridges(plan, BridgeWeights(RATE)) for plan in plans]
    batch = batch_of(plans, bridges, values, 3)
    values[:, batch.gap] = np.nan
    inputs = np.stack([of_one[rows] for of_one, rows in zip(features, frames, strict=True)])
    found = krige(inputs, values, batch, inputs.shape[2], 1e-4)
    return [
        KrigingResult(
            found.positions[k, : len(plan.gap)],
            found.window_errors[k, : len(plan.windows)],
            found.gap_variance[k, : len(plan.gap)],
            found.window_variance[k],
        )
        for k, plan in enumerate(plans)
    ]


def test_a_linear_function_of_the_features_is_predicted(rng):
    features = np.cumsum(rng.normal(size=(600, 6)), axis=0)
    target = features @ rng.normal(size=(6, 3)) + 5.0
    plan = plan_of()
    result = kriged(features, target, plan)
    assert np.abs(result.positions - target[plan.gap]).max() < 0.05
    assert np.sqrt(np.mean(result.window_errors**2)) < 0.05


def test_smooth_motion_that_the_features_do_not_predict_is_bridged(rng):
    t = np.arange(600) / RATE
    target = 30 * np.stack([np.sin(3 * t), np.cos(4 * t), np.sin(5 * t)], axis=1)
    plan = plan_of()
    result = kriged(rng.normal(size=(600, 4)), target, plan)
    assert np.abs(result.positions - target[plan.gap]).max() < 1.5


def test_the_error_in_windows_is_that_in_the_gap(rng):
    ratios = []
    for _ in range(20):
        features = np.cumsum(rng.normal(size=(600, 3)), axis=0)
        noise = np.cumsum(rng.normal(size=(600, 3)), axis=0)
        target = features @ rng.normal(size=(3, 3)) + noise
        plan = plan_of()
        result = kriged(features, target, plan)
        ratios.append(np.mean((result.positions - target[plan.gap]) ** 2) / np.mean(result.window_errors**2))
    assert 0.5 < np.median(ratios) < 2.0


def test_a_gap_at_the_end_is_bridged_from_one_side(rng):
    features = np.cumsum(rng.normal(size=(600, 4)), axis=0)
    target = features @ rng.normal(size=(4, 3))
    plan = plan_of(start=570, after=False)
    result = kriged(features, target, plan)
    assert result.positions.shape == (30, 3)
    assert result.gap_variance[-1] > result.gap_variance[0]


def test_a_segment_has_the_same_answer_whatever_else_is_in_its_batch(rng):
    features = [np.cumsum(rng.normal(size=(600, 4)), axis=0) for _ in range(3)]
    targets = [of_one @ rng.normal(size=(4, 3)) + rng.normal(size=(600, 3)) for of_one in features]
    # Fewer frames to learn from, fewer windows, a shorter gap
    plans = [plan_of(), plan_of(n_frames=560), plan_of(length=20)]
    plans[1] = replace(plans[1], windows=plans[1].windows[:4], adjacent_known=plans[1].adjacent_known[:4])
    together = kriged_together(features, targets, plans)
    for of_one, target, plan, result in zip(features, targets, plans, together, strict=True):
        alone = kriged(of_one, target, plan)
        for field in ("positions", "window_errors", "gap_variance", "window_variance"):
            assert np.allclose(getattr(result, field), getattr(alone, field), rtol=1e-9, atol=1e-9)
