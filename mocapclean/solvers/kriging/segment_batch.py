"""Gap segments of the same layout, whose predictions are computed together as stacked arrays.

The rows of all arrays are frames of the take by their purpose: training, windows, adjacent to the gap, and the gap.
Where a segment has fewer of them than others of its batch, rows are repeated, and weigh nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.solvers.kriging.bridging import KERNELS, PlanBridges
from mocapclean.solvers.kriging.sampling_plan import N_FOLDS, SamplingPlan


@dataclass(frozen=True, kw_only=True)
class SegmentBatch:
    """The data of G segments that all predictors share; N rows, of which T are for training.

    target: (G, N, 3) positions of the markers, mm; not read in the gap.
    n_training: (G,) training rows in use. training_share: (G, 1, T) 1 / n_training in these, else 0.
    held_out: (G, folds, H) training rows that are held out in each fold; T where there are fewer.
    n_windows: (G,) windows in use. window_share: (G, W) 1 / n_windows for these, else 0. A window has ``window_rows``
    rows, of which the first ``n_inside`` are inside it. Window k is held out in fold k mod ``N_FOLDS``.
    window_bridges: (G, W, kernels, n_inside, s) and gap_bridges: (G, kernels, L, B), the weights of adjacent samples.
    gap_variance, window_variance: (G, kernels, L) and (G, kernels, n_inside), as shares of that of the process.
    n_adjacent, n_gap: (G,) rows adjacent to the gap and in it that are in use.
    """

    target: Floats
    n_training: Ints
    training_share: Floats
    held_out: Ints
    n_windows: Ints
    window_share: Floats
    window_rows: int
    n_inside: int
    window_bridges: Floats
    gap_bridges: Floats
    gap_variance: Floats
    window_variance: Floats
    n_adjacent: Ints
    n_gap: Ints

    @property
    def training(self) -> slice:
        """The rows to learn from."""
        return slice(0, self.training_share.shape[2])

    @property
    def windows(self) -> slice:
        """The rows of all windows."""
        return slice(self.training.stop, self.training.stop + self.window_share.shape[1] * self.window_rows)

    @property
    def adjacent(self) -> slice:
        """The rows on both sides of the gap."""
        return slice(self.windows.stop, self.windows.stop + self.gap_bridges.shape[3])

    @property
    def gap(self) -> slice:
        """The rows of the gap."""
        return slice(self.adjacent.stop, self.adjacent.stop + self.gap_bridges.shape[2])

    def training_mean(self, values: Floats) -> Floats:
        """Return the mean (G, 1, p) over the training rows in use of values (G, N, p)."""
        return np.asarray(self.training_share @ values[:, self.training])

    def by_fold(self, values: Floats) -> Floats:
        """Return the rows of the windows (G, folds, R, p) of values (G, N, p), the windows of each fold together."""
        n_segments, n_windows = self.window_share.shape
        shape = n_segments, n_windows // N_FOLDS, N_FOLDS, self.window_rows, values.shape[2]
        rows = values[:, self.windows].reshape(shape).swapaxes(1, 2)
        return rows.reshape(n_segments, N_FOLDS, -1, values.shape[2])

    def in_windows(self, by_fold: Floats) -> Floats:
        """Return values (G, folds, R, p) of ``by_fold`` in the order of the windows (G, W, window_rows, p)."""
        n_segments, n_windows = self.window_share.shape
        shape = n_segments, N_FOLDS, n_windows // N_FOLDS, self.window_rows, by_fold.shape[3]
        rows = by_fold.reshape(shape).swapaxes(1, 2)
        return rows.reshape(n_segments, n_windows, self.window_rows, by_fold.shape[3])


def batch_frames(plans: Sequence[SamplingPlan]) -> Ints:
    """Return the frames of the take (G, N) at the rows of a batch; repeated where a segment has fewer."""
    purposes = [
        [plan.training for plan in plans],
        [plan.windows.ravel() for plan in plans],
        [plan.gap_adjacent for plan in plans],
        [plan.gap for plan in plans],
    ]
    sizes = [max(map(len, of_all)) for of_all in purposes]
    sizes[1] = _padded_windows(plans) * plans[0].windows.shape[1]
    frames = np.empty((len(plans), sum(sizes)), dtype=np.intp)
    for k, plan in enumerate(plans):
        frames[k] = plan.training[0]
        for start, of_all in zip(np.cumsum([0, *sizes[:-1]]), purposes, strict=True):
            frames[k, start : start + len(of_all[k])] = of_all[k]
    return frames


def batch_of(
    plans: Sequence[SamplingPlan], bridges: Sequence[PlanBridges], target: Floats, held_out_margin: int
) -> SegmentBatch:
    """Return the batch of plans with the same frames inside windows and the same kinds of adjacent frames.

    target: (G, N, 3) positions of the markers at the rows of ``batch_frames``. held_out_margin: frames around a window
    that are held out with it.
    """
    n_training, n_windows = (np.array([len(of) for of in each]) for each in _zipped(plans, "training", "windows"))
    n_adjacent, n_gap = (np.array([len(of) for of in each]) for each in _zipped(plans, "gap_adjacent", "gap"))
    width, n_inside = _padded_windows(plans), len(plans[0].inside)
    return SegmentBatch(
        target=target,
        n_training=n_training,
        training_share=_shares(n_training, n_training.max())[:, None],
        held_out=_held_out(plans, held_out_margin, n_training.max()),
        n_windows=n_windows,
        window_share=_shares(n_windows, width),
        window_rows=plans[0].windows.shape[1],
        n_inside=n_inside,
        window_bridges=np.stack([_padded(each.window_weights(), (width,)) for each in bridges]),
        gap_bridges=np.stack(
            [_padded(each.gap_weights, (len(KERNELS), n_gap.max(), n_adjacent.max())) for each in bridges]
        ),
        gap_variance=np.stack([_padded(each.gap_variance, (len(KERNELS), n_gap.max())) for each in bridges]),
        window_variance=np.stack([each.window_variance for each in bridges]),
        n_adjacent=n_adjacent,
        n_gap=n_gap,
    )


def _zipped(plans: Sequence[SamplingPlan], *names: str) -> list[list[Ints]]:
    """Return the frames of some purposes, one list over the plans for each."""
    return [[getattr(plan, name) for plan in plans] for name in names]


def _padded_windows(plans: Sequence[SamplingPlan]) -> int:
    """Return the number of windows of a batch: as many in each fold, and none only if no plan has any."""
    return -(-max(len(plan.windows) for plan in plans) // N_FOLDS) * N_FOLDS


def _shares(counts: Ints, width: int) -> Floats:
    """Return 1 / count in the first count entries of each row (G, width), else 0."""
    return np.asarray((np.arange(width) < counts[:, None]) / np.maximum(counts, 1)[:, None], dtype=np.float64)


def _padded(values: Floats, shape: tuple[int, ...]) -> Floats:
    """Return values with zeros after the entries of their first axes, to this shape."""
    padding = [(0, n - have) for n, have in zip(shape, values.shape, strict=False)]
    return np.pad(values, padding + [(0, 0)] * (values.ndim - len(padding))) if any(map(sum, padding)) else values


def _held_out(plans: Sequence[SamplingPlan], margin: int, n_rows: int) -> Ints:
    """Return the training rows (G, folds, H) that each fold leaves out; ``n_rows`` where there are fewer."""
    rows = [[np.flatnonzero(fold) for fold in plan.held_out(margin)] for plan in plans]
    held_out = np.full((len(plans), N_FOLDS, max(len(fold) for folds in rows for fold in folds)), n_rows)
    for table, folds in zip(held_out, rows, strict=True):
        for line, fold in zip(table, folds, strict=True):
            line[: len(fold)] = fold
    return held_out
