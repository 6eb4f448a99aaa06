"""Windows of consecutive frames as vectors, and back."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Floats, Ints

T = TypeVar("T", bound=np.generic)


def starts(n_frames: int, length: int, stride: int = 1) -> Ints:
    """First frames of the windows that cover n_frames >= length frames: every stride-th, and the last."""
    return np.unique(np.append(np.arange(0, n_frames - length + 1, stride), n_frames - length))


def cut(frames: NDArray[T], first: Ints, length: int) -> NDArray[T]:
    """The windows (n, length·c) that start at ``first`` (n,) in frames (F, c)."""
    rows: NDArray[T] = frames[first[:, None] + np.arange(length)].reshape(len(first), length * frames.shape[1])
    return rows


def overlap_mean(rows: Floats, first: Ints, n_frames: int, length: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Frames (F, c) as the mean over the windows (n, length·c) that hold them, and whether any does (F,)."""
    blocks = rows.reshape(len(rows), length, -1)
    total, count = np.zeros((n_frames, blocks.shape[2])), np.zeros(n_frames)
    for offset in range(length):
        total[first + offset] += blocks[:, offset]
        count[first + offset] += 1
    return total / np.maximum(count, 1)[:, None], count > 0
