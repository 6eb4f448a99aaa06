"""Regression kriging in body-segment frames, several views stacked by what they miss in the take itself.

For a gap of marker k, y is its place in a frame that travels with the segment, laid on k's most rigid neighbours that
are seen all through the gap, and a_t their places in the same frame:

    y_t = μ + aᵗW + g(t) + ε      W a ridge regression, g a Matérn 5/2 process that meets the samples beside the gap

Several such views (few or many neighbours, stiff or loose frames, one that does not turn, some that bend with the pose,
those on the circle that two known distances leave) are combined with weights w ≥ 0, Σ w = 1, that minimise the mean
square error on windows: stretches as long as the gap where k is known, hidden from each view and bridged as the gap is.
The same errors give the standard deviation of every filled sample: their size, spread over the gap as the variance of g
is, and larger where the views disagree more than they do in windows.

A neighbour's rigidity is 1 / (SD of its distance to k)². Gaps of up to a twenty-fourth of a second are bridged over
time (``numerics/short_gaps.py``) and then serve as evidence. A gap whose neighbours come and go is filled in
pieces. Where many samples are lost at once, a second pass learns from what the first one filled. Bones of known length,
or pairs of markers that prove rigid, pull filled samples to where the lengths hold.

Our own; parts after N. Cressie, 1993, doi:10.1002/9781119115151 (regression kriging); W. Kabsch, 1976,
doi:10.1107/S0567739476001873 (frames); L. Breiman, 1996, doi:10.1007/BF00117832 (stacking).

Cost per gap of L frames with q neighbours: O(n q²) for n about 600 + L frames to learn and test from, and
O(q³) for 24 ridge systems in each of eight views. Nothing grows with the take but the search for windows.
"""

from dataclasses import dataclass as plain_dataclass
from dataclasses import replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.geometry.alignment import segment_frames
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.geometry.bone_projection import project_to_bone_lengths
from mocapclean.geometry.distances import distances_of_each
from mocapclean.numerics import interpolation
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.solvers.kriging.hinge_frames import hinge_frames
from mocapclean.solvers.kriging.radial_basis import nearness
from mocapclean.solvers.kriging.regression_kriging import (
    Bridges,
    Kriged,
    Layout,
    Operators,
    krige,
    ridge,
    spread_out,
    steps,
    window_offsets,
)
from mocapclean.solvers.kriging.short_gaps import bridge_short, short
from mocapclean.solvers.kriging.stacking import stacking_weights
from mocapclean.take import Solution, Take
from mocapclean.take.bones import known_bones, rigid_pairs

REFERENCE = (
    "Regression kriging in body-segment frames, stacked; this project. After N. Cressie, 1993, Statistics for spatial "
    "data, doi:10.1002/9781119115151"
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """How much is learnt from, and what counts as rigid."""

    rigidity: Annotated[
        float, Field(gt=0, description="s, mm, SD of a distance below which neighbours count as equally rigid")
    ] = 2.0
    noise: Annotated[float, Field(gt=0, description="e, mm, errors below which windows count as equal")] = 0.03
    windows: Annotated[int, Field(ge=0, description="w, 1, most windows that a gap is tried on")] = 12
    learnt: Annotated[int, Field(ge=20, description="n, 1, most frames that a gap is learnt from")] = 300
    shrinkage: Annotated[
        float, Field(ge=0, lt=1, description="c, 1, share taken off the covariances of the views' errors")
    ] = 0.3
    passes: Annotated[int, Field(ge=1, description="p, 1, most passes, where gaps learn from filled samples")] = 4
    bone_spread: Annotated[
        float, Field(ge=0, description="b, mm, largest SD of a distance that counts as a bone's length")
    ] = 0.05


@plain_dataclass(frozen=True)
class View:
    """How a gap is looked at: the frame is laid on ``n_framing`` markers (0: it only shifts), a holds ``n_features``.

    looseness: times ``rigidity``, the SD of a distance below which neighbours frame alike. hinged: the frame is that of
    a joint between two others that are at known distances from it and not from each other. n_poses: a also holds how
    near each of so many poses is.
    """

    n_framing: int
    n_features: int
    looseness: float = 1.0
    hinged: bool = False
    n_poses: int = 0


VIEWS = (
    View(12, 12, n_poses=20),
    View(6, 6),
    View(24, 24, 5.0),
    View(4, 24),
    View(0, 24),
    View(10, 10, n_poses=30),
    View(6, 12, hinged=True),
    View(12, 24, hinged=True),
)
"""What a gap is predicted from; markers are taken in the order of their rigidity."""

SHORT, SIDE, JOINT = 1.0 / 24.0, 1.0 / 3.0, 1.0 / 12.0  # seconds
N_EVIDENCE, N_INSIDE, N_SAMPLED = 8, 6, 300
MARGIN, NEAR = 3, 5  # frames at 120 Hz
APART = 0.3
FEATURE_LOOSENESS = 2.5
REACH_RATIO = 25.0
BENDING, N_HINGED, RADIUS = 5.0, 8, 10.0
SETTLED = 0.3
N_TRAVELLING, PENALTY = (6, 12), 1e-4
FEWEST = 10
MOST_LEARNT, MOST_LACKING, POOREST, CLEAN = 0.7, 0.1, 0.5, 0.05
DISAGREEMENT, CAUTION, BLIND, SURER = 0.5, 1.0, 4.0, 0.25


def solve(take: Take, params: Params, library: Dictionary | None = None, wanted: Bools | None = None) -> Solution:
    """Fill every marker and frame that has some evidence, ends of the take included.

    wanted: (F, M) bool, the samples whose gaps need an answer; the others are filled only where these learn from them.
    ``sd`` is there for every filled sample.
    """
    possible = fillable(take.trusted)
    scene = Scene(take, params)
    every = list(column_runs(possible & ~scene.known))
    asked = [(k, a, b) for k, a, b in every if wanted is None or wanted[a:b, k].any()]
    passes, heavy, gaps = 0, False, asked
    while gaps and passes < params.passes:
        before = scene.positions
        poor, pieced = scene.fill(gaps)
        passes += 1
        if poor and passes == 1:
            scene.fill([gap for gap in every if gap not in asked])
        heavy |= poor
        if passes == 1:
            gaps = every if heavy else pieced
        else:
            gaps = [gap for gap in every if scene.moved(gap, before)] if heavy else []
    filled = possible & np.isfinite(scene.sd)
    return Solution(
        positions=np.where(filled[..., None] | take.trusted[..., None], scene.positions, 0.0),
        filled=filled,
        sd=np.where(filled, scene.sd, 0.0),
        reason="closed form" if passes else "nothing to fill",
        facts={"passes": passes},
    )


Gap = tuple[int, int, int]
"""Marker, first frame, frame after the last."""


class Scene:
    """A take while it is being filled.

    positions (F, M, 3): trusted, filled or guessed. known (F, M): trusted, or a bridged short gap; within (F, M): that,
    but no gap at an end; lacking (F, M): 1 where there is nothing to learn from, else 0. sd (F, M): NaN where nothing
    is filled.
    """

    def __init__(self, take: Take, params: Params) -> None:
        self.params, self.rate, self.trusted = params, take.rate, take.trusted
        self.operators = Operators(take.rate)
        self.positions = interpolation.linear(take.positions, take.trusted)
        self.mean, self.variance = distances_of_each(self.positions, take.trusted, sampled)
        self.known = take.trusted | short(take.trusted, max(1, round(SHORT * take.rate)))
        self.within: Bools = take.trusted | (self.known & enclosed(take.trusted))
        bridged = bridge_short(self.positions, take.trusted, self.known, take.rate, self.travelling)
        self.positions, self.sd = bridged
        self.lacking = np.asarray(~self.known, dtype=float)
        self.ends, self.lengths, self.spreads = stiff_bones(take, params.bone_spread)

    def fill(self, gaps: list[Gap]) -> tuple[bool, list[Gap]]:
        """Fill gaps, all from the same state. Whether one had to learn from poor frames, and those filled in pieces."""
        poor, pieced = False, []
        positions, sd = self.positions.copy(), self.sd.copy()
        for marker, start, stop in gaps:
            spans = self.pieces(marker, start, stop)
            parts = [Piece(self, marker, *span) for span in spans]
            for (first, last), part in zip(spans, parts, strict=True):
                positions[first:last, marker], sd[first:last, marker] = part.fill()
            join(positions[:, marker], spans, self.rate)
            poor |= any(part.poor for part in parts)
            if len(parts) > 1:
                pieced.append((marker, start, stop))
        self.positions, self.sd = self.held(positions, sd), sd
        self.lacking = np.asarray(~(self.known | np.isfinite(sd)), dtype=float)
        return poor, pieced

    def moved(self, gap: Gap, before: Floats) -> bool:
        """Whether a gap is filled otherwise than before (F, M, 3), by more than a share of its standard deviation."""
        marker, start, stop = gap
        step = self.positions[start:stop, marker] - before[start:stop, marker]
        return bool(np.square(step).mean() > SETTLED**2 * np.square(self.sd[start:stop, marker]).mean())

    def held(self, positions: Floats, sd: Floats) -> Floats:
        """Positions (F, M, 3), the filled ones moved to where they keep the lengths of bones, each as it is unsure."""
        filled = np.isfinite(sd)
        if not len(self.ends) or not filled.any():
            return positions
        usual = float(np.median(sd[filled])) ** 2
        precision = usual / np.where(filled, np.maximum(sd, 1e-3 * np.sqrt(usual)), 1.0) ** 2
        weights = usual / np.maximum(self.spreads, 1e-6 * np.sqrt(usual)) ** 2
        return project_to_bone_lengths(positions, filled, self.trusted, self.ends, self.lengths, weights, precision)[0]

    def rigidity(self, marker: int, looseness: float = 1.0) -> Floats:
        """The weight (M,) of every marker in the frame of one; 0 for itself and those never seen with it."""
        near = self.params.rigidity
        variance, reach = self.variance[marker] + (looseness * near) ** 2, self.mean[marker] + REACH_RATIO * near
        weights = 1.0 / (variance * reach)
        weights[marker] = 0.0
        return np.where(np.isfinite(weights), weights, 0.0)

    def travelling(self, marker: int, frames: Ints) -> BodyFrames | None:
        """The frames (n) of a segment at some frames of the take, where a regression on its markers expects another.

        Not a number where one of these is not known, or in a gap at an end of the take.
        """
        weights = self.rigidity(marker)
        near = np.argsort(-weights, kind="stable")[: max(N_TRAVELLING)]
        near = near[weights[near] > 0.0]
        told: Bools = np.asarray(self.within[:, near].all(axis=1))
        learnt = spread_out(np.flatnonzero(self.trusted[:, marker] & told), self.params.learnt, 1)
        if len(near) < 3 or len(learnt) < 2 * FEWEST:
            return None
        use = np.append(learnt, frames)
        points, framing = self.positions[use][:, near], np.arange(len(near)) < min(N_TRAVELLING)
        (laid,) = segment_frames(points, np.where(framing, weights[near], 0.0)[None], len(learnt))
        features = (laid.to_local(points) * self.scales(marker, near)[:, None]).reshape(len(use), -1)
        target = laid.to_local(self.positions[use, marker][:, None])[:, 0]
        expected = laid.to_world(ridge(features, target, len(learnt), PENALTY)[:, None])[:, 0]
        origins = np.where(told[frames, None], expected[len(learnt) :], np.nan)
        return BodyFrames(laid.axes[len(learnt) :], origins)

    def scales(self, marker: int, others: Ints, looseness: float = 1.0) -> Floats:
        """What the places of others (n,) in the frame of a marker are multiplied by: the less, the less they tell."""
        loose = max(FEATURE_LOOSENESS, looseness) * self.params.rigidity
        return np.asarray(1.0 / np.sqrt(self.variance[marker, others] + loose**2), dtype=np.float64)

    def pieces(self, marker: int, start: int, stop: int) -> list[tuple[int, int]]:
        """A gap in as few pieces as leave each with much of the evidence that its frames have."""
        weights = self.rigidity(marker)
        best = np.argsort(-weights, kind="stable")[:N_EVIDENCE]
        seen = self.known[start:stop, best]
        changes = np.flatnonzero((seen[1:] != seen[:-1]).any(axis=1)) + 1
        edges = np.concatenate([[0], changes, [stop - start]])
        found: list[tuple[int, int]] = []
        common = np.zeros(len(best), dtype=bool)
        for first, last in pairwise(edges.tolist()):
            here = seen[first]
            shared = common & here
            least = POOREST * max(weights[best] @ common, weights[best] @ here)
            if found and weights[best] @ shared >= least:
                found[-1], common = (found[-1][0], start + last), shared
            else:
                found.append((start + first, start + last))
                common = here
        return found


class Piece:
    """Frames start to stop of a gap of one marker, with the evidence that is seen in all of them.

    poor: whether it had to be learnt from frames that lack much of the evidence.
    """

    def __init__(self, scene: Scene, marker: int, start: int, stop: int) -> None:
        self.scene, self.marker, self.start, self.stop = scene, marker, start, stop
        weights = np.where(scene.known[start:stop].all(axis=0), scene.rigidity(marker), 0.0)
        order = np.argsort(-weights, kind="stable")[: max(view.n_features for view in VIEWS)]
        self.evidence = order[weights[order] > 0.0]
        self.seen = scene.known[:, marker]
        sd = scene.sd[:, marker]
        own = np.square(sd[start:stop]).mean()
        self.surer = ~self.seen & (np.square(sd) <= SURER * own)
        self.surer[start:stop] = False
        self.pair = self.hinge()
        self.poor = False

    def fill(self) -> tuple[Floats, Floats]:
        """Positions (L, 3) and SD (L,); NaN where there is no evidence."""
        n = self.stop - self.start
        if not len(self.evidence) or np.count_nonzero(self.seen) < FEWEST:
            return np.full((n, 3), np.nan), np.full(n, np.nan)
        layout = self.layout()
        bridges = Bridges(layout, self.scene.operators)
        hidden = layout.hidden(MARGIN)
        frames = layout.frames
        points = self.scene.positions[frames][:, self.evidence]
        target = self.scene.positions[frames, self.marker]
        views = self.views()
        laid = zip(views, self.frames(views, points, len(layout.learnt)), strict=True)
        looks = [self.look(*look, layout, bridges, hidden, points, target) for look in laid]
        return combine([look for look in looks if look], layout, self.scene.params)

    def views(self) -> list[View]:
        """The views that the evidence allows, each kind once."""
        n = len(self.evidence)
        usable = [replace(v, n_framing=min(v.n_framing, n), n_features=min(v.n_features, n)) for v in VIEWS]
        usable = [view for view in usable if (view.n_framing == 0 or n >= 3) and (self.pair or not view.hinged)]
        return list(dict.fromkeys(usable))

    def hinge(self) -> list[int]:
        """Which two of the evidence the marker turns between: rigid with both, these not with each other; or none."""
        scene = self.scene
        own = np.sqrt(scene.variance[self.marker, self.evidence])
        near = np.flatnonzero(own < scene.params.rigidity)[:N_HINGED]
        bending = np.sqrt(scene.variance[np.ix_(self.evidence[near], self.evidence[near])])
        bending[~np.isfinite(bending)] = 0.0
        worth = bending / (1.0 + own[near] + own[near][:, None])
        worth[bending <= BENDING * scene.params.rigidity] = 0.0
        if not worth.any():
            return []
        return sorted(int(near[k]) for k in np.unravel_index(worth.argmax(), worth.shape))

    def look(
        self,
        view: View,
        frames: BodyFrames,
        layout: Layout,
        bridges: Bridges,
        hidden: Bools,
        points: Floats,
        target: Floats,
    ) -> Kriged | None:
        """One view's answer, in the coordinates of the world; None where it is not to be had."""
        learnt, windows, _, gap = layout.parts
        radii = None
        if view.hinged:
            lengths = tuple(self.scene.mean[self.marker, self.evidence[self.pair]])
            hinged = hinge_frames(points[:, self.pair], lengths, frames, target, len(layout.learnt))
            if not hinged:
                return None
            frames, radii = hinged
        local = frames.to_local(points[:, : view.n_features]) * self.scales(view)[:, None]
        features = local.reshape(len(points), -1)
        if radii is not None:
            share = (radii / radii[learnt].mean())[:, None]
            features = np.hstack([(features - features[learnt].mean(axis=0)) * share, RADIUS * share])
        if view.n_poses:
            features = np.hstack([features, nearness(features, len(layout.learnt), view.n_poses)])
        own = frames.to_local(target[:, None])[:, 0]
        answer = krige(features, own, layout, bridges, hidden, self.scene.params.noise**2)
        turned = frames.axes[windows].reshape(*layout.windows.shape, 3, 3)[:, : len(layout.inside)]
        return Kriged(
            values=np.einsum("nij,ni->nj", frames.axes[gap], answer.values) + frames.origins[gap],
            misses=np.einsum("wmij,wmi->wmj", turned, answer.misses),
            shape=answer.shape,
            window_shape=answer.window_shape,
        )

    def frames(self, views: list[View], points: Floats, n_learnt: int) -> list[BodyFrames]:
        """The frames of each view: they travel with its framing markers, or only with the middle of all."""
        laid = list(dict.fromkeys((view.n_framing, view.looseness) for view in views if view.n_framing))
        weights = np.zeros((len(laid), len(self.evidence)))
        for row, (n, looseness) in zip(weights, laid, strict=True):
            row[:n] = self.scene.rigidity(self.marker, looseness)[self.evidence[:n]]
        turning = dict(zip(laid, segment_frames(points, weights, n_learnt), strict=True))
        shifting = BodyFrames(np.broadcast_to(np.eye(3), (len(points), 3, 3)), points.mean(axis=1))
        return [turning.get((view.n_framing, view.looseness), shifting) for view in views]

    def scales(self, view: View) -> Floats:
        """What the places of neighbours (n_features,) are multiplied by: the less, the less they tell."""
        scene, chosen = self.scene, self.evidence[: view.n_features]
        if view.n_framing:
            return scene.scales(self.marker, chosen, view.looseness)
        found: Floats = 1.0 / (scene.mean[self.marker, chosen] + REACH_RATIO * scene.params.rigidity)
        return found

    def layout(self) -> Layout:
        """What is learnt from and tried on, where possible from frames in which all evidence is known."""
        scene, n_frames = self.scene, len(self.seen)
        weights = np.zeros(len(scene.mean))
        weights[self.evidence] = scene.rigidity(self.marker)[self.evidence]
        lacking = scene.lacking @ (weights / weights.sum())
        reach = max(1, round(SIDE * scene.rate))
        usable = self.seen | self.surer
        ahead = np.flatnonzero(usable[max(0, self.start - reach) : self.start][::-1])
        behind = np.flatnonzero(usable[self.stop : self.stop + reach])
        picked = steps(scene.rate) - 1
        before = self.start - 1 - ahead[picked[picked < len(ahead)]]
        after = self.stop + behind[picked[picked < len(behind)]]
        starts, length = self.starts(lacking, len(before) > 0, len(after) > 0)
        inside, beside = window_offsets(length, scene.rate, len(before) > 0, len(after) > 0, N_INSIDE)
        places = starts[:, None] + np.append(inside, beside)
        frames = np.clip(places, 0, n_frames - 1)
        return Layout(
            learnt=self.learnt(lacking),
            windows=frames,
            inside=inside,
            beside=beside,
            beside_known=((frames == places) & self.seen[frames])[:, len(inside) :],
            sides=np.append(before[::-1], after),
            gap=np.arange(self.start, self.stop),
        )

    def learnt(self, lacking: Floats) -> Ints:
        """Frames to learn from, those that lack (F,) nothing alone if they are enough."""
        known = np.flatnonzero(self.seen)
        whole = known[lacking[known] <= 0.0]
        if len(whole) < min(self.scene.params.learnt, len(known) / 2):
            least_lacking = known[np.argsort(lacking[known], kind="stable")]
            whole = np.sort(least_lacking[: max(int(MOST_LEARNT * len(known)), FEWEST)])
            self.poor = bool(lacking[whole].mean() > CLEAN)
        return spread_out(whole, self.scene.params.learnt, 1)

    def starts(self, lacking: Floats, before: bool, after: bool) -> tuple[Ints, int]:
        """First frames of the windows and their length: that of the piece, or less where 3 do not fit."""
        length = self.stop - self.start
        edge = max(1, round(NEAR * self.scene.rate / 120.0))
        unseen, lack = np.append(0, np.cumsum(~self.seen)), np.append(0.0, np.cumsum(lacking))
        found = np.zeros(0, dtype=np.intp)
        while self.scene.params.windows and length >= 1:
            first = np.arange(edge * before, len(self.seen) - length - edge * after + 1)
            whole = unseen[first + length + edge * after] == unseen[first - edge * before]
            found = first[whole]
            if len(found):
                mean, rank = (lack[found + length] - lack[found]) / length, min(2 * length, len(found)) - 1
                found = found[mean <= max(MOST_LACKING, np.partition(mean, rank)[rank])]
            found = spread_out(found, self.scene.params.windows, max(int(APART * length), 5))
            if len(found) >= 3:
                break
            length //= 2
        return found, max(length, 1)


def combine(answers: list[Kriged], layout: Layout, params: Params) -> tuple[Floats, Floats]:
    """The stacked answer (L, 3) and its SD (L,) per coordinate, mm."""
    values = np.stack([answer.values for answer in answers])
    misses = np.stack([answer.misses for answer in answers])
    weights = stacking_weights(misses.reshape(len(answers), -1), params.shrinkage)
    stacked = np.tensordot(weights, values, axes=1)
    apart = np.square(values - stacked).mean(axis=(0, 2))
    floor = params.noise**2
    if not misses.size:
        return stacked, np.sqrt(floor + BLIND * apart)
    missed = np.tensordot(weights, misses, axes=1)
    usual = float(np.square(misses - missed).mean())
    shape = sum(w * answer.shape for w, answer in zip(weights, answers, strict=True))
    window_shape = sum(w * answer.window_shape for w, answer in zip(weights, answers, strict=True))
    size = float(np.square(missed).mean()) / float(window_shape.mean())
    longer = len(layout.gap) / (layout.inside[-1] + 1)
    unusual = np.maximum((float(apart.mean()) + floor) / (usual + floor), 1.0) ** DISAGREEMENT
    return stacked, np.sqrt(floor + CAUTION * size * shape * longer * unusual)


def stiff_bones(take: Take, largest: float) -> tuple[Ints, Floats, Floats]:
    """Columns of the ends (E, 2), lengths (E,) and their SD (E,): the skeleton's bones and the stiffest rigid pairs."""
    columns = {name: column for column, name in enumerate(take.markers)}
    known = known_bones(take.markers, take.skeleton) if take.skeleton else ()
    measured = [bone for bone in rigid_pairs(take) if bone.spread <= largest]
    bones = {frozenset((bone.start, bone.end)): bone for bone in (*measured, *known)}.values()
    ends = np.array([(columns[bone.start], columns[bone.end]) for bone in bones], dtype=np.intp).reshape(-1, 2)
    return ends, np.array([bone.length for bone in bones]), np.array([bone.spread for bone in bones])


def sampled(frames: Ints) -> Ints:
    """Up to 300 of some frames, evenly among them."""
    return spread_out(frames, N_SAMPLED, 1)


def join(track: Floats, pieces: list[tuple[int, int]], rate: float) -> None:
    """Share out the steps between pieces of a track (F, 3), in place, over a sixth of a second on both sides."""
    width = max(1.0, JOINT * rate)
    steps = [(edge, track[edge] - 2.0 * track[edge - 1] + track[max(edge - 2, 0)]) for _, edge in pieces[:-1]]
    for (start, _), (_, stop), (edge, step) in zip(pieces[:-1], pieces[1:], steps, strict=True):
        before, after = np.arange(start, edge), np.arange(edge, stop)
        track[before] += 0.5 * step * np.exp(-(edge - 1 - before) / width)[:, None]
        track[after] -= 0.5 * step * np.exp(-(after - edge) / width)[:, None]
