"""Numbers that judge a repair: arrays in, numbers out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats

GRADES = ("good", "fair", "poor")
LENGTH_CLASSES = (10, 30, 60, 120)
INTERVAL_90 = 1.645  # standard deviations to both sides that hold 90 % of a normal distribution


@dataclass(frozen=True, kw_only=True)
class Error:
    """The error of some samples in millimetres: per coordinate, 3D (√3 times larger), and the largest 3D distance."""

    samples: int
    rmse: float
    rmse_3d: float
    largest: float


def error(truth: Floats, positions: Floats, where: Bools) -> Error | None:
    """The error of ``positions`` (F, M, 3) against ``truth`` over the samples ``where`` (F, M); None without any.

    ``rmse`` is the root of the mean over all coordinates of those samples (Hu et al. 2017; Imamura & Okuda 2018,
    eq. 23), ``rmse_3d`` the root of the mean squared distance.
    """
    if not where.any():
        return None
    squared = ((truth[where] - positions[where]) ** 2).sum(axis=-1)
    mean = float(squared.mean())
    largest = float(squared.max()) ** 0.5
    return Error(samples=int(where.sum()), rmse=(mean / 3.0) ** 0.5, rmse_3d=mean**0.5, largest=largest)


def expected_error(sd: Floats) -> float | None:
    """The 3D error to expect of samples whose coordinates have these standard deviations, mm; NaN does not count.

    The root of the mean of 3 sd², which is what ``Error.rmse_3d`` estimates; None where nothing counts.
    """
    known = sd[~np.isnan(sd)]
    return float((3.0 * (known**2).mean()) ** 0.5) if known.size else None


def coverage(misses: Floats, sd: Floats) -> float | None:
    """The share of the coordinates of misses (n, 3) within the 90 % interval of their sd (n,); None without any."""
    return float((np.abs(misses) <= INTERVAL_90 * sd[:, None]).mean()) if misses.size else None


@dataclass(frozen=True, kw_only=True)
class Length:
    """A bone's length over the frames in which both ends are known, mm; None where no frame has both.

    deviation: the largest difference from the reference length.
    """

    frames: int
    mean: float | None
    sd: float | None
    deviation: float | None


def bone_lengths(positions: Floats, known: Bools, ends: NDArray[np.intp], references: Floats) -> list[Length]:
    """Measure each bone, given as marker indices (B, 2) and reference lengths (B,) in mm."""
    rows = []
    for (a, b), reference in zip(ends, references, strict=True):
        length = _length(positions, known, a, b)
        if length.size:
            deviation = float(np.abs(length - reference).max())
            mean, sd = float(length.mean()), float(length.std())
            rows.append(Length(frames=length.size, mean=mean, sd=sd, deviation=deviation))
        else:
            rows.append(Length(frames=0, mean=None, sd=None, deviation=None))
    return rows


def skeleton_rmse(positions: Floats, known: Bools, ends: NDArray[np.intp], references: Floats) -> float | None:
    """Tan et al. 2015, eq. 25, mm: the RMS over frames and bones of length minus reference.

    The printed formula lacks the sum over frames. A bone with an unknown end in a frame does not count in it.
    """
    squares, count = 0.0, 0
    for (a, b), reference in zip(ends, references, strict=True):
        length = _length(positions, known, a, b)
        squares += float(((length - reference) ** 2).sum())
        count += length.size
    return float((squares / count) ** 0.5) if count else None


def _length(positions: Floats, known: Bools, a: int, b: int) -> Floats:
    both = known[:, a] & known[:, b]
    length: Floats = np.linalg.norm(positions[both, a] - positions[both, b], axis=1)
    return length


def by_length(lengths: Sequence[int], limits: Sequence[int] = LENGTH_CLASSES) -> list[tuple[str, NDArray[np.intp]]]:
    """Group gaps by length in frames: (name of the class, indices of its gaps), empty classes left out."""
    lows = [1, *(limit + 1 for limit in limits)]
    names = [*(f"{low}-{high}" for low, high in zip(lows, limits, strict=False)), f"over {limits[-1]}"]
    classes = np.searchsorted(limits, lengths)
    return [(names[k], np.flatnonzero(classes == k)) for k in np.unique(classes)]
