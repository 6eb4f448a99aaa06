"""Short gaps bridged over time alone: universal kriging with a linear drift, from the nearest known samples.

The conditional mean of a process about an unknown straight line, given up to 12 samples on each side. The process is a
Matérn one of smoothness 5/2, or one of smoothness 1/2 and great length, whose mean is a polygon. Which, is decided by
what each misses of hidden samples of the marker, and of the samples next to the gap, each told from the others: where a
track jumps or rattles, a smooth curve through it swings out. N. Cressie, 1993, doi:10.1002/9781119115151, section 3.4;
O. Dubrule, 1983, doi:10.1007/BF01033232 (leaving one out).
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
KERNELS = tuple((length, noise) for length in (8.0, 20.0, 50.0) for noise in (1e-6, 1e-5, 1e-3, 3e-2))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the process's variance; the polygon comes last."""
N_KERNELS = len(KERNELS) + 1
POLYGON = 300.0
N_BESIDE, PRIOR = 2, 4.0
MEDIAN = 0.789  # of the mean of three squared normal deviates


def bridge_short(positions: Floats, trusted: Bools, longest: int, rate: float) -> tuple[Floats, Floats]:
    """Positions (F, M, 3) with gaps of up to ``longest`` frames filled, and their SD (F, M), NaN where nothing was.

    A marker needs 12 trusted samples. The SD is the root mean square error per coordinate of the same operation on
    known samples, spread over the gap as the kriging variance is.
    """
    filled, sd = positions.copy(), np.full(trusted.shape, np.nan)
    bridges = Bridges(rate / 120.0)
    for marker in np.flatnonzero(~trusted.all(axis=0) & (trusted.sum(axis=0) >= 3 * FEWEST)):
        known, spans = np.flatnonzero(trusted[:, marker]), runs(~trusted[:, marker])
        track, tuned = positions[:, marker], {}
        for start, stop in spans[spans[:, 1] - spans[:, 0] <= longest]:
            length = int(stop - start)
            if length not in tuned:
                tuned[length] = _trials(track, known, length, bridges)
            place = int(np.searchsorted(known, start))
            near = known[max(0, place - REACH) : place + REACH]
            weights, variance, leave_out = bridges.of(near - start, length)
            kernel, error = _choose(tuned[length], track[near], leave_out, int(np.searchsorted(near, start)))
            filled[start:stop, marker] = weights[kernel] @ track[near]
            sd[start:stop, marker] = error * np.sqrt(variance[kernel])
    return filled, sd


def _trials(track: Floats, known: Ints, length: int, bridges: "Bridges") -> tuple[Floats, Floats]:
    """For each kernel the usual square miss of hidden samples of a track (F, 3), and the same by kriging variance.

    Not a number where there are too few samples to hide any.
    """
    last = len(known) - length - FEWEST
    if last < FEWEST:
        return np.full(N_KERNELS, np.nan), np.full(N_KERNELS, np.nan)
    squares, scaled = [], []
    for place in np.unique(np.linspace(FEWEST, last, N_TRIALS).astype(int)):
        start = known[place]
        ahead = int(np.searchsorted(known, start + length))
        near = np.append(known[max(0, place - REACH) : place], known[ahead : ahead + REACH])
        weights, variance, _ = bridges.of(near - start, length)
        hidden = known[place:ahead]
        misses = np.square((weights @ track[near])[:, hidden - start] - track[hidden]).mean(axis=2)
        squares.append(misses.mean(axis=1))
        scaled.append((misses / variance[:, hidden - start]).mean(axis=1))
    return np.median(squares, axis=0) / MEDIAN, np.median(scaled, axis=0) / MEDIAN


def _choose(trials: tuple[Floats, Floats], values: Floats, leave_out: Floats, place: int) -> tuple[int, float]:
    """The kernel that missed least, and its error per root kriging variance.

    values: (k, 3) the samples near the gap, which lies before the sample ``place``. The trials count as four samples.
    """
    beside = slice(max(0, place - N_BESIDE), place + N_BESIDE)
    own = np.einsum("gkk->gk", leave_out)[:, beside]
    weighted = np.square(leave_out @ (values - values.mean(axis=0))).mean(axis=2)[:, beside]
    squares, scaled = weighted / own**2, weighted / own
    prior = PRIOR if np.isfinite(trials[0]).all() else 0.0
    total = squares.sum(axis=1) + prior * np.nan_to_num(trials[0])
    best = int(total.argmin())
    error = (scaled[best].sum() + prior * np.nan_to_num(trials[1])[best]) / (scaled.shape[1] + prior)
    return best, float(np.sqrt(error))


class Bridges:
    """The weights of samples near a gap, for all kernels; kept for every pattern of samples that was met."""

    def __init__(self, scale: float) -> None:
        """scale: frames per frame at 120 Hz."""
        self.lengths = np.array([length * scale for length, _ in KERNELS])[:, None, None]
        self.noises = np.append([noise for _, noise in KERNELS], 0.0)
        self.polygon = POLYGON * scale
        self.kept: dict[tuple[bytes, int], tuple[Floats, Floats, Floats]] = {}

    def of(self, near: Ints, length: int) -> tuple[Floats, Floats, Floats]:
        """For samples at frames near (k,), counted from the gap's first: their weights (K, length, k), variances

        (K, length), and the matrices Q (K, k, k) with which a sample less what the others tell of it is (Q y)_i / Q_ii
        and has the variance 1 / Q_ii.
        """
        key = near.tobytes(), length
        if key not in self.kept:
            self.kept[key] = self._solve(near, length)
        return self.kept[key]

    def _covariance(self, near: Ints, other: Ints) -> Floats:
        apart = (near[:, None] - other).astype(float)
        return np.concatenate([matern(apart[None], self.lengths), np.exp(-np.abs(apart) / self.polygon)[None]])

    def _solve(self, near: Ints, length: int) -> tuple[Floats, Floats, Floats]:
        n_near, wanted = len(near), np.arange(length)
        drift = np.stack([np.ones(n_near), near / REACH])
        system = np.zeros((N_KERNELS, n_near + 2, n_near + 2))
        system[:, :n_near, :n_near] = self._covariance(near, near) + self.noises[:, None, None] * np.eye(n_near)
        system[:, n_near:, :n_near], system[:, :n_near, n_near:] = drift, drift.T
        across = np.empty((N_KERNELS, n_near + 2, length))
        across[:, :n_near] = self._covariance(near, wanted)
        across[:, n_near:] = np.stack([np.ones(length), wanted / REACH])
        solved = np.linalg.solve(
            system, np.concatenate([across, np.broadcast_to(np.eye(n_near + 2), system.shape)], axis=2)
        )
        solved, inverse = solved[..., :length], solved[..., length:]
        variance = 1.0 + self.noises[:, None] - np.einsum("gkn,gkn->gn", across, solved)
        weights = np.asarray(solved[:, :n_near].swapaxes(1, 2), dtype=np.float64)
        return weights, np.maximum(variance, 1e-9), np.asarray(inverse[:, :n_near, :n_near])
