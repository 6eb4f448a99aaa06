"""Windows of consecutive frames as row vectors, and frames as means over windows."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, Ints

T = TypeVar("T", bound=np.generic)


def starts(n_frames: int, length: int, stride: int = 1) -> Ints:
    """Return the first frames of windows of ``length`` frames: every stride-th, and the last window of the take.

    n_frames: at least ``length``.
    """
    return np.unique(np.append(np.arange(0, n_frames - length + 1, stride), n_frames - length))


def cut(frames: NDArray[T], first: Ints, length: int) -> NDArray[T]:
    """Return the windows (n, length·c) of frames (F, c) that start at ``first`` (n,)."""
    rows: NDArray[T] = frames[first[:, None] + np.arange(length)].reshape(len(first), length * frames.shape[1])
    return rows


def overlap_mean(rows: Floats, first: Ints, n_frames: int, length: int) -> tuple[Floats, Bools]:
    """Return each frame (F, c) as the mean over the windows (n, length·c) that cover it, and which are covered (F,).

    first: (n,), the first frame of each window. Frames that no window covers are 0.
    """
    blocks = rows.reshape(len(rows), length, -1)
    total, count = np.zeros((n_frames, blocks.shape[2])), np.zeros(n_frames)
    # Distinct windows have distinct first frames, so one offset writes each frame at most once.
    for offset in range(length):
        total[first + offset] += blocks[:, offset]
        count[first + offset] += 1
    return total / np.maximum(count, 1)[:, None], count > 0
