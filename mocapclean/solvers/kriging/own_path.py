"""Prediction of a gap segment from the marker's own path in the world, without neighbours: it stays or moves on.

The first predictor is the straight line between the samples on both sides of the gap, or the last sample where there is
one side only. The second is universal kriging over time by several kernels (``drift_kriging``), weighted by their
likelihood in the windows. Both are tried on the same windows as the predictors that follow neighbours.
"""

from collections.abc import Callable, Iterator

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.bridging import PlanBridges
from mocapclean.solvers.kriging.drift_kriging import DriftKriging, Pattern
from mocapclean.solvers.kriging.regression_kriging import KrigingResult, likelihood_weights
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan

FLAT_SHARE = 0.5
"""Share of the variance of a straight line that does not vanish beside the samples, as their noise does not.

Chosen by hand; no sweep was kept.
"""

WeightsFor = Callable[[Ints, Ints, int], tuple[Floats, Floats]]
"""Returns the weights (K, n, k) of samples at frames (k,) at the frames (n,) of a stretch, and the variances (K, n).

The frames are counted from the first one of the stretch, whose length is the last argument.
"""


def predict_from_own_path(
    target: Floats, plan: SamplingPlan, bridges: PlanBridges, kriging: DriftKriging, error_floor: float
) -> list[KrigingResult]:
    """Return the results of the straight line and of kriging over time; none without a sample beside the gap.

    target: (N, 3) positions of the marker over ``plan.frames``, mm; not read in the gap. error_floor: mm², mean square
    below which errors count as equal.
    """
    if not len(plan.gap_adjacent):
        return []

    def kriged(samples: Ints, inside: Ints, length: int) -> tuple[Floats, Floats]:
        drift = kriging.weights(samples, length)
        return drift.weights[:, inside], drift.variance[:, inside]

    rules: list[WeightsFor] = [_straight_line]
    if _has_slopes(plan):
        rules.append(kriged)
    return [_predict(rule, target, plan, bridges, error_floor) for rule in rules]


def own_path_patterns(plan: SamplingPlan) -> Iterator[Pattern]:
    """Yield the patterns of samples that kriging over time uses for a plan."""
    if not _has_slopes(plan):
        return
    length = int(plan.inside[-1]) + 1
    yield plan.gap_adjacent - plan.gap[0], len(plan.gap)
    yield plan.adjacent, length
    for _, known in plan.known_patterns:
        yield plan.adjacent[known], length


def _has_slopes(plan: SamplingPlan) -> bool:
    """Whether there is a slope to krige with beside the gap and all windows: a line through one sample has none."""
    return len(plan.gap_adjacent) > 1 and all(len(known) > 1 for _, known in plan.known_patterns)


def _straight_line(samples: Ints, inside: Ints, length: int) -> tuple[Floats, Floats]:
    """Return the weights (1, n, k) and variances (1, n) of the line between the nearest samples on both sides.

    With samples on one side only the nearest is held. The variance is that of a random walk between or beyond them.
    """
    before, after = np.flatnonzero(samples < 0), np.flatnonzero(samples >= length)
    weights, frames = np.zeros((1, len(inside), len(samples))), np.arange(length)
    if len(before) and len(after):
        last, first = before[samples[before].argmax()], after[samples[after].argmin()]
        share = (inside - samples[last]) / (samples[first] - samples[last])
        weights[0, :, last], weights[0, :, first] = 1.0 - share, share
        walk = (frames - samples[last]) * (samples[first] - frames) / (samples[first] - samples[last])
    else:
        nearest = np.abs(samples).argmin() if len(before) else samples.argmin()
        weights[0, :, nearest] = 1.0
        walk = np.abs(frames - samples[nearest])
    variance = FLAT_SHARE + (1.0 - FLAT_SHARE) * walk / walk.mean()
    return weights, np.asarray(variance[None, inside], dtype=np.float64)


def _predict(
    rule: WeightsFor, target: Floats, plan: SamplingPlan, bridges: PlanBridges, error_floor: float
) -> KrigingResult:
    """Return the prediction of the gap by one rule, its kernels weighted by their likelihood in the windows."""
    _, windows, gap_adjacent, _ = plan.parts
    inside, length = plan.inside, int(plan.inside[-1]) + 1
    truth = target[windows].reshape(*plan.windows.shape, 3)
    gap_weights, gap_variance = rule(plan.gap_adjacent - plan.gap[0], plan.gap - plan.gap[0], len(plan.gap))
    # The variance in windows is that of a window whose adjacent samples are all known.
    _, window_variance = rule(plan.adjacent, inside, length)
    errors = np.empty((len(gap_weights), len(truth), len(inside), 3))
    for members, known, _ in bridges.groups:
        shares, _ = rule(plan.adjacent[known], inside, length)
        samples = truth[members][:, len(inside) + known]
        errors[:, members] = truth[members][:, : len(inside)] - np.einsum("gmk,wkc->gwmc", shares, samples)
    if len(truth):
        # One penalty only: the axis that ``likelihood_weights`` has for them.
        squares = np.square(errors).mean(axis=(2, 3)).T[..., None]
        weights = likelihood_weights(squares, np.full(len(truth), 1.0 / len(truth)), error_floor)[:, 0]
    else:
        weights = np.full(len(errors), 1.0 / len(errors))
    return KrigingResult(
        positions=np.tensordot(weights, gap_weights, axes=1) @ target[gap_adjacent],
        window_errors=np.tensordot(weights, errors, axes=1),
        gap_variance=weights @ gap_variance,
        window_variance=weights @ window_variance,
    )
