"""Plain paths of joints over gaps: where the rotations beside a gap lead by themselves, and how far off that is.

Over a gap between known frames, the plain path lies between the straight turn (slerp) and the cubic h that meets the
velocities of both sides: s exp(c log(s⁻¹ h)) with the c that errs least on stretches of this length in this very take.
At the first or last frames it goes on with the velocity beside the gap, or with a share of it.
"""

from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced, runs
from mocapclean.geometry.joint_motion import conjugate, from_vectors, rotation_vectors, straight_turns, times

_LAG = 2
"""Frames over which the velocity beside a gap is measured. By hand: one frame has twice the noise, more are late."""
_FEWEST_STRETCHES, _STRETCHES = 20, 200
"""Stretches of a take from which an error is measured: with fewer than the first number it is not known. By hand."""
_FINEST = 1e-3
"""Degrees below which a difference between two paths shows nothing of which is right. Chosen by hand."""
_WHOLE = 360.0
"""Degrees of a whole turn."""


class Plain(NamedTuple):
    """The plain path over a gap of n frames.

    path: (n, 4). sd: (n,) degrees, the RMS error about an axis; infinite where the take has too few stretches.
    """

    path: Floats
    sd: Floats


def plain_path(rotations: Floats, known: Bools, start: int, stop: int) -> Plain:
    """Return the plain path of a joint's rotations (F, 4) over unknown frames of ``known`` (F,), from start to stop."""
    # The whole run of unknown frames; its part from start to stop is returned.
    first, last = _run(known, start)
    part = slice(start - first, stop - first)
    span = slice(max(first - 1, 0), last + 1)
    path = straight_turns(rotations[span], ~known[span])[first - span.start : last - span.start]
    length = last - first
    stretches = _stretches(known, length)
    if len(stretches) < _FEWEST_STRETCHES:
        return Plain(path[part], np.full(stop - start, np.inf))
    if first == 0 or last == len(known):
        path, sd = _glide(rotations, known, first, last, stretches)
        return Plain(path[part], sd[part])
    share, errors = _share_of_cubic(rotations, stretches, length)
    error = errors[0]
    sides = [*range(first - 1 - _LAG, first), *range(last, last + 1 + _LAG)]
    if sides[0] >= 0 and sides[-1] < len(known) and known[sides].all():
        cubic = _cubic(rotations, np.array([first]), length, np.arange(1, length + 1))[0]
        path = times(path, from_vectors(share * rotation_vectors(times(conjugate(path), cubic))))
        error = errors[1]
    # The error in the middle, and 4 x (1 - x) of it at the share x of the gap
    shares = np.arange(1, length + 1) / (length + 1)
    return Plain(path[part], (error * 4.0 * shares * (1.0 - shares))[part])


def _run(known: Bools, frame: int) -> tuple[int, int]:
    """Return the run of unknown frames that a frame lies in."""
    found = runs(~known)
    index = int(np.searchsorted(found[:, 0], frame, side="right")) - 1
    return int(found[index, 0]), int(found[index, 1])


def _stretches(known: Bools, length: int) -> Ints:
    """Return the starts of stretches of some frames in which, and beside which, a joint is known."""
    beside = 1 + _LAG
    starts = np.arange(beside, len(known) - length - beside + 1)
    complete = np.concatenate([[0], np.cumsum(known)])
    whole = complete[starts + length + beside] - complete[starts - beside] == length + 2 * beside
    starts = starts[whole]
    return np.asarray(starts[evenly_spaced(len(starts), _STRETCHES)])


def _glide(rotations: Floats, known: Bools, first: int, last: int, stretches: Ints) -> tuple[Floats, Floats]:
    """Return the path (n, 4) over an open run from first to last, and its error (n,), degrees, about an axis.

    With v the turn per frame beside the run and d the frames since, it turns by d v (1 - (1 - c) d / n). So it begins
    with v, and has turned by c n v in the end. c is the least-squares answer on stretches, within 0 to 1. The error
    grows with d.
    """
    length, forwards = last - first, first > 0
    # Time runs backwards before the first known frame.
    towards = rotations if forwards else rotations[::-1]
    seen = known if forwards else known[::-1]
    begin = first if forwards else len(known) - last
    starts = stretches if forwards else len(known) - stretches - length
    share, error = _share_of_velocity(towards, starts, length)
    since = np.arange(1, length + 1)
    velocity = np.zeros(3)
    if begin > _LAG and seen[begin - 1 - _LAG : begin].all():
        velocity = rotation_vectors(times(conjugate(towards[begin - 1 - _LAG]), towards[begin - 1])) / _LAG
    turns = (since * (1.0 - (1.0 - share) * since / length))[:, None] * velocity
    path, errors = times(towards[begin - 1], from_vectors(turns)), error * since / length
    return (path, errors) if forwards else (path[::-1], errors[::-1])


def _share_of_velocity(rotations: Floats, starts: Ints, length: int) -> tuple[float, float]:
    """Return the share c of n frames' turn that a joint makes in n frames, and the RMS error about an axis, degrees."""
    left = starts - 1
    turned = rotation_vectors(times(conjugate(rotations[left]), rotations[left + length]))
    steady = length * rotation_vectors(times(conjugate(rotations[left - _LAG]), rotations[left])) / _LAG
    turned = _wound(turned, steady)
    share = float(np.clip((turned * steady).sum() / max(float((steady**2).sum()), _FINEST**2), 0.0, 1.0))
    return share, float(np.sqrt(((turned - share * steady) ** 2).mean()))


def _share_of_cubic(rotations: Floats, starts: Ints, length: int) -> tuple[float, tuple[float, float]]:
    """Return the share c of the cubic, and the RMS errors about an axis of the straight turn and plain path.

    c is the least-squares answer to log(s⁻¹ q) = c log(s⁻¹ h) in the middle of stretches, within 0 to 1; degrees.
    """
    step = np.array([length // 2 + 1])
    left, right = rotations[starts - 1], rotations[starts + length]
    turn = rotation_vectors(times(conjugate(left), right))
    straight = times(left, from_vectors(step / (length + 1) * turn))
    true, bent = (
        rotation_vectors(times(conjugate(straight), path))
        for path in (rotations[starts + length // 2], _cubic(rotations, starts, length, step)[:, 0])
    )
    share = float(np.clip((true * bent).sum() / max(float((bent**2).sum()), _FINEST**2), 0.0, 1.0))
    without, with_cubic = (float(np.sqrt((each**2).mean())) for each in (true, true - share * bent))
    return share, (without, with_cubic)


def _cubic(rotations: Floats, starts: Ints, length: int, steps: Ints) -> Floats:
    """Return cubic paths (n, m, 4) over gaps at these steps after the last known frame, with both velocities met.

    rotations: (F, 4). In the tangent space of the frame before the gap, with θ the turn over the gap, v and w the turns
    per frame before and after it, T the frames from side to side and u = t / T (Hermite):

        h(t) = (3 u² - 2 u³) θ + T (u - 2 u² + u³) v + T (u³ - u²) w
    """
    left, right = starts - 1, starts + length
    before = rotation_vectors(times(conjugate(rotations[left - _LAG]), rotations[left])) / _LAG
    after = rotation_vectors(times(conjugate(rotations[right]), rotations[right + _LAG])) / _LAG
    frames = length + 1
    short = rotation_vectors(times(conjugate(rotations[left]), rotations[right]))
    turn = _wound(short, frames * (before + after) / 2.0)
    u = (steps / frames)[None, :, None]
    path = (3 * u**2 - 2 * u**3) * turn[:, None]
    path = path + frames * ((u - 2 * u**2 + u**3) * before[:, None] + (u**3 - u**2) * after[:, None])
    return times(rotations[left][:, None], from_vectors(path))


def _wound(turns: Floats, expected: Floats) -> Floats:
    """Return turns (n, 3), degrees, with as many whole turns added about their axes as come nearest to the expected."""
    sizes = np.linalg.norm(turns, axis=1, keepdims=True)
    guesses = np.linalg.norm(expected, axis=1, keepdims=True)
    # A turn of nearly nothing has the axis of the expected one.
    along = np.where(sizes > _FINEST, turns, expected)
    axes = along / np.maximum(np.where(sizes > _FINEST, sizes, guesses), _FINEST)
    missing = ((expected - turns) * axes).sum(axis=1, keepdims=True)
    return np.asarray(turns + _WHOLE * np.round(missing / _WHOLE) * axes)
