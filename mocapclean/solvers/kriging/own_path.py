"""Prediction of a gap segment from the marker's own path in the world, without neighbours: it stays or moves on.

The first predictor is the straight line between the samples on both sides of the gap, or the last sample where there is
one side only. The second is universal kriging over time by several kernels (``drift_kriging``), weighted by their
likelihood in the windows. Both are tried on the same windows as the predictors that follow neighbours.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.drift_kriging import DriftKriging, Pattern
from mocapclean.solvers.kriging.regression_kriging import KrigingResult, likelihood_weights
from mocapclean.solvers.kriging.sampling_plan import SamplingPlan

FLAT_SHARE = 0.5
"""Share of the variance of a straight line that does not vanish beside the samples, as their noise does not.

Chosen by hand; no sweep was kept.
"""


class OwnPath:
    """The weights of both predictors at one frame rate, Hz, kept for each pattern of samples."""

    def __init__(self, rate: float) -> None:
        self.kriging = DriftKriging(rate)
        self._kept: dict[tuple[bytes, bytes, int], tuple[Floats, Floats]] = {}

    def prepare(self, plans: Iterable[SamplingPlan]) -> None:
        """Compute the kriging weights of some plans together."""
        self.kriging.prepare(pattern for plan in plans if _has_slopes(plan) for pattern in _patterns(plan))

    def weights(self, samples: Ints, inside: Ints, length: int, *, kriged: bool) -> tuple[Floats, Floats]:
        """Return the weights (K, n, k) of samples at frames (k,) for the frames inside (n,), and variances (K, n).

        The straight line comes first, then the kernels if ``kriged``. Frames are counted from the first one of a
        stretch of ``length`` frames.
        """
        key = samples.tobytes(), inside.tobytes(), length if kriged else -length
        if key not in self._kept:
            found = _straight_line(samples, inside, length)
            if kriged:
                drift = self.kriging.weights(samples, length)
                weights, variance = found
                found = (
                    np.concatenate([weights, drift.weights[:, inside]]),
                    np.concatenate([variance, drift.variance[:, inside]]),
                )
            self._kept[key] = found
        return self._kept[key]


def predict_from_own_path(
    target: Floats, plan: SamplingPlan, own_path: OwnPath, error_floor: float
) -> list[KrigingResult]:
    """Return the results of the straight line and of kriging over time; none without a sample beside the gap.

    target: (N, 3) positions of the marker over ``plan.frames``, mm; not read in the gap. error_floor: mm², mean square
    below which errors count as equal.
    """
    if not len(plan.gap_adjacent):
        return []
    kriged, inside, length = _has_slopes(plan), plan.inside, int(plan.inside[-1]) + 1
    _, windows, gap_adjacent, _ = plan.parts
    truth = target[windows].reshape(*plan.windows.shape, 3)
    gap_weights, gap_variance = own_path.weights(
        plan.gap_adjacent - plan.gap[0], plan.gap - plan.gap[0], len(plan.gap), kriged=kriged
    )
    # The variance in windows is that of a window whose adjacent samples are all known.
    _, window_variance = own_path.weights(plan.adjacent, inside, length, kriged=kriged)
    errors = np.empty((len(gap_weights), len(truth), len(inside), 3))
    for members, known in plan.known_patterns:
        shares, _ = own_path.weights(plan.adjacent[known], inside, length, kriged=kriged)
        samples = truth[members[:, None], len(inside) + known]
        errors[:, members] = truth[members, : len(inside)] - np.matmul(shares[:, None], samples)
    positions = gap_weights @ target[gap_adjacent]
    everything = positions, errors, gap_variance, window_variance
    results = [KrigingResult(*(values[0] for values in everything))]
    if kriged:
        weights = _kernel_weights(errors[1:], error_floor)
        results.append(KrigingResult(*(np.tensordot(weights, values[1:], axes=1) for values in everything)))
    return results


def _kernel_weights(errors: Floats, error_floor: float) -> Floats:
    """Return the weights (K,) of kernels by the likelihood of their errors (K, w, m, 3) in windows; else equal ones."""
    n_windows = errors.shape[1]
    if not n_windows:
        return np.full(len(errors), 1.0 / len(errors))
    # One penalty only: the last axis that ``likelihood_weights`` has for them
    squares = np.square(errors).mean(axis=(2, 3)).T[..., None]
    return likelihood_weights(squares, np.full(n_windows, 1.0 / n_windows), error_floor)[:, 0]


def _patterns(plan: SamplingPlan) -> Iterator[Pattern]:
    """Yield the patterns of samples that kriging over time uses for a plan."""
    length = int(plan.inside[-1]) + 1
    yield plan.gap_adjacent - plan.gap[0], len(plan.gap)
    yield plan.adjacent, length
    for _, known in plan.known_patterns:
        yield plan.adjacent[known], length


def _has_slopes(plan: SamplingPlan) -> bool:
    """Whether the gap and all windows have two or more adjacent samples, which kriging needs for a slope."""
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
