"""Principal components of the markers near a gap, with the lost marker and without it.

    Z = (X − mean) / sd · w = S Vᵀ    z = argmin ‖ẑ_o − z V_oᵀ‖²    ẑ = z Vᵀ

X are the frames in which the lost marker and its helpers o are all trusted, about a point that travels with the body;
ẑ_o is what is seen in a frame without the marker. The weights w = exp(−d² / 2σ²) fall with the mean distance d to the
lost marker, which has a small weight itself; V has the fewest components whose singular values make up the share
``kept``, both with and without the lost columns.

Ø. Gløersen, P. Federolf, 2016, doi:10.1371/journal.pone.0152616. Strategy "R2" fills a marker at a time: of the markers
that have gaps themselves only those near by help (within ``near`` times the mean distance to all). "R1" fills all lost
markers at once from those that have no gap.

Where this departs from the print, and why:

- z is the least-squares score of what is seen. The authors take z = ẑ_o V₀ T with the components V₀ of the helpers
  alone and T = VᵀV₀, which is a change of basis only where T is symmetric, and depends on the arbitrary signs of V, V₀.
  ``scores="coded"`` does that, with the signs that make the diagonal of T positive.
- Every gap is filled on its own, by the markers that are trusted all through it; the authors pass over a marker that is
  lost in any other gap of the same one.
- Distances come from evenly spaced frames, where the authors' programs draw some at random.
- Where every marker has a gap somewhere, the point is that of an additive model of what is seen. Where too few frames
  are left to learn from, the helpers that cost most of them are left out; where too few still, a gap goes straight
  about that point, and at an end of the take stays. "R1" without three markers free of gaps does as "R2".

A gap may begin and end with a step, as in the authors' programs. Cost for each gap: O(F H² + H³) with H helpers.
"""

from collections.abc import Iterator
from dataclasses import dataclass as plain
from itertools import groupby
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.geometry.distances import mean_distances
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.numerics import interpolation
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.take import Solution, Take

REFERENCE = (
    "Ø. Gløersen, P. Federolf, 2016, Predicting missing marker trajectories in human motion data using marker "
    "intercorrelations, doi:10.1371/journal.pone.0152616"
)

_FEWEST_HELPERS = 3
_FEWEST_FRAMES = 10
_LEAST_SHARE = 0.1  # of the frames in which the lost marker is trusted, to learn from
_DISTANCE_FRAMES = 500
_FLAT = 1e-6  # a coordinate that moves this much less than the liveliest one stands still
_WEAK = 1e-2  # a combination of components that what is seen shows this much less than the best one is left alone


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """The strategy, and what counts as near."""

    strategy: Annotated[
        Literal["R2", "R1"], Field(description="R, 1, one marker at a time, or all that are lost at once")
    ] = "R2"
    bandwidth: Annotated[float, Field(gt=0, description="σ, mm, decay of the weights with distance")] = 200.0
    lost_weight: Annotated[float, Field(gt=0, le=1, description="w, 1, weight of the lost marker")] = 0.02
    near: Annotated[
        float, Field(ge=0, description="d, 1, a marker with gaps helps within this part of the mean distance (R2)")
    ] = 0.5
    kept: Annotated[
        float, Field(gt=0, lt=1, description="Σσ, 1, share of the singular values whose components are kept")
    ] = 0.99
    scores: Annotated[
        Literal["least_squares", "coded"], Field(description="z, 1, of what is seen, or as the authors' program has it")
    ] = "least_squares"


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every gap inside, and those at the ends that have helpers enough."""
    frames, columns = np.flatnonzero(take.trusted.any(axis=1)), np.flatnonzero(take.trusted.any(axis=0))
    place = np.ix_(frames, columns)
    if not fillable(take.trusted).any():
        known = np.where(take.trusted[..., None], take.positions, 0.0)
        return Solution(positions=known, filled=fillable(take.trusted), reason="nothing to fill")
    seen = take.trusted[place]
    origin = moving_origin(take.positions[place], seen)[:, None]
    local, filled, facts = fill(np.where(seen[..., None], take.positions[place] - origin, 0.0), seen, params)
    positions, answered = np.zeros_like(take.positions), np.zeros_like(take.trusted)
    positions[place], answered[place] = local + origin, filled
    return Solution(positions=positions, filled=answered, facts=facts)


@plain(frozen=True)
class Hole:
    """Frames (n,) in which markers ``lost`` are missing together, and the helpers that are trusted in all of them."""

    lost: Ints
    helpers: Ints
    frames: Ints


def fill(local: Floats, trusted: Bools, params: Params) -> tuple[Floats, Bools, dict[str, float | int | str]]:
    """Positions (F, M, 3) about a travelling point with their gaps filled, which samples are, and how many gaps how.

    In every frame and for every marker something is trusted. What is not trusted is not read.
    """
    distances, _ = mean_distances(local, trusted, _DISTANCE_FRAMES)
    estimate, filled, n_straight = np.where(trusted[..., None], local, 0.0), np.zeros_like(trusted), 0
    straight, inside = interpolation.linear(local, trusted), enclosed(trusted)
    for hole in _holes(trusted, distances, params):
        place = np.ix_(hole.frames, hole.lost)
        helpers, training = _lesson(trusted, hole)
        if helpers.size and len(training) >= _FEWEST_FRAMES:
            weights = np.exp(-np.square(distances[hole.lost].min(axis=0) / params.bandwidth) / 2.0)
            weights[hole.lost] = params.lost_weight
            used = np.concatenate([hole.lost, helpers])
            samples = local[training][:, used].reshape(len(training), -1)
            view = local[hole.frames][:, helpers].reshape(len(hole.frames), -1)
            found = _predict(samples, view, np.repeat(weights[used], 3), params)
            estimate[place], filled[place] = found.reshape(len(view), -1, 3), True
        else:
            estimate[place], filled[place] = straight[place], inside[place]
            n_straight += 1
    return np.where(trusted[..., None], local, estimate), filled & ~trusted, {"straight_gaps": n_straight}


def _holes(trusted: Bools, distances: Floats, params: Params) -> Iterator[Hole]:
    gapless: Bools = np.all(trusted, axis=0)
    complete = np.count_nonzero(trusted.all(axis=1))
    if params.strategy == "R1" and gapless.sum() >= _FEWEST_HELPERS and complete >= _FEWEST_FRAMES:
        yield Hole(np.flatnonzero(~gapless), np.flatnonzero(gapless), np.flatnonzero(~trusted.all(axis=1)))
        return
    for marker, gaps in groupby(column_runs(~trusted), key=lambda run: run[0]):
        reach = distances[marker]
        near = gapless | (reach <= params.near * reach[np.isfinite(reach)].mean())
        shared: dict[bytes, tuple[Ints, list[Ints]]] = {}
        for _, start, stop in gaps:
            present: Bools = np.all(trusted[start:stop], axis=0)
            chosen = present & near
            helpers = np.flatnonzero(chosen if chosen.sum() >= _FEWEST_HELPERS else present)
            shared.setdefault(helpers.tobytes(), (helpers, []))[1].append(np.arange(start, stop))
        for helpers, frames in shared.values():
            yield Hole(np.array([marker]), helpers, np.concatenate(frames))


def _lesson(trusted: Bools, hole: Hole) -> tuple[Ints, Ints]:
    """The helpers, fewer where they leave too little to learn from, and the frames to learn from."""
    frames = np.flatnonzero(trusted[:, hole.lost].all(axis=1))
    helpers, seen = hole.helpers, trusted[frames][:, hole.helpers]
    least = max(_FEWEST_FRAMES, _LEAST_SHARE * len(frames))
    complete: Bools = np.all(seen, axis=1)
    while helpers.size and np.count_nonzero(complete) < least:
        worst = seen.sum(axis=0).argmin()
        helpers, seen = np.delete(helpers, worst), np.delete(seen, worst, axis=1)
        complete = np.all(seen, axis=1)
    return helpers, frames[complete]


def _predict(samples: Floats, view: Floats, scale: Floats, params: Params) -> Floats:
    """The lost columns (n, l) for what is seen (n, h), from samples (N, l + h) with the weights scale (l + h,).

    A weight of 0 leaves a column out.
    """
    n_lost = samples.shape[1] - view.shape[1]
    mean, spread = samples.mean(axis=0), samples.std(axis=0)
    unit = np.where(spread > _FLAT * spread.max(), spread, 1.0)
    scaled = (samples - mean) / unit * scale
    gram = scaled.T @ scaled
    sizes, basis = _components(gram)
    sizes_seen, basis_seen = _components(gram[n_lost:, n_lost:])
    kept = max(_enough(sizes, params.kept), _enough(sizes_seen, params.kept))
    basis, basis_seen = basis[:, :kept], basis_seen[:, :kept]
    seen = (view - mean[n_lost:]) / unit[n_lost:] * scale[n_lost:]
    across = basis[n_lost:].T @ basis_seen
    if params.scores == "coded":
        signs = np.where(np.diagonal(across) < 0.0, -1.0, 1.0)
        scores = seen @ (basis_seen * signs) @ (across[: basis_seen.shape[1]] * signs)
    else:
        scores = np.linalg.lstsq(basis[n_lost:], seen.T, rcond=_WEAK)[0].T
    found: Floats = mean[:n_lost] + unit[:n_lost] / scale[:n_lost] * (scores @ basis[:n_lost, : scores.shape[1]].T)
    return found


def _components(gram: Floats) -> tuple[Floats, Floats]:
    """The singular values and the principal components (n, n) of a Gram matrix, the largest first."""
    squares, vectors = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(squares[::-1], 0.0)), vectors[:, ::-1]


def _enough(sizes: Floats, share: float) -> int:
    """The fewest components whose singular values make up this share."""
    return int(np.searchsorted(np.cumsum(sizes), share * sizes.sum())) + 1
