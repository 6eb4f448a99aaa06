"""Principal components of the markers near a gap, with the lost marker and without it.

    Z = (X − mean) / sd · w = S Vᵀ    z = argmin ‖ẑ_o − z V_oᵀ‖²    ẑ = z Vᵀ

X are the frames in which the lost marker and its helpers o are all trusted, about a point that travels with the body;
ẑ_o are the helpers in a frame without the marker. The weights w = exp(−d² / 2σ²) fall with the mean distance d to the
lost marker, which has a small weight itself; V has the fewest components whose singular values sum to the share
``kept``, both with and without the lost columns.

Ø. Gløersen, P. Federolf, 2016, doi:10.1371/journal.pone.0152616. Strategy "R2" fills a marker at a time: a marker with
gaps of its own helps only within ``near`` times the mean distance to all. "R1" fills all lost markers at once from the
markers without a gap.

Where this departs from the print, and why:

- z is the least-squares score of the helpers. The authors take z = ẑ_o V₀ T with the components V₀ of the helpers
  alone and T = VᵀV₀, which is a change of basis only where T is symmetric, and depends on the arbitrary signs of V, V₀.
  ``scores="coded"`` does that, with the signs that make the diagonal of T positive.
- Every gap is filled on its own, by the markers that are trusted all through it; the authors pass over a marker that is
  lost in any other gap of the same one.
- Distances come from evenly spaced frames, where the authors' programs draw some at random.
- Where every marker has a gap somewhere, the travelling point is that of an additive model of the trusted samples.
- Where too few frames are left to learn from, the helpers with the most missing frames are left out. Where there are
  too few still, a gap is interpolated linearly about that point, and a gap at an end of the take stays.
- "R1" without three markers free of gaps falls back to "R2".

A gap may begin and end with a step, as in the authors' programs. Cost for each gap: O(F H² + H³) with H helpers.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.geometry.distances import mean_distances
from mocapclean.numerics import interpolation
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.fillable import enclosed
from mocapclean.solvers.method import Traits
from mocapclean.solvers.travelling import TravellingTake
from mocapclean.take import Solution, Take

REFERENCE = (
    "Ø. Gløersen, P. Federolf, 2016, Predicting missing marker trajectories in human motion data using marker "
    "intercorrelations, doi:10.1371/journal.pone.0152616"
)

TRAITS = Traits(learns_from_session=True)

# No sweep of these was kept.
_FEWEST_HELPERS = 3  # markers, for a near set of helpers, and for strategy R1
_FEWEST_FRAMES = 10  # frames to learn from
_LEAST_SHARE = 0.1  # of the frames in which the lost marker is trusted, to learn from
_DISTANCE_FRAMES = 500  # most frames that the mean distances are taken over
_CONSTANT = 1e-6  # a coordinate whose SD is below this share of the largest SD counts as constant
_LEAST_SINGULAR = 1e-2  # directions of V_o with a smaller singular value than this share of the largest get no score


@parameters
class Params:
    """The strategy, and the weights of the helpers."""

    strategy: Annotated[
        Literal["R2", "R1"], About(symbol="R", text="one marker at a time, or all that are lost at once")
    ] = "R2"
    bandwidth: Annotated[
        float, Field(gt=0), About(symbol="σ", unit="mm", text="decay of the weights with distance")
    ] = 200.0
    lost_weight: Annotated[float, Field(gt=0, le=1), About(symbol="w", text="weight of the lost marker")] = 0.02
    near: Annotated[
        float,
        Field(ge=0),
        About(symbol="d", text="a marker with gaps helps within this part of the mean distance (R2)"),
    ] = 0.5
    kept: Annotated[
        float, Field(gt=0, lt=1), About(symbol="Σσ", text="share of the singular values whose components are kept")
    ] = 0.99
    scores: Annotated[
        Literal["least_squares", "coded"],
        About(symbol="z", text="scores by least squares, or as in the authors' program"),
    ] = "least_squares"


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with every enclosed gap filled, and the gaps at the ends that have enough helpers."""
    travelling = TravellingTake(take)
    local, filled, facts = fill_local(travelling.local, travelling.trusted, travelling.n_own, params)
    positions, answered = travelling.to_world(local, filled)
    return Solution(positions=positions, filled=answered, facts=facts)


@dataclass(frozen=True)
class LostBlock:
    """Frames (n,) in which the markers ``lost`` are missing together, and the helpers trusted in all of them."""

    lost: Ints
    helpers: Ints
    frames: Ints


def fill_local(
    local: Floats, trusted: Bools, n_own: int, params: Params
) -> tuple[Floats, Bools, dict[str, float | int | str]]:
    """Return positions (n, M, 3) about a travelling point with gaps filled, the filled samples (n, M), and the facts.

    The first ``n_own`` of the frames (F, M) are filled; the others are learnt from as well. In every frame and for
    every marker some sample is trusted. Untrusted samples are not read.
    """
    own, own_trusted = local[:n_own], trusted[:n_own]
    distances, _ = mean_distances(local, trusted, _DISTANCE_FRAMES)
    estimate, filled, n_straight = np.where(own_trusted[..., None], own, 0.0), np.zeros_like(own_trusted), 0
    straight, inside = interpolation.linear(own, own_trusted), enclosed(own_trusted)
    for block in _lost_blocks(own_trusted, distances, params):
        place = np.ix_(block.frames, block.lost)
        helpers, training = _training_set(trusted, block)
        if helpers.size and len(training) >= _FEWEST_FRAMES:
            # w = exp(−d² / 2σ²), and the small weight of the lost marker
            weights = np.exp(-np.square(distances[block.lost].min(axis=0) / params.bandwidth) / 2.0)
            weights[block.lost] = params.lost_weight
            used = np.concatenate([block.lost, helpers])
            samples = local[training][:, used].reshape(len(training), -1)
            observed = local[block.frames][:, helpers].reshape(len(block.frames), -1)
            predicted = _predict(samples, observed, np.repeat(weights[used], 3), params)
            estimate[place], filled[place] = predicted.reshape(len(observed), -1, 3), True
        else:
            estimate[place], filled[place] = straight[place], inside[place]
            n_straight += 1
    return np.where(own_trusted[..., None], own, estimate), filled & ~own_trusted, {"straight_gaps": n_straight}


def _lost_blocks(trusted: Bools, distances: Floats, params: Params) -> Iterator[LostBlock]:
    """Yield the blocks of lost samples: one in all (R1), or one for each marker and set of helpers (R2)."""
    gapless: Bools = np.all(trusted, axis=0)
    complete = np.count_nonzero(trusted.all(axis=1))
    if params.strategy == "R1" and gapless.sum() >= _FEWEST_HELPERS and complete >= _FEWEST_FRAMES:
        yield LostBlock(np.flatnonzero(~gapless), np.flatnonzero(gapless), np.flatnonzero(~trusted.all(axis=1)))
        return
    for marker, gaps in groupby(column_runs(~trusted), key=lambda run: run[0]):
        reach = distances[marker]
        near = gapless | (reach <= params.near * reach[np.isfinite(reach)].mean())
        # Gaps with the same helpers are filled together.
        shared: dict[bytes, tuple[Ints, list[Ints]]] = {}
        for _, start, stop in gaps:
            present: Bools = np.all(trusted[start:stop], axis=0)
            chosen = present & near
            helpers = np.flatnonzero(chosen if chosen.sum() >= _FEWEST_HELPERS else present)
            shared.setdefault(helpers.tobytes(), (helpers, []))[1].append(np.arange(start, stop))
        for helpers, frames in shared.values():
            yield LostBlock(np.array([marker]), helpers, np.concatenate(frames))


def _training_set(trusted: Bools, block: LostBlock) -> tuple[Ints, Ints]:
    """Return the helpers, fewer where they share too few frames with the lost markers, and those frames."""
    frames = np.flatnonzero(trusted[:, block.lost].all(axis=1))
    helpers, seen = block.helpers, trusted[frames][:, block.helpers]
    least = max(_FEWEST_FRAMES, _LEAST_SHARE * len(frames))
    complete: Bools = np.all(seen, axis=1)
    while helpers.size and np.count_nonzero(complete) < least:
        rarest = seen.sum(axis=0).argmin()
        helpers, seen = np.delete(helpers, rarest), np.delete(seen, rarest, axis=1)
        complete = np.all(seen, axis=1)
    return helpers, frames[complete]


def _predict(samples: Floats, observed: Floats, weights: Floats, params: Params) -> Floats:
    """Return the lost columns (n, l) for the helpers' columns (n, h), from samples (N, l + h) and weights (l + h,).

    A weight of 0 leaves a column out.
    """
    # Z = (X − mean) / sd · w
    n_lost = samples.shape[1] - observed.shape[1]
    mean, deviation = samples.mean(axis=0), samples.std(axis=0)
    unit = np.where(deviation > _CONSTANT * deviation.max(), deviation, 1.0)
    scaled = (samples - mean) / unit * weights
    # V and V₀, both with the larger of the two numbers of components
    gram = scaled.T @ scaled
    sizes, basis = _components(gram)
    sizes_seen, basis_seen = _components(gram[n_lost:, n_lost:])
    n_kept = max(_fewest_for(sizes, params.kept), _fewest_for(sizes_seen, params.kept))
    basis, basis_seen = basis[:, :n_kept], basis_seen[:, :n_kept]
    # ẑ_o, and T = VᵀV₀ over the helpers' columns
    seen = (observed - mean[n_lost:]) / unit[n_lost:] * weights[n_lost:]
    change_of_basis = basis[n_lost:].T @ basis_seen
    if params.scores == "coded":
        # z = ẑ_o V₀ T, with the signs that make the diagonal of T positive
        signs = np.where(np.diagonal(change_of_basis) < 0.0, -1.0, 1.0)
        scores = seen @ (basis_seen * signs) @ (change_of_basis[: basis_seen.shape[1]] * signs)
    else:
        # z = argmin ‖ẑ_o − z V_oᵀ‖²
        scores = np.linalg.lstsq(basis[n_lost:], seen.T, rcond=_LEAST_SINGULAR)[0].T
    # ẑ = z Vᵀ in the lost columns, back in millimetres
    predicted: Floats = mean[:n_lost] + unit[:n_lost] / weights[:n_lost] * (
        scores @ basis[:n_lost, : scores.shape[1]].T
    )
    return predicted


def _components(gram: Floats) -> tuple[Floats, Floats]:
    """Return the singular values and the principal components (n, n) of a Gram matrix, the largest first."""
    squares, vectors = np.linalg.eigh(gram)
    return np.sqrt(np.maximum(squares[::-1], 0.0)), vectors[:, ::-1]


def _fewest_for(sizes: Floats, share: float) -> int:
    """Return the fewest components whose singular values sum to this share."""
    return int(np.searchsorted(np.cumsum(sizes), share * sizes.sum())) + 1
