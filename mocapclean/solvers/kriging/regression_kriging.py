"""Regression kriging of one gap: a ridge regression on what else moves, and its residual bridged from both sides.

    y_t = μ + aᵗW + g(t) + ε      g a Matérn process in time

W is the ridge estimate from frames where y is known. For every ridge penalty λ and every Matérn kernel the error is
measured on windows: stretches as long as the gap in which y is known, hidden from the regression by turns and bridged
from their own sides as the gap is. All pairs (λ, kernel) take part in the answer, weighted by that error as a Gaussian
likelihood would (n / 2 · log of the mean square), which is steadier than the best pair alone.

N. Cressie, 1993, doi:10.1002/9781119115151 (kriging with a regression for its mean); A. E. Hoerl, R. W. Kennard, 1970,
doi:10.1080/00401706.1970.10488634 (ridge).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg.lapack import dposv

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.solvers.kriging.matern import bridge

RIDGES = np.logspace(-6, 0, 6)
KERNELS = ((5.0, 1e-2), (10.0, 1e-2), (20.0, 1e-2), (40.0, 1e-2), (80.0, 1e-2), (20.0, 1e-1), (60.0, 1e-1))
"""Lengths ℓ in frames at 120 Hz, and noise as a share of the process's variance."""
N_FOLDS = 3
N_KEPT = 64
SHARPNESS = 48.0
FARTHEST = 2.0


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Which frames serve for what, as numbers of frames of the take.

    learnt: (n,) frames to learn from. windows: (w, m + s) frames inside and beside each window; inside: (m,) and
    beside: (s,) the same counted from the window's start; beside_known: (w, s) whether y is known there. sides: (k,)
    known frames beside the gap; gap: (L,) its own.
    """

    learnt: Ints
    windows: Ints
    inside: Ints
    beside: Ints
    beside_known: Bools
    sides: Ints
    gap: Ints

    @property
    def frames(self) -> Ints:
        """All of them in the order learnt, windows, sides, gap."""
        return np.concatenate([self.learnt, self.windows.ravel(), self.sides, self.gap])

    @property
    def parts(self) -> tuple[slice, slice, slice, slice]:
        """Where in ``frames`` learnt, windows, sides and gap are."""
        a, b, c, d = np.cumsum([len(self.learnt), self.windows.size, len(self.sides), len(self.gap)]).tolist()
        return slice(0, a), slice(a, b), slice(b, c), slice(c, d)

    @property
    def folds(self) -> Ints:
        """The fold (w,) in which each window is hidden."""
        return np.arange(len(self.windows)) % N_FOLDS

    def hidden(self, margin: int) -> Bools:
        """(folds, n) the frames to learn from that a fold's windows, and a margin around them, hide."""
        first, last = self.windows[:, :1] - margin, self.windows[:, len(self.inside) - 1, None] + margin
        within = (self.learnt >= first) & (self.learnt <= last)
        return np.stack([within[self.folds == fold].any(axis=0) for fold in range(N_FOLDS)])


@dataclass(frozen=True, kw_only=True)
class Kriged:
    """values: (L, 3) in the gap. misses: (w, m, 3) errors in the windows, truth less answer; none where w = 0.

    shape: (L,) how the variance of the bridge runs over the gap; window_shape: (m,) over a window.
    """

    values: Floats
    misses: Floats
    shape: Floats
    window_shape: Floats


class Operators:
    """``matern.bridge`` by all kernels at one frame rate, Hz; the last patterns of times that were met are kept."""

    def __init__(self, rate: float) -> None:
        lengths, noises = np.transpose(KERNELS)
        self.kernels = lengths * rate / 120.0, noises
        self.kept = lru_cache(maxsize=N_KEPT)(self._solve)

    def bridge(self, known: Ints, wanted: Ints) -> tuple[Floats, Floats]:
        """The weights (kernels, n, k) of times known (k,) at times wanted (n,), and the variances (kernels, n)."""
        return self.kept((known - wanted[0]).tobytes(), (wanted - wanted[0]).tobytes())

    def _solve(self, known: bytes, wanted: bytes) -> tuple[Floats, Floats]:
        return bridge(np.frombuffer(known, dtype=np.intp), np.frombuffer(wanted, dtype=np.intp), *self.kernels)


class Bridges:
    """The bridging operators of one layout, shared by all predictions from it."""

    def __init__(self, layout: Layout, operators: Operators) -> None:
        self.gap = operators.bridge(layout.sides, layout.gap)
        self.groups: list[tuple[Ints, Ints, Floats]] = []
        patterns, kind = np.unique(layout.beside_known, axis=0, return_inverse=True)
        for k, pattern in enumerate(patterns):
            use = np.flatnonzero(pattern)
            weights, _ = operators.bridge(layout.beside[use], layout.inside)
            self.groups.append((np.flatnonzero(kind.ravel() == k), use, weights))
        self.window_shapes = operators.bridge(layout.beside, layout.inside)[1]


def krige(features: Floats, target: Floats, layout: Layout, bridges: Bridges, hidden: Bools, floor: float) -> Kriged:
    """Predict y in the gap from features (N, p) and known target (N, 3) over ``layout.frames``; the gap is not read.

    floor: the mean square below which errors count as equal.
    """
    learnt, windows, sides, gap = layout.parts
    level, middle = target[learnt].mean(axis=0), features[learnt].mean(axis=0)
    features = features - middle
    target = target - level
    ridge = _Ridge(features[learnt], target[learnt])
    n_inside, n_windows = len(layout.inside), len(layout.windows)
    if n_windows:
        shape = n_windows, n_inside + len(layout.beside)
        residuals = _residuals(
            features[windows].reshape(*shape, -1), target[windows].reshape(*shape, 3), ridge, hidden, layout
        )
        errors = _bridged(residuals, n_inside, bridges)
        shares = _shares(errors, floor)
        misses = np.einsum("gl,glwmc->wmc", shares, errors)
    else:
        shares = np.full((len(KERNELS), len(RIDGES)), 1.0 / (len(KERNELS) * len(RIDGES)))
        misses = np.zeros((0, n_inside, 3))
    used, kernel_shares = shares.any(axis=0), shares.sum(axis=1)
    weight = np.tensordot(shares[:, used], ridge.weights(RIDGES[used]), axes=1)
    beside = kernel_shares[:, None, None] * target[sides] - features[sides] @ weight
    offsets = features[gap] @ weight.sum(axis=0) + np.matmul(bridges.gap[0], beside).sum(axis=0)
    return Kriged(
        values=level + _within(offsets, np.concatenate([target[learnt], target[sides]])),
        misses=misses,
        shape=kernel_shares @ bridges.gap[1],
        window_shape=kernel_shares @ bridges.window_shapes,
    )


def ridge(features: Floats, target: Floats, n_learnt: int, penalty: float) -> Floats:
    """What a ridge regression of target (N, 3) on features (N, p) says (N, 3), learnt from the first ``n_learnt``."""
    middle, level = features[:n_learnt].mean(axis=0), target[:n_learnt].mean(axis=0)
    offsets = features - middle
    (weights,) = _Ridge(offsets[:n_learnt], target[:n_learnt] - level).weights(np.array([penalty]))
    return np.asarray(offsets @ weights + level)


def _within(offsets: Floats, seen: Floats) -> Floats:
    """Offsets (L, 3), those longer than ``FARTHEST`` times the longest that was seen (n, 3) shortened to it."""
    length, longest = np.linalg.norm(offsets, axis=1, keepdims=True), np.linalg.norm(seen, axis=1).max()
    return np.asarray(offsets * np.minimum(1.0, FARTHEST * longest / np.maximum(length, 1e-300)))


class _Ridge:
    """Ridge regressions of target (n, 3) on features (n, p), both centred; penalties are in units of their variance."""

    def __init__(self, features: Floats, target: Floats) -> None:
        self.features, self.target = features, target
        self.gram, self.cross = features.T @ features, features.T @ target
        self.scale = 3.0 * np.trace(self.gram) / len(self.gram) or 1.0

    def weights(self, penalties: Floats, hidden: Bools | None = None) -> Floats:
        """W (λ, p, 3) for penalties (λ,), without the frames hidden (n,)."""
        gram, cross = self.gram, self.cross
        if hidden is not None:
            features = self.features[hidden]
            gram, cross = gram - features.T @ features, cross - features.T @ self.target[hidden]
        systems = gram + (self.scale * penalties)[:, None, None] * np.eye(len(gram))
        return np.stack([dposv(system.T, cross, overwrite_a=True)[1] for system in systems])


def _residuals(features: Floats, target: Floats, ridge: _Ridge, hidden: Bools, layout: Layout) -> Floats:
    """(λ, w, m + s, 3): the windows' target less the regression that did not see them."""
    found = np.empty((len(RIDGES), *target.shape))
    for fold in range(min(N_FOLDS, len(layout.windows))):
        mine = layout.folds == fold
        seen, weights = features[mine], ridge.weights(RIDGES, hidden[fold])
        guess = seen.reshape(-1, seen.shape[-1]) @ weights.swapaxes(0, 1).reshape(seen.shape[-1], -1)
        found[:, mine] = target[mine] - np.moveaxis(guess.reshape(*seen.shape[:-1], len(RIDGES), 3), 2, 0)
    return found


def _bridged(residuals: Floats, n_inside: int, bridges: Bridges) -> Floats:
    """(kernels, λ, w, m, 3): what is left of the residuals inside after bridging from beside."""
    n_ridges, n_windows = residuals.shape[:2]
    found = np.empty((len(KERNELS), n_ridges, n_windows, n_inside, 3))
    for mine, use, operators in bridges.groups:
        if not len(use):
            found[:, :, mine] = residuals[:, mine, :n_inside]
            continue
        inside, beside = residuals[:, mine, :n_inside], residuals[:, mine][:, :, n_inside + use]
        known = np.moveaxis(beside, 2, 0).reshape(len(use), -1)
        carried = np.matmul(operators, known).reshape(len(KERNELS), n_inside, n_ridges, len(mine), 3)
        found[:, :, mine] = inside - carried.transpose(0, 2, 3, 1, 4)
    return found


def _shares(errors: Floats, floor: float) -> Floats:
    """(kernels, λ): shares of sum 1, by the mean over windows of the log of the mean square error."""
    squares = np.einsum("glwmc,glwmc->glw", errors, errors) / (errors.shape[3] * errors.shape[4])
    loss = np.log(squares + floor).mean(axis=2)
    shares = np.exp(-0.5 * SHARPNESS * (loss - loss.min()))
    shares[shares < 0.02] = 0.0
    found: Floats = shares / shares.sum()
    return found


def window_offsets(length: int, rate: float, before: bool, after: bool, n_inside: int) -> tuple[Ints, Ints]:
    """The frames inside and beside a window of ``length`` frames, counted from its start; denser near its ends."""
    inside = np.unique(np.round(np.linspace(0, length - 1, min(length, n_inside))).astype(np.intp))
    beside = [-steps(rate)[::-1]] * before + [length - 1 + steps(rate)] * after
    return inside, np.concatenate([*beside, np.zeros(0, dtype=np.intp)]).astype(np.intp)


def steps(rate: float) -> Ints:
    """Which of the samples beside a gap are used, counted from it, from 1: near ones all, far ones sparsely."""
    return np.unique(np.maximum(np.round(np.array(_STEPS) * rate / 120.0), 1.0).astype(np.intp))


_STEPS = (1, 2, 3, 5, 8, 13, 21, 34)


def spread_out(candidates: Ints, n_wanted: int, apart: int) -> Ints:
    """Up to ``n_wanted`` of sorted candidates, evenly among them and at least so far apart."""
    if not len(candidates):
        return candidates
    picked = candidates[np.unique(np.round(np.linspace(0, len(candidates) - 1, n_wanted)).astype(np.intp))]
    kept = [picked[0]]
    for start in picked[1:]:
        if start >= kept[-1] + apart:
            kept.append(start)
    return np.array(kept, dtype=np.intp)
