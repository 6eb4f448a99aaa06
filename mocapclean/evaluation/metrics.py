"""Errors of positions, coverage of intervals, and lengths of bones: arrays in, numbers out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats

GRADES = ("good", "fair", "poor")  # of a fill, by its expected error
LENGTH_CLASSES = (10, 30, 60, 120)  # frames, the longest gap of each class but the last; chosen by hand, 1 s at 120 Hz
INTERVAL_90 = 1.645  # standard deviations on each side of the mean that contain 90 % of a normal distribution


@dataclass(frozen=True, kw_only=True)
class Error:
    """The error of samples, mm.

    rmse: root mean square over coordinates. rmse_3d: root mean square of the distance in space, √3 times larger.
    largest: the largest distance.
    """

    samples: int
    rmse: float
    rmse_3d: float
    largest: float


def error(truth: Floats, positions: Floats, where: Bools) -> Error | None:
    """Return the error of ``positions`` (F, M, 3) against ``truth`` over samples ``where`` (F, M); None without any.

    ``rmse`` is that of W. Hu et al., 2017, and of I. Imamura, M. Okuda, 2018, eq. 23.
    """
    if not where.any():
        return None
    squared = ((truth[where] - positions[where]) ** 2).sum(axis=-1)
    mean = float(squared.mean())
    largest = float(squared.max()) ** 0.5
    return Error(samples=int(where.sum()), rmse=(mean / 3.0) ** 0.5, rmse_3d=mean**0.5, largest=largest)


def expected_error(sd: Floats) -> float | None:
    """Return the expected 3D error, mm, of samples whose coordinates have these standard deviations.

    It is the root of the mean of 3 sd², the quantity that ``Error.rmse_3d`` estimates. NaN does not count; None without
    a number.
    """
    known = sd[~np.isnan(sd)]
    return float((3.0 * (known**2).mean()) ** 0.5) if known.size else None


def coverage(errors: Floats, sd: Floats) -> float | None:
    """Return the share of coordinates of errors (n, 3) within 1.645 sd (n,), the 90 % interval; None without any."""
    return float((np.abs(errors) <= INTERVAL_90 * sd[:, None]).mean()) if errors.size else None


@dataclass(frozen=True, kw_only=True)
class Length:
    """The length of a bone over the frames in which both ends are known, mm; None without such a frame.

    deviation: the largest absolute difference from the reference length.
    """

    frames: int
    mean: float | None
    sd: float | None
    deviation: float | None


def bone_lengths(positions: Floats, known: Bools, ends: NDArray[np.intp], references: Floats) -> list[Length]:
    """Return the length of each bone in positions (F, M, 3), mm.

    known: (F, M). ends: marker indices (B, 2). references: the reference lengths (B,), mm.
    """
    rows = []
    for (a, b), reference in zip(ends, references, strict=True):
        length = _known_lengths(positions, known, a, b)
        if length.size:
            deviation = float(np.abs(length - reference).max())
            mean, sd = float(length.mean()), float(length.std())
            rows.append(Length(frames=length.size, mean=mean, sd=sd, deviation=deviation))
        else:
            rows.append(Length(frames=0, mean=None, sd=None, deviation=None))
    return rows


def skeleton_rmse(positions: Floats, known: Bools, ends: NDArray[np.intp], references: Floats) -> float | None:
    """Return the RMS over frames and bones of length minus reference, mm: C.-H. Tan et al., 2015, eq. 25.

    The printed formula lacks the sum over frames. A bone does not count in frames in which an end is unknown. Arguments
    are those of ``bone_lengths``; None where no bone counts.
    """
    squares, count = 0.0, 0
    for (a, b), reference in zip(ends, references, strict=True):
        length = _known_lengths(positions, known, a, b)
        squares += float(((length - reference) ** 2).sum())
        count += length.size
    return float((squares / count) ** 0.5) if count else None


def _known_lengths(positions: Floats, known: Bools, a: int, b: int) -> Floats:
    """Return the distances (n,) of markers a and b in the frames in which both are known."""
    both = known[:, a] & known[:, b]
    length: Floats = np.linalg.norm(positions[both, a] - positions[both, b], axis=1)
    return length


def by_length(lengths: Sequence[int], limits: Sequence[int] = LENGTH_CLASSES) -> list[tuple[str, NDArray[np.intp]]]:
    """Return the gaps grouped by length in frames: (name of the class, indices of its gaps), without empty classes."""
    lows = [1, *(limit + 1 for limit in limits)]
    names = [*(f"{low}-{high}" for low, high in zip(lows, limits, strict=False)), f"over {limits[-1]}"]
    classes = np.searchsorted(limits, lengths)
    return [(names[k], np.flatnonzero(classes == k)) for k in sorted(set(classes.tolist()))]
