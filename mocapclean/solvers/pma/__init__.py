"""Probabilistic model averaging: five ways to fill a gap, each frame weighed by how likely its distances are.

    x̂ = Σ_i w_i x̂_i / Σ_i w_i    w_i = Π_k p_k(|x̂_i − P_k|),  k = 1, 2, 3

P_1, P_2, P_3 are the three markers seen all through the gap whose distance to the lost one varies least, p_k the
density of that distance where it is known. The ways are

1. ``local``: straight lines in the frame of the three markers,
2. ``polynomial``: a quadratic regression of the local coordinates on the shape of the three, |P_1 P_2| and P_3,
3. ``kernel``: a general regression network on the same shape, standardised,
4. ``linear``: a linear regression on all markers seen through the gap whose distance varies by less than ``loosest``,
5. ``pca``: strategy R2 of Gløersen and Federolf.

Each is made to meet the trusted samples on both sides by a linear ramp, one-sided at the ends of a take. The average is
moved, towards or away from P_3, P_2, P_1 in turn, until its distances lie within the 1st and 99th percentile of what is
known. Markers are filled in the order of their presence, and each then serves as a reference for the next.

M. Tits, J. Tilmanne, T. Dutoit, 2018, doi:10.1371/journal.pone.0199744.

Where this departs from the authors' program, and why:

- Nothing is filtered. Theirs passes everything through a sliding median and mean of 0.07 s, before and after, which
  moves the truth itself by up to a centimetre in quick motion. ``output_filter`` does so with what is filled.
- Where they draw frames at random to learn from, here they are evenly spread.
- The three references are the first in order that are seen all through the gap and span a plane. Where there are none,
  the ways that need none are averaged alike.
- Markers that are seldom trusted are filled, where theirs are dropped below 30 %; a marker serves as soon as it is
  filled, even in part.
- References are learnt from as they are, and local coordinates of rigid references do not become features of rounding.

Cost for each gap: O(N G) with up to N = 1000 frames to learn from and G in the gap, a least-squares problem of up to
500 × 3M, and what ``pca`` takes.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass as plain
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass
from scipy.linalg import lstsq

from mocapclean.arrays import Bools, Floats, evenly_spaced, runs
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.geometry.distances import mean_distances
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.parameters import STRICT
from mocapclean.solvers import pca
from mocapclean.solvers.fillable import fillable
from mocapclean.solvers.pma.kernels import kernel_regression, likelihood
from mocapclean.solvers.pma.sliding import median_mean
from mocapclean.solvers.pma.triads import spans, triad_frames
from mocapclean.take import Solution, Take

Way = Literal["local", "polynomial", "kernel", "linear", "pca"]

REFERENCE = (
    "M. Tits, J. Tilmanne, T. Dutoit, 2018, Robust and automatic motion-capture data recovery using soft skeleton "
    "constraints and model averaging, doi:10.1371/journal.pone.0199744"
)

_DISTANCE_FRAMES = 5000
_SHAPE_FRAMES = 1000
_LINEAR_FRAMES = 500
_DENSITY_FRAMES = 500
_FEWEST_FRAMES = 10
_FEWEST_MARKERS = 4
_SWEEPS = 5
_UNLIKELY = 1e-200
_STIFF = 1e-6  # of the greatest distance: a variation of less than this is rounding


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The ways that are averaged, and what they learn from."""

    methods: Annotated[
        tuple[Way, ...], Field(strict=False, min_length=1, description="M_i, 1, the ways that are averaged")
    ] = ("local", "polynomial", "kernel", "linear", "pca")
    spread: Annotated[float, Field(gt=0, description="s, 1, distance at which a weight of kernel is one half")] = 0.3
    loosest: Annotated[
        float, Field(gt=0, description="σ_max, mm, standard deviation of the distance to a marker that linear uses")
    ] = 50.0
    bandwidth: Annotated[float, Field(gt=0, description="σ, mm, decay with distance of the weights of pca")] = 200.0
    space_constraint: Annotated[
        bool, Field(description="c, 1, keep the distances to the references within what is known")
    ] = True
    weight_window: Annotated[
        float, Field(ge=0, description="w, s, window of the sliding median and mean of the weights")
    ] = 0.07
    output_filter: Annotated[
        float, Field(ge=0, description="f, s, window of the sliding median and mean of what is filled; 0: none")
    ] = 0.0


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every gap inside, and those at the ends that have references or helpers enough."""
    wanted = fillable(take.trusted)
    if not wanted.any():
        known = np.where(take.trusted[..., None], take.positions, 0.0)
        return Solution(positions=known, filled=wanted, reason="nothing to fill")
    place = np.ix_(np.flatnonzero(take.trusted.any(axis=1)), np.flatnonzero(take.trusted.any(axis=0)))
    seen = take.trusted[place]
    origin = moving_origin(take.positions[place], seen)[:, None]
    body = Body(np.where(seen[..., None], take.positions[place] - origin, 0.0), seen, params, take.rate)
    for marker in body.order():
        body.fill(marker)
    local = body.local
    if params.output_filter:
        width = _frames(params.output_filter, take.rate)
        local = np.where(seen[..., None], local, median_mean(local.reshape(len(local), -1), width).reshape(local.shape))
    positions, filled = np.zeros_like(take.positions), np.zeros_like(take.trusted)
    positions[place], filled[place] = local + origin, body.known & ~seen
    return Solution(positions=positions, filled=filled, facts={"gaps_without_references": body.n_alone})


def _frames(seconds: float, rate: float) -> int:
    return int(np.ceil(seconds * rate))


@plain(frozen=True)
class Gap:
    """Frames start to stop of a marker, a trusted frame on each side where there is one; ``left``, ``right``."""

    marker: int
    span: slice
    left: bool
    right: bool

    @property
    def inner(self) -> slice:
        """The frames of the gap within its span."""
        return slice(int(self.left), -1 if self.right else None)

    def bridged(self, path: Floats, first: Floats, last: Floats) -> Floats:
        """A path (n, d) over the span less the ramp between its misfits (d,) at the two ends."""
        before = first if self.left else last if self.right else np.zeros_like(first)
        after = last if self.right else before
        share = np.linspace(0.0, 1.0, len(path))[:, None]
        bridged: Floats = path - (1.0 - share) * before - share * after
        return bridged

    def meeting(self, path: Floats, known: Floats) -> Floats:
        """A path (n, d) over the span, made to meet what is known (n, d) at its ends."""
        misfit = path - known
        return self.bridged(path, misfit[0], misfit[-1])


class Body:
    """Positions (F, M, 3) about a travelling point, as they are being filled; known: (F, M), trusted or filled."""

    def __init__(self, local: Floats, trusted: Bools, params: Params, rate: float) -> None:
        self.local, self.trusted, self.params = local.copy(), trusted, params
        self.known, self.n_alone = trusted.copy(), 0
        self.distances, self.looseness = mean_distances(local, trusted, _DISTANCE_FRAMES)
        self.window = _frames(params.weight_window, rate)
        self.components = pca.fill(local, trusted, pca.Params(bandwidth=params.bandwidth))[:2]

    def order(self) -> list[int]:
        """The markers with gaps, the most present first, then by their first gap."""
        lost = ~self.trusted
        ranks = np.lexsort((lost.argmax(axis=0), lost.sum(axis=0)))
        return [int(k) for k in ranks if lost[:, k].any()]

    def fill(self, marker: int) -> None:
        """Fill all gaps of a marker, from which the gaps themselves learn nothing."""
        known, local, n_frames = self.trusted[:, marker].copy(), self.local[:, marker].copy(), len(self.known)
        lessons: dict[tuple[int, ...], Lesson] = {}
        for start, stop in runs(~self.trusted[:, marker]):
            span = slice(max(int(start) - 1, 0), min(int(stop) + 1, n_frames))
            gap = Gap(marker, span, bool(start > 0), bool(stop < n_frames))
            found = self._average(gap, lessons)
            if found is not None:
                local[start:stop], known[start:stop] = found[gap.inner], True
        self.local[:, marker], self.known[:, marker] = local, known

    def _average(self, gap: Gap, lessons: dict[tuple[int, ...], "Lesson"]) -> Floats | None:
        """The path (n, 3) over the span of a gap, or None."""
        triad = self._references(gap)
        paths = [path for path in (self._linear(gap), self._components(gap)) if path is not None]
        if triad is None:
            self.n_alone += 1
            return _even(paths) if paths else None
        if triad not in lessons:
            lessons[triad] = Lesson(self.local, self.known, self.trusted[:, gap.marker], gap.marker, triad, self.params)
        lesson = lessons[triad]
        references = self.local[gap.span][:, list(triad)].swapaxes(0, 1)
        paths = [*lesson.paths(gap, self.local[gap.span, gap.marker], references), *paths]
        if not paths:
            return None
        if not lesson.enough:
            return _even(paths)
        average = _mean(paths, [lesson.likelihood(path, references) for path in paths], self.window)
        return lesson.constrained(average, references) if self.params.space_constraint else average

    def _present(self, gap: Gap) -> Bools:
        present: Bools = np.all(self.known[gap.span], axis=0)
        present[gap.marker] = False
        return present

    def _references(self, gap: Gap) -> tuple[int, ...] | None:
        """The three stiffest markers seen all through the span that span a plane in all of it."""
        loose, far = self.looseness[gap.marker], self.distances[gap.marker]
        present = self._present(gap) & np.isfinite(loose)
        if present.sum() < 3:
            return None
        steps = np.round(loose / (_STIFF * far[present].max() or 1.0))
        first, second, *others = (int(k) for k in np.lexsort((far, steps)) if present[k])
        points = self.local[gap.span]
        for third in others:
            if spans(points[:, first], points[:, second], points[:, third]):
                return first, second, third
        return None

    def _linear(self, gap: Gap) -> Floats | None:
        """A linear regression on the markers that are seen all through the span."""
        if "linear" not in self.params.methods:
            return None
        present = np.flatnonzero(self._present(gap))
        stiff = present[self.looseness[gap.marker, present] <= self.params.loosest]
        chosen = stiff if stiff.size else present
        frames = np.flatnonzero(self.trusted[:, gap.marker] & np.all(self.known[:, chosen], axis=1))
        if len(present) < _FEWEST_MARKERS or len(frames) < _FEWEST_FRAMES:
            return None
        frames = frames[evenly_spaced(len(frames), _LINEAR_FRAMES)]
        features, values = self.local[frames][:, chosen].reshape(len(frames), -1), self.local[frames, gap.marker]
        middle, centre = features.mean(axis=0), values.mean(axis=0)
        slopes = lstsq(features - middle, values - centre, cond=_STIFF, lapack_driver="gelsy", check_finite=False)[0]
        path = centre + (self.local[gap.span][:, chosen].reshape(-1, 3 * len(chosen)) - middle) @ slopes
        return gap.meeting(path, self.local[gap.span, gap.marker])

    def _components(self, gap: Gap) -> Floats | None:
        """What pca makes of it: it answers for the gap alone, so its first and last frame stand for the ends."""
        estimate, filled = self.components
        if "pca" not in self.params.methods or not filled[gap.span, gap.marker][gap.inner].all():
            return None
        path, known = estimate[gap.span, gap.marker], self.local[gap.span, gap.marker]
        inside = path[gap.inner]
        bridged = gap.bridged(path, inside[0] - known[0], inside[-1] - known[-1])
        return np.concatenate([known[: gap.left], bridged[gap.inner], known[len(known) - gap.right :]])


def _even(paths: list[Floats]) -> Floats:
    return np.asarray(np.mean(paths, axis=0))


def _mean(paths: list[Floats], likelihoods: list[Floats], window: int) -> Floats:
    """The mean of paths (n, 3) by their likelihoods (n,), smoothed over a window of frames."""
    n_frames = len(paths[0])
    weights = np.maximum(np.array(likelihoods), _UNLIKELY).T
    weights = median_mean(weights, min(window, (n_frames - 1) // 2))
    average: Floats = np.einsum("ni,ind->nd", weights, np.array(paths)) / weights.sum(axis=1, keepdims=True)
    return average


class Lesson:
    """What is known of a marker beside three references.

    enough: whether it is seen together with them often enough to learn more than a line.
    """

    def __init__(
        self, local: Floats, known: Bools, trusted: Bools, marker: int, triad: tuple[int, ...], params: Params
    ) -> None:
        frames = np.flatnonzero(trusted & np.all(known[:, list(triad)], axis=1))
        self.params, self.enough = params, len(frames) >= _FEWEST_FRAMES
        if not self.enough:
            return
        chosen = frames[evenly_spaced(len(frames), _SHAPE_FRAMES)]
        references = local[chosen][:, list(triad)].swapaxes(0, 1)
        place = _local(references, local[chosen, marker])
        self.centre, self.scale = place.mean(axis=0), place.std(axis=0)
        self.scale = np.where(self.scale > 0.0, self.scale, 1.0)
        shape = _shape(references)
        self.size = float(np.abs(shape).max())
        self.linear, self.quadratic = Standard(shape, self.size), Standard(_products(shape), self.size**2)
        self.features, self.targets = self.linear.scale(shape), (place - self.centre) / self.scale
        design = _with_one(self.quadratic.scale(_products(shape)))
        self.slopes = lstsq(design, self.targets, cond=_STIFF, lapack_driver="gelsy", check_finite=False)[0]
        self.known = np.linalg.norm(local[frames][:, list(triad)] - local[frames, marker][:, None], axis=-1)
        self.bounds = np.quantile(self.known, [0.01, 0.99], axis=0, method="hazen")
        self.samples = self.known[evenly_spaced(len(frames), _DENSITY_FRAMES)].T

    def paths(self, gap: Gap, known: Floats, references: Floats) -> Iterator[Floats]:
        """The paths (n, 3) over a span, from the known positions (n, 3) at its ends and the references (3, n, 3)."""
        place = _local(references, known)
        ways: dict[Way, Callable[[Floats], Floats]] = {"polynomial": self._polynomial, "kernel": self._kernel}
        if "local" in self.params.methods and (gap.left or gap.right):
            yield _world(references, gap.meeting(np.zeros_like(place), place))
        for way, predict in ways.items():
            if self.enough and way in self.params.methods:
                path = self.centre + self.scale * predict(_shape(references))
                yield _world(references, gap.meeting(path, place))

    def _polynomial(self, shape: Floats) -> Floats:
        found: Floats = _with_one(self.quadratic.scale(_products(shape))) @ self.slopes
        return found

    def _kernel(self, shape: Floats) -> Floats:
        return kernel_regression(self.features, self.targets, self.linear.scale(shape), self.params.spread)

    def likelihood(self, path: Floats, references: Floats) -> Floats:
        """How likely the distances of a path (n, 3) to the references (3, n, 3) are: (n,)."""
        distances = np.linalg.norm(references - path, axis=-1)
        found: Floats = np.prod([likelihood(s, d) for s, d in zip(self.samples, distances, strict=True)], axis=0)
        return found

    def constrained(self, path: Floats, references: Floats) -> Floats:
        """The path moved along its lines to the references until its distances are within what is known."""
        path = path.copy()
        least, most = self.bounds
        for _ in range(_SWEEPS):
            distances = np.linalg.norm(references - path, axis=-1)
            astray = np.flatnonzero(((distances < least[:, None]) | (distances > most[:, None])).any(axis=0))
            if not astray.size:
                break
            for k in (2, 1, 0):
                arms = path[astray] - references[k, astray]
                length = np.linalg.norm(arms, axis=-1, keepdims=True)
                allowed = np.clip(length, least[k], most[k])
                path[astray] = references[k, astray] + arms * (allowed / np.where(length > 0.0, length, 1.0))
        return path


class Standard:
    """Features (N, k) to a mean of 0 and a standard deviation of 1; those that vary by rounding alone become 0."""

    def __init__(self, features: Floats, size: float) -> None:
        spread = features.std(axis=0)
        self.mean, self.spread = features.mean(axis=0), np.where(spread > _STIFF * size, spread, np.inf)

    def scale(self, features: Floats) -> Floats:
        """Other features (n, k) in the same terms."""
        scaled: Floats = (features - self.mean) / self.spread
        return scaled


def _local(references: Floats, positions: Floats) -> Floats:
    """Positions (n, 3) in the frames of the references (3, n, 3)."""
    return triad_frames(*references).to_local(positions[:, None])[:, 0]


def _world(references: Floats, positions: Floats) -> Floats:
    return triad_frames(*references).to_world(positions[:, None])[:, 0]


def _shape(references: Floats) -> Floats:
    """The shape (n, 3) of the references: |P_1 P_2| and the two coordinates of P_3 in their plane."""
    length = np.linalg.norm(references[1] - references[0], axis=-1)
    third = _local(references, references[2])
    return np.column_stack([length, third[:, 0], third[:, 2]])


def _products(shape: Floats) -> Floats:
    """The features (n, 9) of a quadratic function of three."""
    first, second = np.triu_indices(3)
    return np.hstack([shape, shape[:, first] * shape[:, second]])


def _with_one(features: Floats) -> Floats:
    return np.hstack([np.ones((len(features), 1)), features])
