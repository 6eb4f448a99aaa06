"""Samples whose place bounds on distances leave no choice: the joints of a limb that is stretched out straight."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds

# Slack of a stretched limb, relative to its length, that is rounding: two ends of 1 m with 1e-6 mm to spare leave a
# joint 0.03 mm of room sideways. Chosen by hand.
_ROUNDING = 1e-9


def with_determined(values: Floats, known: Bools, bounds: DistanceBounds) -> tuple[Floats, Bools]:
    """Return values (F, n) and known (F, n) with each sample that the bounds determine put in its place.

    A chain of unknown samples between two known ones is straight where its bounds sum to the distance of these. There
    the bounds have multipliers of any size, and no method of multipliers converges.
    """
    values, trusted = values.copy(), known[:, ::3].copy()
    points = values.reshape(*trusted.shape, 3)
    found = True
    while found:
        found = False
        for frames, pairs in _frames_with_equal_bounds(trusted, bounds):
            for sample, ends in _reach(trusted[frames[0]], pairs).items():
                for places, at in _straight(points, frames, ends):
                    points[places, sample], trusted[places, sample] = at, True
                    found = found or places.size > 0
    return values, np.repeat(trusted, 3, axis=1)


def _frames_with_equal_bounds(
    trusted: Bools, bounds: DistanceBounds
) -> Iterator[tuple[Ints, list[tuple[int, int, float]]]]:
    """Yield the frames (k,) that share their known samples and bounds, and these bounds as columns and length."""
    n_columns = trusted.shape[1]
    frames = bounds.first // n_columns
    order = np.argsort(frames, kind="stable")
    first, second, lengths = bounds.first[order] % n_columns, bounds.second[order] % n_columns, bounds.lengths[order]
    edges = np.flatnonzero(np.diff(frames[order], prepend=-1, append=-1))
    groups: dict[bytes, tuple[list[int], slice]] = {}
    for start, stop in pairwise(edges.tolist()):
        frame, own = int(frames[order[start]]), slice(start, stop)
        key = b"".join(part.tobytes() for part in (trusted[frame], first[own], second[own], lengths[own]))
        groups.setdefault(key, ([], own))[0].append(frame)
    for members, own in groups.values():
        yield (
            np.array(members),
            list(zip(first[own].tolist(), second[own].tolist(), lengths[own].tolist(), strict=True)),
        )


def _reach(trusted: Bools, pairs: list[tuple[int, int, float]]) -> dict[int, dict[int, float]]:
    """Return for each unknown column the known ones that it is tied to, and the shortest sum of bounds to each."""
    reach: dict[int, dict[int, float]] = {}
    links = [(a, b, length) for pair in pairs for a, b, length in (pair, (pair[1], pair[0], pair[2])) if not trusted[a]]
    shorter = True
    while shorter:
        shorter = False
        for a, b, length in links:
            own = reach.setdefault(a, {})
            for end, rest in ({b: 0.0} if trusted[b] else reach.get(b, {})).items():
                if length + rest < own.get(end, np.inf):
                    own[end], shorter = length + rest, True
    return reach


def _straight(points: Floats, frames: Ints, ends: dict[int, float]) -> Iterator[tuple[Ints, Floats]]:
    """Yield frames in which a sample tied to these ends has one place, and the places (k, 3)."""
    tied = list(ends.items())
    for i, (a, to_a) in enumerate(tied):
        if to_a == 0.0:
            yield frames, points[frames, a]
        for b, to_b in tied[:i]:
            offset = points[frames, b] - points[frames, a]
            distance = np.linalg.norm(offset, axis=1)
            taut = np.abs(to_a + to_b - distance) <= _ROUNDING * distance
            share = to_a / np.maximum(distance[taut], np.finfo(np.float64).tiny)
            yield frames[taut], points[frames[taut], a] + share[:, None] * offset[taut]
