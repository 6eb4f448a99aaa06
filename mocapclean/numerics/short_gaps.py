"""Short gaps bridged over time alone: universal kriging with a linear drift, from the nearest known samples.

The conditional mean of a Matérn process about an unknown straight line, given up to 12 samples on each side. The
kernel of each marker is the one that fills such gaps best where its samples are known. N. Cressie, 1993,
doi:10.1002/9781119115151, section 3.4.
"""

import numpy as np
from numpy.typing import NDArray

from mocapclean.numerics.matern import matern
from mocapclean.runs import runs

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

REACH = 12
FEWEST = 4
N_TRIALS = 40
KERNELS = tuple((length, noise) for length in (8.0, 20.0, 50.0) for noise in (1e-8, 1e-5, 1e-3, 3e-2))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the process's variance."""


def bridge_short(positions: Floats, trusted: Bools, longest: int, rate: float) -> tuple[Floats, Floats]:
    """Positions (F, M, 3) with gaps of up to ``longest`` frames filled, and their SD (F, M), NaN where nothing was.

    A marker needs 12 trusted samples. The SD is the root mean square error per coordinate of the same operation on
    known samples, spread over the gap as the kriging variance is.
    """
    filled, sd = positions.copy(), np.full(trusted.shape, np.nan)
    bridges = Bridges(rate / 120.0)
    for marker in np.flatnonzero(~trusted.all(axis=0) & (trusted.sum(axis=0) >= 3 * FEWEST)):
        known, spans = np.flatnonzero(trusted[:, marker]), runs(~trusted[:, marker])
        tuned: dict[int, tuple[int, float]] = {}
        for start, stop in spans[spans[:, 1] - spans[:, 0] <= longest]:
            length = int(stop - start)
            if length not in tuned:
                tuned[length] = _tune(positions[:, marker], known, length, bridges)
            kernel, error = tuned[length]
            place = int(np.searchsorted(known, start))
            near = known[max(0, place - REACH) : place + REACH]
            weights, variance = bridges.of(near - start, length)
            filled[start:stop, marker] = weights[kernel] @ positions[near, marker]
            sd[start:stop, marker] = error * np.sqrt(variance[kernel])
    return filled, sd


def _tune(track: Floats, known: Ints, length: int, bridges: "Bridges") -> tuple[int, float]:
    """The kernel that gives back hidden samples of a track (F, 3) best, and its error per root kriging variance."""
    last = len(known) - length - FEWEST
    squares, scaled = [], []
    for place in np.unique(np.linspace(FEWEST, last, N_TRIALS).astype(int)) if last >= FEWEST else ():
        start = known[place]
        ahead = int(np.searchsorted(known, start + length))
        near = np.append(known[max(0, place - REACH) : place], known[ahead : ahead + REACH])
        weights, variance = bridges.of(near - start, length)
        hidden = known[place:ahead]
        misses = np.square((weights @ track[near])[:, hidden - start] - track[hidden]).mean(axis=2)
        squares.append(misses.mean(axis=1))
        scaled.append((misses / variance[:, hidden - start]).mean(axis=1))
    if not squares:
        return len(KERNELS) // 2, float("nan")
    best = int(np.mean(squares, axis=0).argmin())
    return best, float(np.sqrt(np.mean(scaled, axis=0)[best]))


class Bridges:
    """The weights of samples near a gap, for all kernels; kept for every pattern of samples that was met."""

    def __init__(self, scale: float) -> None:
        """scale: frames per frame at 120 Hz."""
        self.lengths = np.array([length * scale for length, _ in KERNELS])
        self.noises = np.array([noise for _, noise in KERNELS])
        self.kept: dict[tuple[bytes, int], tuple[Floats, Floats]] = {}

    def of(self, near: Ints, length: int) -> tuple[Floats, Floats]:
        """Weights (K, length, k) of samples at frames near (k,), counted from the gap's first, and variances."""
        key = near.tobytes(), length
        if key not in self.kept:
            self.kept[key] = self._solve(near, length)
        return self.kept[key]

    def _solve(self, near: Ints, length: int) -> tuple[Floats, Floats]:
        n_near, wanted = len(near), np.arange(length)
        drift = np.stack([np.ones(n_near), near / REACH])
        system = np.zeros((len(KERNELS), n_near + 2, n_near + 2))
        apart = matern((near[:, None] - near)[None], self.lengths[:, None, None])
        system[:, :n_near, :n_near] = apart + self.noises[:, None, None] * np.eye(n_near)
        system[:, n_near:, :n_near], system[:, :n_near, n_near:] = drift, drift.T
        across = np.empty((len(KERNELS), n_near + 2, length))
        across[:, :n_near] = matern((near[:, None] - wanted)[None], self.lengths[:, None, None])
        across[:, n_near:] = np.stack([np.ones(length), wanted / REACH])
        solved = np.linalg.solve(system, across)
        variance = 1.0 + self.noises[:, None] - np.einsum("gkn,gkn->gn", across, solved)
        weights = np.asarray(solved[:, :n_near].swapaxes(1, 2), dtype=np.float64)
        return weights, np.maximum(variance, 1e-9)
