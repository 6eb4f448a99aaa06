"""Find pops: frames in which a path leaves abruptly and comes back, while it is smooth when they are left out."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.joints.signals import Signals

REACH = 4
"""Frames on each side of an excursion that show how the path moves without it. Chosen by hand."""
LONGEST_SECONDS = 0.25
"""Seconds that a pop lasts at most, from the requirement."""
LONGEST_FRAMES = 12
"""Frames that a pop may last at low rates, where a quarter of a second has fewer. Chosen by hand."""
LEAST = 4.0
"""Degrees, or their equal in mm, that a path must leave by. Chosen on the takes at even places, at 24 to 120 Hz."""
ROUGHNESS = 1.5
"""Times the largest acceleration beside the excursion that a path must leave by. Chosen likewise."""
SUSPECTED = 0.6
"""Share of the threshold from which on an excursion is a suspicion. Chosen likewise."""


@dataclass(frozen=True)
class Excursion:
    """A signal off its path in frames start to stop, by ``size``; ``score``: times its threshold."""

    signal: int
    start: int
    stop: int
    size: float
    score: float


def padded(paths: Floats, width: int) -> Floats:
    """Return paths (F + 2 width, ...) that go on at constant velocity at both ends."""
    count = np.arange(1, width + 1).reshape(-1, *[1] * (paths.ndim - 1))
    first, last = paths[1] - paths[0], paths[-1] - paths[-2]
    return np.concatenate([paths[0] - count[::-1] * first, paths, paths[-1] + count * last])


def departures(paths: Floats) -> Floats:
    """Return the distance (F, S) of each frame from what the three frames before it foretell.

    The least of three: they are constant, move at constant velocity, or at constant acceleration. 0 in the first three.
    """
    result = np.zeros(paths.shape[:2])
    steps = np.diff(paths, axis=0)
    second = np.diff(steps, axis=0)
    third = np.diff(second, axis=0)
    result[3:] = np.sqrt(np.minimum(_squares(steps[2:]), np.minimum(_squares(second[1:]), _squares(third))))
    return result


def roughness(paths: Floats) -> Floats:
    """Return the acceleration (F, S) of each frame, |x[t-1] - 2 x[t] + x[t+1]|; 0 in the first and last."""
    result = np.zeros(paths.shape[:2])
    result[1:-1] = np.sqrt(_squares(np.diff(paths, n=2, axis=0)))
    return result


def find_excursions(signals: Signals, rate: float) -> list[Excursion]:
    """Return the excursions of signals that score at least ``SUSPECTED``, none of them overlapping in one signal."""
    n_frames = len(signals.paths)
    if n_frames < 2 * 2 + 1 or not len(signals.joints):
        return []
    paths = padded(signals.paths, REACH)
    starts, ends = _abrupt(paths), _abrupt(paths[::-1])[::-1]
    longest = max(LONGEST_FRAMES, round(LONGEST_SECONDS * rate))
    found: list[Excursion] = []
    for signal in np.flatnonzero(starts.any(axis=0) & ends.any(axis=0)):
        pairs = _pairs(np.flatnonzero(starts[:, signal]), np.flatnonzero(ends[:, signal]) + 1, longest)
        pairs = pairs[(pairs[:, 0] >= REACH + 2) & (pairs[:, 1] <= len(paths) - REACH - 2)]
        if len(pairs):
            size, score = _scored(paths[:, signal], pairs, signals.part == "rotation")
            found += _best(int(signal), pairs, size, score)
    return found


def _squares(vectors: Floats) -> Floats:
    """Return the squared lengths of vectors (..., 4)."""
    return np.asarray(np.einsum("...k,...k->...", vectors, vectors))


def _abrupt(paths: Floats) -> Bools:
    """Return the frames (F, S) that depart from the frames before them as the first frame of an excursion must."""
    departure, rough = departures(paths), roughness(paths)
    # The accelerations of the frames t - 2 and t - 3 do not use frame t.
    before = np.zeros_like(rough)
    before[3:] = np.maximum(rough[1:-2], rough[:-3])
    return np.asarray(departure >= SUSPECTED * (LEAST + ROUGHNESS * before))


def _pairs(starts: Ints, stops: Ints, longest: int) -> Ints:
    """Return all pairs (start, stop) of at most ``longest`` frames."""
    first = np.searchsorted(stops, starts, side="right")
    last = np.searchsorted(stops, starts + longest, side="right")
    number = last - first
    rows = np.repeat(np.arange(len(starts)), number)
    offsets = np.arange(number.sum()) - np.repeat(np.cumsum(number) - number, number)
    return np.stack([starts[rows], stops[first[rows] + offsets]], axis=1)


def _scored(path: Floats, pairs: Ints, is_rotation: bool) -> tuple[Floats, Floats]:
    """Return the sizes and scores (P,) of the excursions of one path (F, 4) in frames start to stop of pairs (P, 2)."""
    start, stop = pairs[:, 0], pairs[:, 1]
    n_steps = (stop - start + 1.0)[:, None]
    count = np.arange(1, REACH + 1)
    left = path[start[:, None] - count]  # (P, REACH, 4): the frame next to the excursion comes first
    right = path[stop[:, None] + count - 1]
    first, last = path[start], path[stop - 1]
    if is_rotation:
        # Q and -Q are the same rotation: frames behind the excursion get the sign nearest to those before it.
        sign = np.where(np.einsum("pk,pk->p", left[:, 0], right[:, 0]) < 0, -1.0, 1.0)[:, None]
        right, last = right * sign[..., None], last * sign
    # 1. The distance from the path: from what either side foretells, and from the line that bridges the excursion.
    bridge = (right[:, 0] - left[:, 0]) / n_steps
    squares = np.minimum(_departure(first, left), _departure(last, right))
    squares = np.minimum(squares, _off_bridge(first, left, right, bridge, n_steps))
    squares = np.minimum(squares, _off_bridge(last, right, left, -bridge, n_steps))
    # 2. The roughness of the path without the excursion: the largest acceleration on each side, and how far the middle
    # of the excursion lies apart when both sides go on at their velocities.
    beside = np.concatenate([np.diff(left, n=2, axis=1), np.diff(right, n=2, axis=1)], axis=1)
    onto = np.maximum(_squares(bridge - (left[:, 0] - left[:, 1])), _squares(bridge - (right[:, 1] - right[:, 0])))
    rough = np.sqrt(np.maximum(_squares(beside).max(axis=1), onto * (n_steps[:, 0] / 2.0) ** 2))
    # 3. An excursion of several frames must be as smooth inside as outside.
    for row in np.flatnonzero(stop - start > 1):
        inside = np.diff(path[start[row] : stop[row]], axis=0)
        rough[row] = max(rough[row], np.sqrt(_squares(inside[[0, -1]] - bridge[row]).max()))
        if len(inside) > 1:
            rough[row] = max(rough[row], np.sqrt(_squares(np.diff(inside, axis=0)).max()))
    size = np.sqrt(squares)
    return size, size / (LEAST + ROUGHNESS * rough)


def _departure(frame: Floats, beside: Floats) -> Floats:
    """Return the squared distances (P,) of frames (P, 4) from what the frames beside (P, REACH, 4) foretell.

    The least of three, as in ``departures``.
    """
    near, next_, third = beside[:, 0], beside[:, 1], beside[:, 2]
    constant, linear = _squares(frame - near), _squares(frame - 2.0 * near + next_)
    return np.minimum(constant, np.minimum(linear, _squares(frame - 3.0 * near + 3.0 * next_ - third)))


def _off_bridge(frame: Floats, near: Floats, far: Floats, bridge: Floats, n_steps: Floats) -> Floats:
    """Return the squared distances (P,) of an end of the excursion (P, 4) from the bridge, straight or cubic.

    near, far: (P, REACH, 4) frames on the side of this end and on the other. bridge: (P, 4) step of the straight line.
    """
    line = _squares(frame - near[:, 0] - bridge)
    # Hermite's cubic with the velocities of both sides, at u = 1 / n of the way:
    # x = near + (3 u² - 2 u³) d + (u - 2 u² + u³) n v + (u³ - u²) n w.
    share = 1.0 / n_steps
    way = bridge * n_steps
    before, behind = near[:, 0] - near[:, 1], far[:, 1] - far[:, 0]
    cubic = near[:, 0] + (3.0 * share**2 - 2.0 * share**3) * way
    cubic = cubic + n_steps * ((share - 2.0 * share**2 + share**3) * before + (share**3 - share**2) * behind)
    return np.minimum(line, _squares(frame - cubic))


def _best(signal: int, pairs: Ints, size: Floats, score: Floats) -> list[Excursion]:
    """Return the excursions that score at least ``SUSPECTED``, the best of those that overlap."""
    found: list[Excursion] = []
    for row in np.argsort(-score, kind="stable"):
        start, stop = int(pairs[row, 0]) - REACH, int(pairs[row, 1]) - REACH
        if score[row] < SUSPECTED:
            break
        # Frames right beside an excursion are measured from it, and are none themselves.
        if all(stop < other.start or start > other.stop for other in found):
            found.append(Excursion(signal, start, stop, float(size[row]), float(score[row])))
    return found
