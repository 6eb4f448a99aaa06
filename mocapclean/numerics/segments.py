"""Where each marker should be by the markers around it: a ridge regression in the frame of its body segment.

For every marker its most rigid partners span a frame, in which most of the motion is gone; in it the marker's place is
regressed on theirs. The regression is robust: what it cannot explain counts little in the next fit. On request it also
looks for the frame from which on a marker sits elsewhere in its segment for good: a step is added to the regression,
and the frame where it explains most is taken.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mocapclean.numerics import interpolation
from mocapclean.numerics.robust import nan_median
from mocapclean.numerics.segment_frames import rotations

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.intp]

_SAMPLE = 300
_ENOUGH = 10
_PARTNERS = 10
_SLACK, _NEAR = 10.0, 50.0
_TRAIN = 800
_FITS = 3
_FLOOR = 0.5
_PENALTIES = np.logspace(-6, 1, 15)
_LEAST = 1e-100  # its square is still a number
_CANDIDATES, _EDGE, _FEWEST = 80, 0.08, 10
_BETWEEN, _BELIEVED = 0.1, 0.4
_LONGEST_LAG = 200


@dataclass(frozen=True)
class Rigidity:
    """Median and robust SD (M, M) of the distances between markers; an infinite SD where too seldom seen together."""

    distance: Floats
    spread: Floats

    def partners(self, marker: int) -> tuple[Ints, Floats]:
        """The up to 10 markers that say most of where one is, and how much: 1 / (SD² + slack²) / (distance + 50)."""
        weights = 1.0 / (self.spread[marker] ** 2 + _SLACK**2) / (self.distance[marker] + _NEAR)
        weights[marker] = 0.0
        order = np.argsort(-weights, kind="stable")[:_PARTNERS]
        chosen = order[weights[order] > 0]
        return chosen, weights[chosen]


def rigidity(positions: Floats, trusted: Bools) -> Rigidity:
    """The rigidity of all pairs, over up to 300 frames of positions (F, M, 3)."""
    frames = _spaced(np.arange(len(trusted)), _SAMPLE)
    known = np.where(trusted[frames, :, None], positions[frames], np.nan)
    n_markers = positions.shape[1]
    distance, spread = np.zeros((n_markers, n_markers)), np.full((n_markers, n_markers), np.inf)
    for a in range(n_markers - 1):
        offset = known[:, a + 1 :] - known[:, [a]]
        apart = np.sqrt(np.einsum("fmc,fmc->fm", offset, offset))
        seen = np.isfinite(apart).sum(axis=0) >= min(_ENOUGH, len(frames))
        middle = nan_median(apart)
        deviation = 1.4826 * nan_median(np.abs(apart - middle))
        distance[a, a + 1 :] = distance[a + 1 :, a] = np.where(seen, middle, 0.0)
        spread[a, a + 1 :] = spread[a + 1 :, a] = np.where(seen, deviation, np.inf)
    return Rigidity(distance, spread)


def lay(shape: Floats, seen: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """The rotations (F, 3, 3) and centres (F, 3) that lay a shape (K, 3) on what is seen of it (F, K, 3).

    By weighted (K,) least squares. Local coordinates are ``(x - centre) @ rotation``.
    """
    share = weights / weights.sum()
    centres = np.tensordot(seen, share, axes=(1, 0))
    model = share[:, None] * (shape - share @ shape)
    return rotations((seen - centres[:, None]).swapaxes(1, 2) @ model), centres


@dataclass(frozen=True)
class Step:
    """From frame ``start`` on a marker sits ``offset`` (3,) mm from where it sat, in its segment's frame.

    score: the size of the step over its standard error. sudden: whether it is made within a frame. bends: whether it
    changes a length that is constant otherwise.
    """

    marker: int
    start: int
    offset: Floats
    score: float
    sudden: bool = False
    bends: bool = False


@dataclass(frozen=True)
class Prediction:
    """What the others say of each marker.

    residual: (F, M, 3) mm, the marker less what is expected, in its segment's frame; expected: (F, M, 3) mm, in the
    world; rotation: (F, M, 3, 3), segment to world; known: (M,), whether anything is said; steps: the best of each
    marker, if they were asked for.
    """

    residual: Floats
    expected: Floats
    rotation: Floats
    known: Bools
    steps: tuple[Step, ...] = ()


def predict(
    positions: Floats, usable: Bools, rigid: Rigidity, *, slide: int | None = None, only: Bools | None = None
) -> Prediction:
    """Predict every marker (or only some, (M,) bool) in every frame from its partners.

    positions: (F, M, 3), finite everywhere. usable: (F, M), the samples to learn from. slide: how many frames a step
    may take, None where steps are not asked for. A marker with fewer than 3 partners or too few usable frames is not
    predicted: it is expected where the mean of all markers goes.
    """
    n_frames, n_markers = usable.shape
    expected = np.repeat(positions.mean(axis=1, keepdims=True), n_markers, axis=1)
    rotation = np.broadcast_to(np.eye(3), (n_frames, n_markers, 3, 3)).copy()
    residual = positions - expected
    known, steps = np.zeros(n_markers, dtype=bool), []
    for marker in range(n_markers) if only is None else np.flatnonzero(only).tolist():
        partners, weights = rigid.partners(marker)
        train = _spaced(np.flatnonzero(usable[:, marker]), _TRAIN)
        if len(partners) < 3 or len(train) < _ENOUGH:
            continue
        known[marker] = True
        turn, centre = _segment(positions[:, partners], weights, train)
        local = ((positions[:, partners] - centre[:, None]) @ turn).reshape(n_frames, -1)
        local /= np.repeat(np.sqrt(rigid.spread[marker, partners] ** 2 + 25.0), 3)
        target = ((positions[:, marker] - centre)[:, None] @ turn)[:, 0]
        guess = _regress(local, target, train)
        residual[:, marker], rotation[:, marker] = target - guess, turn
        expected[:, marker] = (guess[:, None] @ turn.swapaxes(1, 2))[:, 0] + centre
        rows = None if slide is None else slide * len(train) // int(train[-1] - train[0] + 1)
        found = None if rows is None else _best_step(local[train], target[train], rows)
        if found:
            steps.append(Step(marker, int(train[found.start]), found.offset, found.score))
    return Prediction(residual, expected, rotation, known, tuple(steps))


def complete(positions: Floats, usable: Bools, rigid: Rigidity) -> Floats:
    """Positions (F, M, 3) with what is not usable replaced: as expected, plus the residual carried over the gap."""
    filled = interpolation.linear(positions, usable)
    if usable.all():
        return filled
    found = predict(filled, usable, rigid, only=np.asarray(~usable.all(axis=0)))
    carried = interpolation.linear(found.residual, usable)
    better = found.expected + (found.rotation @ carried[..., None])[..., 0]
    return np.where((~usable & found.known & usable.any(axis=0))[..., None], better, filled)


def _segment(seen: Floats, weights: Floats, train: Ints) -> tuple[Floats, Floats]:
    """The frames of a segment over all frames, about the mean shape of its partners over the training frames."""
    shape = seen[train[len(train) // 2]]
    for _ in range(2):
        turn, centre = lay(shape, seen[train], weights)
        shape = ((seen[train] - centre[:, None]) @ turn).mean(axis=0)
    return lay(shape, seen, weights)


def _spaced(frames: Ints, most: int) -> Ints:
    if len(frames) <= most:
        return frames
    return np.asarray(frames[np.linspace(0, len(frames) - 1, most).astype(int)])


def _regress(features: Floats, target: Floats, train: Ints) -> Floats:
    """Ridge regression of target (F, 3) on features (F, n), learned robustly from some frames, for all frames.

    Frames weigh 1 / (1 + (r / 3s)²)² by their residual r and its median s (Geman and McClure, 1985).
    """
    inputs, wanted = features[train], target[train]
    weights = np.ones(len(train))
    for _ in range(_FITS):
        share = weights / weights.sum()
        mean, middle = share @ inputs, share @ wanted
        slopes = _Ridge(inputs - mean, wanted - middle, weights).slopes(wanted - middle)
        weights = _confidence(np.linalg.norm(wanted - middle - (inputs - mean) @ slopes, axis=1))
    return np.asarray(middle + (features - mean) @ slopes)


def _confidence(missed: Floats) -> Floats:
    return np.asarray(1.0 / (1.0 + (missed / (3.0 * np.median(missed) + _FLOOR)) ** 2) ** 2)


class _Ridge:
    """Weighted ridge regression on inputs (n, d); its penalty is chosen for wanted (n, 3) by generalised cross-
    validation with a tenth of the frames counted, for neighbouring frames say nearly the same.
    """

    def __init__(self, inputs: Floats, wanted: Floats, weights: Floats) -> None:
        self.weighted = weights[:, None] * inputs
        values, vectors = np.linalg.eigh(self.weighted.T @ inputs)
        values = np.maximum(values, 0.0)
        self.vectors = vectors
        projected = vectors.T @ (self.weighted.T @ wanted)
        penalties = _PENALTIES[:, None] * max(values[-1], _LEAST)
        freedom = (values / (values + penalties)).sum(axis=1)
        energy = (weights[:, None] * wanted**2).sum()
        gain = ((projected**2).sum(axis=1) * (values + 2 * penalties) / (values + penalties) ** 2).sum(axis=1)
        counted = max(len(wanted) / 10.0, 5.0)
        score = (energy - gain) / np.maximum(1 - freedom / counted, 0.05) ** 2
        best = int(np.argmin(np.where(freedom < 0.95 * counted, score, np.inf)))
        self.shrunk = values + penalties[best]

    def slopes(self, wanted: Floats) -> Floats:
        return np.asarray(self.vectors @ ((self.vectors.T @ (self.weighted.T @ wanted)) / self.shrunk[:, None]))


@dataclass(frozen=True)
class _StepFit:
    """The row from which on there is an offset (3,), that over its standard error, and the trust (n,) in rows."""

    start: int
    offset: Floats
    score: float
    weights: Floats


def _best_step(inputs: Floats, wanted: Floats, slide: int) -> _StepFit | None:
    """The row from which on a constant offset explains most beside a ridge regression.

    The step is made at once, or by a slide of some rows: then the rows about it are left out before it is fitted, for
    the inputs take a slide for motion. What has the higher score counts, of what the rows of both sides agree with.
    """
    n_rows = len(wanted)
    edge = max(_FEWEST, round(_EDGE * n_rows))
    if n_rows < 4 * edge:
        return None
    starts = np.unique(np.linspace(edge, n_rows - edge, _CANDIDATES).astype(int))
    rough = _fit_step(inputs, wanted, starts, _StepFit(0, np.zeros(3), 0.0, np.ones(n_rows)))
    at_once = _fit_step(inputs, wanted, starts, rough)
    slide = min(slide, int(_BETWEEN * n_rows))
    away = np.abs(np.arange(n_rows) - rough.start) > slide
    slid = _fit_step(inputs, wanted, np.array([rough.start]), replace(rough, weights=rough.weights * away))
    fits = []
    for fit in (at_once, slid):
        reach = 1 + n_rows // _CANDIDATES
        near = np.arange(max(edge, fit.start - reach), min(n_rows - edge, fit.start + reach) + 1)
        fits.append(_fit_step(inputs, wanted, near, fit))
    return max((fit for fit in fits if _believed(fit, slide)), key=lambda fit: fit.score, default=None)


def _believed(fit: _StepFit, slide: int) -> bool:
    """Whether the rows of both sides of a step, those of the slide aside, agree with it."""
    away = np.arange(len(fit.weights)) - fit.start
    sides = (fit.weights[away < -slide], fit.weights[away > slide])
    return all(side.size > 0 and float(side.mean()) >= _BELIEVED for side in sides)


def _fit_step(inputs: Floats, wanted: Floats, starts: Ints, last: _StepFit) -> _StepFit:
    """The best of the steps from starts (k,) on, with the weights of the last fit, and the penalty without its step."""
    weights, rows = last.weights, np.arange(len(wanted))[:, None]
    share = weights / weights.sum()
    steps, taken = (rows >= starts).astype(float), (rows >= last.start) * last.offset
    features, target, steps, taken = (x - share @ x for x in (inputs, wanted, steps, taken))
    ridge = _Ridge(features, target - taken, weights)
    left, own = target - features @ ridge.slopes(target), steps - features @ ridge.slopes(steps)
    said = own.T @ (weights[:, None] * target)
    room = np.maximum((weights[:, None] * steps * own).sum(axis=0), 1e-9)
    best = int(np.argmax((said**2).sum(axis=1) / room))
    offset = said[best] / room[best]
    left = left - own[:, [best]] * offset
    weights = _confidence(np.linalg.norm(left, axis=1))
    noise = weights[:, None] * left
    variance = (noise**2).sum() / weights.sum() + _FLOOR**2
    score = np.linalg.norm(offset) * np.sqrt(room[best] / (variance * _correlation_time(noise)))
    return _StepFit(int(starts[best]), offset, float(score), weights)


def _correlation_time(noise: Floats) -> float:
    """How many rows of noise (n, 3) count as one: 1 + 2 Σ of the autocorrelation to where it falls below 0.1."""
    energy = max(float((noise**2).sum()), np.finfo(float).tiny)
    total = 1.0
    for lag in range(1, min(_LONGEST_LAG, len(noise) // 4)):
        share = float((noise[lag:] * noise[:-lag]).sum()) / energy
        if share < 0.1:
            break
        total += 2.0 * share
    return total
