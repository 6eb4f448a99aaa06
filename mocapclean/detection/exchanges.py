"""Two markers whose paths are exchanged for a time: found by where each path goes on, proved by the markers around."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.distances import Rigidity
from mocapclean.numerics.robust import nan_median

_LEAST = 25.0
_CLEARLY = 0.35
_PARTNERS = 5
_SLACK = 3.0


@dataclass(frozen=True)
class Exchange:
    """Markers first and second bear each other's name in these frames (F,).

    before, after: how far, in robust SDs, their distances to rigid partners are off, as they are and exchanged back.
    """

    first: int
    second: int
    frames: Bools
    before: float
    after: float


def exchanges(positions: Floats, rigid: Rigidity) -> tuple[Exchange, ...]:
    """All exchanges in positions (F, M, 3), NaN where not trusted.

    The names change where the path of each marker goes on in the other at a fraction of the error. Between an odd
    change and the next they are exchanged; with an odd number, on the shorter side of the last. What is found must
    bring the markers nearer to their distances from their rigid partners, as the other frames have them.
    """
    found = []
    for (first, second), changes in sorted(_changes(positions).items()):
        both = np.isfinite(positions[:, [first, second], 0]).all(axis=1)
        frames = (np.searchsorted(changes, np.arange(len(positions)), side="right") % 2 == 1) & both
        if len(changes) % 2 and 2 * frames.sum() > both.sum():
            frames = both & ~frames
        if not frames.any() or frames.sum() == both.sum():
            continue
        before, after = _misfit(positions, rigid, first, second, frames)
        if after < before:
            found.append(Exchange(first, second, frames, before, after))
    return tuple(found)


def exchange(positions: Floats, found: tuple[Exchange, ...]) -> Floats:
    """Positions (F, M, 3) with the exchanges undone; every number stays as it is, in the other marker's place."""
    undone = positions.copy()
    for one in found:
        first, second = undone[one.frames, one.first], undone[one.frames, one.second]
        undone[one.frames, one.first], undone[one.frames, one.second] = second, first
    return undone


def _changes(positions: Floats) -> dict[tuple[int, int], list[int]]:
    """For each pair of markers the frames from which on each goes on where the other was going."""
    shape = positions.shape[:2]
    bend = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=2)
    onward, backward = np.full(shape, np.nan), np.full(shape, np.nan)
    onward[2:], backward[1:-1] = bend, bend
    broken = np.fmin(onward, backward) > _LEAST
    found: dict[tuple[int, int], list[int]] = {}
    for frame in np.flatnonzero(broken.sum(axis=1) > 1):
        columns = np.flatnonzero(broken[frame])
        miss = _miss(positions[:, columns], int(frame))
        kept = miss.diagonal()
        ratio = (miss + miss.T) / np.maximum(kept[:, None] + kept, 1e-9)
        ratio = np.where(np.isfinite(ratio), ratio, np.inf)
        np.fill_diagonal(ratio, np.inf)
        while ratio.size and ratio.min() < _CLEARLY:
            a, b = np.unravel_index(int(np.argmin(ratio)), ratio.shape)
            pair = sorted((int(columns[a]), int(columns[b])))
            found.setdefault((pair[0], pair[1]), []).append(int(frame))
            ratio[[a, b]] = ratio[:, [a, b]] = np.inf
    return found


def _miss(paths: Floats, frame: int) -> Floats:
    """How far (n, n), in mm, the past of each path leads from the present of each, or that present's past from it."""
    misses = []
    if frame >= 2:
        led = 2 * paths[frame - 1] - paths[frame - 2]
        misses.append(np.linalg.norm(led[:, None] - paths[frame], axis=2))
    if frame + 1 < len(paths):
        led = 2 * paths[frame] - paths[frame + 1]
        misses.append(np.linalg.norm(paths[frame - 1][:, None] - led, axis=2))
    return np.asarray(np.fmin.reduce(misses))


def _misfit(positions: Floats, rigid: Rigidity, first: int, second: int, frames: Bools) -> tuple[float, float]:
    """Mean error, in robust SDs, of the distances to rigid partners in these frames: as it is, and exchanged."""
    as_is, exchanged = 0.0, 0.0
    for own, other in ((first, second), (second, first)):
        partners = [p for p in rigid.partners(own)[0] if p not in (first, second)][:_PARTNERS]
        if not partners:
            continue
        apart = np.linalg.norm(positions[:, partners] - positions[:, [own]], axis=2)
        middle = nan_median(apart[~frames])
        spread = 1.4826 * nan_median(np.abs(apart[~frames] - middle)) + _SLACK
        swapped = np.linalg.norm(positions[frames][:, partners] - positions[frames][:, [other]], axis=2)
        as_is += _mean(np.abs(apart[frames] - middle) / spread)
        exchanged += _mean(np.abs(swapped - middle) / spread)
    return as_is, exchanged


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else 0.0
