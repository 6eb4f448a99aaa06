"""Batches of segments with training rows only."""

import numpy as np

from mocapclean.solvers.kriging.bridging import KERNELS
from mocapclean.solvers.kriging.sampling_plan import N_FOLDS
from mocapclean.solvers.kriging.segment_batch import SegmentBatch


def training_batch(n_training: list[int], target: np.ndarray | None = None) -> SegmentBatch:
    """A batch of segments that learn from so many rows each; target: (G, N, 3), not read if None."""
    counts, n_segments = np.array(n_training), len(n_training)
    share = (np.arange(counts.max()) < counts[:, None]) / counts[:, None]
    nothing = np.zeros((n_segments, len(KERNELS), 0))
    return SegmentBatch(
        target=np.zeros((n_segments, 0, 3)) if target is None else target,
        n_training=counts,
        training_share=share[:, None],
        held_out=np.zeros((n_segments, N_FOLDS, 0), dtype=np.intp),
        n_windows=np.zeros(n_segments, dtype=np.intp),
        window_share=np.zeros((n_segments, 0)),
        window_rows=0,
        n_inside=0,
        window_bridges=np.zeros((n_segments, 0, len(KERNELS), 0, 0)),
        gap_bridges=nothing[..., None],
        gap_variance=nothing,
        window_variance=nothing,
        n_adjacent=np.zeros(n_segments, dtype=np.intp),
        n_gap=np.zeros(n_segments, dtype=np.intp),
    )
