"""Join the parts of a gap to each other and to the known samples beside it, by kriging of their errors.

The parts are predicted one by one, so the filled path jumps where one part ends and the next begins. A jump between two
frames, beyond the mean of the velocities on both sides, is

    J = e_after − e_before + a

with e the errors of the two samples, 0 where a sample is known, and a the change of the marker's velocity from frame to
frame. The errors of a part are a Gaussian process with the SD that the part was given, independent of those of other
parts. Their conditional mean, given all jumps of the gap, is taken off (simple kriging: N. Cressie, 1993,
doi:10.1002/9781119115151). A jump of more than two SDs beside a known sample has its own square as variance (after
P. J. Huber, 1964, doi:10.1214/aoms/1177703732): the known sample may be the one that is off.
"""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints

ERROR_SCALE = 0.15
"""Time, s, over which the error of a prediction persists: the length of a Matérn covariance of smoothness 3/2.

With 0.3, 0.5 and 1.5 s the errors of gaps in neighbours lost together differed by less than 1 % from those with 0.15 s.
"""

OUTLYING = 2.0  # SDs of a jump beside a known sample, from which its variance is its own square; chosen by hand


class _Joins(NamedTuple):
    """The joins of a gap.

    before, after: (j,) the frames on both sides. parts: (j, 2) the parts that they belong to, -1 for a known sample.
    jumps: (j, 3) J, mm. variances: (j,) of a per coordinate, mm².
    """

    before: Ints
    after: Ints
    parts: Ints
    jumps: Floats
    variances: Floats


def join_parts(track: Floats, sd: Floats, known: Bools, parts: list[tuple[int, int]], rate: float) -> None:
    """Take the jumps off a trajectory (F, 3), in place, at both ends of each part (first frame, frame after the last).

    sd: (F,) per coordinate, mm; it grows, in place, where the jumps are larger than it allows. known: (F,) samples of
    the marker that do not move. The parts are in order of time.
    """
    joins = _joins(track, known, parts)
    if joins is None:
        return
    frames = np.concatenate([np.arange(*part) for part in parts])
    of_part = np.repeat(np.arange(len(parts)), [stop - start for start, stop in parts])
    scale = ERROR_SCALE * rate
    # Cov(e, J) for all samples, and Cov(J, J) = Var e_after + Var e_before + Var a, with the same errors in two joins.
    across = _signed(frames, of_part, joins, sd, scale)
    covariance = np.diag(joins.variances)
    for side, sign in ((0, -1.0), (1, 1.0)):
        own = np.flatnonzero(joins.parts[:, side] >= 0)
        at = (joins.before, joins.after)[side][own]
        covariance[own] += sign * _signed(at, joins.parts[own, side], joins, sd, scale)
    # A known sample farther away than the errors allow counts less.
    squares = np.square(joins.jumps).mean(axis=1) / OUTLYING**2
    beside_known = (joins.parts < 0).any(axis=1)
    covariance[np.diag_indices(len(covariance))] = np.where(
        beside_known, np.maximum(np.diag(covariance), squares), np.diag(covariance)
    )
    solved = np.linalg.solve(covariance, joins.jumps)
    track[frames] -= across @ solved
    # χ² of the jumps: the SD grows where they are larger than the errors should make them.
    growth = float((joins.jumps * solved).sum()) / joins.jumps.size
    sd[frames] *= np.sqrt(max(1.0, growth))


def _signed(frames: Ints, of_part: Ints, joins: _Joins, sd: Floats, scale: float) -> Floats:
    """Return the covariance (n, j) of the errors at frames (n,) of parts (n,) with the jumps."""
    total = np.zeros((len(frames), len(joins.before)))
    for at, parts, sign in ((joins.before, joins.parts[:, 0], -1.0), (joins.after, joins.parts[:, 1], 1.0)):
        distance = np.abs(frames[:, None] - at) * (np.sqrt(3.0) / scale)
        covariance = sd[frames, None] * np.where(parts >= 0, sd[at], 0.0) * (1.0 + distance) * np.exp(-distance)
        total += np.where(of_part[:, None] == parts, sign * covariance, 0.0)
    return total


def _joins(track: Floats, known: Bools, parts: list[tuple[int, int]]) -> _Joins | None:
    """Return the joins of parts with each other and with known samples; None without any."""
    owner = np.full(len(track), -2)
    owner[known] = -1
    for k, part in enumerate(parts):
        owner[slice(*part)] = k
    edges = np.unique([edge for part in parts for edge in part if 0 < edge < len(track)]).astype(np.intp)
    edges = edges[(owner[edges - 1] > -2) & (owner[edges] > -2)]
    # The velocity on a side is that of the two frames nearest the edge, if they belong together.
    sides = [_velocity(track, owner, edges - 1, -1), _velocity(track, owner, edges, 1)]
    usable = np.isfinite([side[:, 0] for side in sides]).any(axis=0)
    if not usable.any():
        return None
    edges, velocity = edges[usable], np.nanmean([side[usable] for side in sides], axis=0)
    return _Joins(
        before=edges - 1,
        after=edges,
        parts=np.stack([owner[edges - 1], owner[edges]], axis=1),
        jumps=track[edges] - track[edges - 1] - velocity,
        variances=np.full(len(edges), _own_jumps(track, known)),
    )


def _velocity(track: Floats, owner: Ints, frames: Ints, direction: int) -> Floats:
    """Return the velocity (n, 3), mm per frame, between frames (n,) and the next in a direction; NaN across parts."""
    others = np.clip(frames + direction, 0, len(track) - 1)
    together = (others != frames) & (owner[others] == owner[frames])
    return np.where(together[:, None], direction * (track[others] - track[frames]), np.nan)


def _own_jumps(track: Floats, known: Bools) -> float:
    """Return the mean square of the second differences of known samples (F,), mm² per coordinate; 0 without any.

    The velocity changes by so much from one frame to the next. Chosen among this, 4 and 16 times it, and the third
    differences: smaller ones make single gaps of 30 frames worse, larger ones leave the jumps of neighbours lost
    together.
    """
    runs = np.lib.stride_tricks.sliding_window_view(known, 3).all(axis=1)
    differences = np.diff(track, 2, axis=0)[runs]
    return float(np.square(differences).mean()) if len(differences) else 0.0
