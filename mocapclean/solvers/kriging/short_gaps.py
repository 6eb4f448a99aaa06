"""Short gaps bridged over time: universal kriging with a linear drift, from the nearest known samples.

The conditional mean of a process about an unknown straight line, given up to 12 samples on each side. The process is a
Matérn one of smoothness 5/2, or one of smoothness 1/2 and great length, whose mean is a polygon; it is the marker's way
in the world, or in frames that travel with it as its neighbours expect. How much each of these counts is decided by
what it misses of hidden samples of the marker, and of the samples next to the gap, each told from the others: where a
track jumps or rattles, a smooth curve through it swings out. N. Cressie, 1993, doi:10.1002/9781119115151, section 3.4;
O. Dubrule, 1983, doi:10.1007/BF01033232 (leaving one out).
"""

from collections.abc import Callable
from itertools import chain
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs, runs
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.numerics.robust import nan_median
from mocapclean.solvers.kriging.matern import matern

REACH = 12
FEWEST = 4
N_TRIALS = 40
KERNELS = tuple((length, noise) for length in (8.0, 20.0, 50.0) for noise in (1e-6, 1e-5, 1e-3, 3e-2))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the process's variance; the polygon comes last."""
N_KERNELS = len(KERNELS) + 1
POLYGON = 300.0
N_BESIDE, PRIOR, SHARPNESS = 2, 4.0, 3
EVEN = 1e-12  # square mm
FARTHEST = 4.0
MEDIAN = 0.789  # of the mean of three squared normal deviates

Travelling = Callable[[int, Ints], BodyFrames | None]
"""For a marker and some frames: frames of reference that go where others say that it goes, if they say anything.

Their origins are not a number where the others say nothing.
"""


def short(trusted: Bools, longest: int) -> Bools:
    """The samples (F, M) in gaps of up to ``longest`` frames, of markers with 12 trusted samples at least."""
    found = np.zeros_like(trusted)
    for marker, start, stop in column_runs(~trusted & (trusted.sum(axis=0) >= 3 * FEWEST)):
        found[start:stop, marker] = stop - start <= longest
    return found


def bridge_short(
    positions: Floats, trusted: Bools, known: Bools, rate: float, travelling: Travelling | None = None
) -> tuple[Floats, Floats]:
    """Positions (F, M, 3) with what is known (F, M) and not trusted filled, and their SD (F, M), else NaN.

    The SD is the root mean square error per coordinate of the same operation on
    known samples, spread over the gap as the kriging variance is.
    """
    filled, sd = positions.copy(), np.full(trusted.shape, np.nan)
    bridges = Bridges(rate / 120.0)
    missing = known & ~trusted
    for marker in np.flatnonzero(missing.any(axis=0)).tolist():
        seen = np.flatnonzero(trusted[:, marker])
        gaps = [_place(seen, start, stop - start) for start, stop in runs(missing[:, marker]).tolist()]
        trials = {length: _trials(seen, length) for length in {gap.length for gap in gaps}}
        frames = np.unique(np.concatenate([place.frames for place in chain(gaps, *trials.values())]))
        paths = _Paths(positions[:, marker], frames, travelling(marker, frames) if travelling else None)
        tuned = {length: _tune(paths, places, bridges) for length, places in trials.items()}
        for gap in gaps:
            span = slice(gap.start, gap.start + gap.length)
            filled[span, marker], sd[span, marker] = _fill(paths, gap, tuned[gap.length], bridges)
    return filled, sd


class _Place(NamedTuple):
    """A gap or a trial: its first frame and length, known samples near (k,) it, ``before`` of them ahead, and in it."""

    start: int
    length: int
    near: Ints
    before: int
    hidden: Ints

    @property
    def inside(self) -> Ints:
        return np.arange(self.start, self.start + self.length)

    @property
    def frames(self) -> Ints:
        return np.append(self.near, self.inside)


def _place(known: Ints, start: int, length: int) -> _Place:
    ahead, behind = np.searchsorted(known, (start, start + length)).tolist()
    before = known[max(0, ahead - REACH) : ahead]
    near = np.append(before, known[behind : behind + REACH])
    return _Place(start, length, near, len(before), known[ahead:behind])


def _trials(known: Ints, length: int) -> list[_Place]:
    """Places where known samples are hidden to see what is missed; none where there are too few to hide any."""
    last = len(known) - length - FEWEST
    if last < FEWEST:
        return []
    hidden = np.unique(np.linspace(FEWEST, last, N_TRIALS).astype(int))
    return [_place(known, start, length) for start in known[hidden].tolist()]


class _Paths:
    """A marker's way (F, 3), in the world and, if there are such frames, in those that travel with it."""

    def __init__(self, track: Floats, frames: Ints, moving: BodyFrames | None) -> None:
        self.frames, self.moving, self.tracks = frames, moving, [track]
        if moving:
            local = np.full_like(track, np.nan)
            local[frames] = moving.to_local(track[frames][:, None])[:, 0]
            self.tracks.append(local)

    def at(self, frames: Ints) -> Floats:
        """(paths, n, 3)."""
        return np.stack([track[frames] for track in self.tracks])

    def to_world(self, path: int, values: Floats, frames: Ints) -> Floats:
        """What values (n, 3) of one of the paths are in the world."""
        if not path or not self.moving:
            return values
        at = np.searchsorted(self.frames, frames)
        return BodyFrames(self.moving.axes[at], self.moving.origins[at]).to_world(values[:, None])[:, 0]


def _tune(paths: _Paths, trials: list[_Place], bridges: "Bridges") -> tuple[Floats, Floats] | None:
    """For each path and kernel the usual square miss of hidden samples, and the same by kriging variance."""
    squares, scaled = [], []
    for trial in trials:
        weights, variance, _ = bridges.of(trial.near - trial.start, trial.length)
        hidden = trial.hidden - trial.start
        told = np.matmul(weights[:, hidden], paths.at(trial.near)[:, None])
        misses = np.square(told - paths.at(trial.hidden)[:, None]).mean(axis=3)
        squares.append(misses.mean(axis=2))
        scaled.append((misses / variance[:, hidden]).mean(axis=2))
    if not trials:
        return None
    return nan_median(np.stack(squares)) / MEDIAN, nan_median(np.stack(scaled)) / MEDIAN


def _fill(paths: _Paths, gap: _Place, tuned: tuple[Floats, Floats] | None, bridges: "Bridges") -> tuple[Floats, Floats]:
    """The samples (length, 3) of a gap, and their SD (length,): the mean of all paths' and kernels' answers.

    Weighted by 1 / (what they missed)⁶; the trials count as four samples. Neighbours are believed up to four SD of what
    the marker's own way says: in the gap they may be at fault themselves.
    """
    weights, variance, leave_out = bridges.of(gap.near - gap.start, gap.length)
    usable = np.isfinite(paths.at(gap.frames)).all(axis=(1, 2))
    if tuned:
        usable &= np.isfinite(tuned[0]).all(axis=1)
        tuned = tuned[0][usable], tuned[1][usable]
    values, beside = paths.at(gap.near)[usable], slice(max(0, gap.before - N_BESIDE), gap.before + N_BESIDE)
    own = np.einsum("gkk->gk", leave_out)[:, beside]
    left = np.matmul(leave_out, (values - values.mean(axis=1, keepdims=True))[:, None])
    weighted = np.square(left).mean(axis=3)[:, :, beside]
    squares, scaled = (weighted / own**2).sum(axis=2), (weighted / own).sum(axis=2)
    counted = float(weighted.shape[2])
    if tuned:
        squares, scaled, counted = squares + PRIOR * tuned[0], scaled + PRIOR * tuned[1], counted + PRIOR
    shares = ((squares.min() + EVEN) / (squares + EVEN)) ** SHARPNESS
    variances = shares[..., None] * (scaled / counted)[..., None] * variance
    sums = shares.sum(axis=1)
    told = [
        paths.to_world(path, np.tensordot(share / total, weights, axes=1) @ track, gap.inside)
        for path, (share, total, track) in enumerate(zip(shares, sums, values, strict=True))
    ]
    alone = variances[0].sum(axis=0) / sums[0]
    away = np.stack(told) - told[0]
    size = np.linalg.norm(away, axis=2, keepdims=True)
    away *= np.minimum(1.0, FARTHEST * np.sqrt(3.0 * alone)[:, None] / np.maximum(size, EVEN))
    answer = told[0] + np.tensordot(sums / sums.sum(), away, axes=1)
    return answer, np.sqrt(variances.sum(axis=(0, 1)) / sums.sum())


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
