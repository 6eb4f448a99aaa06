"""Variations of a take in which its samples stay right: things at rest or thrown, poses, pauses, cuts, other rates.

A detection rule can take each of them for a fault. Some variations have one fault of known place instead, so that all
other samples are known to be right. Sizes, times and speeds are chosen by hand after common takes; no sweep was kept.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.geometry.distances import rigidity
from mocapclean.geometry.skeleton import forward
from mocapclean.simulate.faults import inject
from mocapclean.simulate.markers import NOISE
from mocapclean.take import Take

_ONE_FAULT = 1e-3  # faults per 10,000 samples: ``inject`` makes one event of a kind at this rate
_DRIFT_SIZE = 4.0  # size of a drift in the units of ``inject``: 80 mm, which no rule overlooks
_HELD_SECONDS = 0.25  # time for which a limb is held by mistake: 30 frames at 120 Hz
_HELD_PARTNERS = 3  # markers that are held with one marker, its most rigid partners
_HELD_LEAST = 20.0  # mm, least distance that a held marker truly moves in this time
_MOST_TRIES = 100  # random places that are tried for a hold

_INSIDE = (0.01, 0.99)  # quantiles of the coordinates between which things are put
_BOX = (400.0, 300.0)  # mm, sides of the rectangle of a box's four markers
_CARRIED = 400.0  # mm by which a cup is moved
_CARRY_SECONDS = 1.0  # for which a cup is in motion
_SHORTEST_SECONDS = 2.0  # of a take in which a thing is moved, thrown or paused
_BEGIN = (0.25, 0.5)  # of the take, between which a move, a throw or a pause begins
_THROW = 6000.0  # mm/s, speed of a ball that leaves the hand; a gentle throw
_SWING_SECONDS = 0.15  # in which the hand accelerates the ball
_FLIGHT_SECONDS = 0.8  # until the ball is no longer seen
_GRAVITY = 9810.0  # mm/s², along the third axis

_HELD_POSE = 30  # frames of a pose before the motion
_STANCE_SPEED = 50.0  # mm/s, fastest marker that counts as on the ground
_WALKING_SPEED = 300.0  # mm/s, least median speed of the markers of a body that moves
_STANCE_SECONDS = 0.15  # shortest stance that is used
_SPEED_SECONDS = 0.1  # over which speeds are measured
_LOCKED = 5.0  # mm, largest distance by which a foot on the ground is moved to hold it exactly
_EASE_SECONDS = 0.25  # in which a body comes to rest before a pause, and moves off after it
_PAUSE_SECONDS = 0.75  # for which a body pauses
_APART = 1500.0  # mm between two subjects

RATES = (24, 30, 50, 100, 250, 1000)
"""Frames per second to which takes are resampled: film, games, PAL video, gait, sport and impacts."""

_SAME_RATE = 0.03  # largest relative difference of two rates that count as the same
_MOST_FRAMES = 4000  # of a take that is interpolated to a higher rate; for speed
_FEWEST_FRAMES = 60  # of a take that is left by a variation


@dataclass(frozen=True, kw_only=True)
class Variation:
    """A take made of another one.

    faulty: (F, M), the samples that are wrong; all others are right. source: (F, M), the index frame · markers +
    marker of the sample in the other take that a sample is, or is nearest to in time; -1 for samples that were added.
    """

    take: Take
    faulty: Bools
    source: Ints


def vary(take: Take, kind: str, seed: int) -> Variation | None:
    """Return a variation of a take, a key of ``VARIATIONS``; None where the take does not allow it.

    The same seed gives the same variation.
    """
    return VARIATIONS[kind](take, np.random.default_rng([seed, zlib.crc32(kind.encode())]))


def _variation(take: Take, source: Ints, faulty: Bools | None = None) -> Variation:
    take = replace(take, findings=(), origin=None)
    return Variation(take=take, source=source, faulty=np.zeros_like(take.trusted) if faulty is None else faulty)


def _sources(take: Take) -> Ints:
    """Return the index (F, M) of each sample of a take."""
    return np.arange(take.trusted.size, dtype=np.intp).reshape(take.trusted.shape)


def _as_it_is(take: Take, rng: np.random.Generator) -> Variation:
    """Return the take without a change."""
    return _variation(take, _sources(take))


# One known fault


def _with_event(take: Take, rng: np.random.Generator, kind: str, size: float) -> Variation | None:
    """Return the take with one event of ``inject``."""
    injected = inject(take, rng, (kind,), rate=_ONE_FAULT, size=size)
    faulty = injected.faulty & (injected.take.positions != take.positions).any(axis=2)
    return _variation(replace(injected.take, poses=None), _sources(take), faulty) if faulty.any() else None


def _limb_held(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take with a marker and its most rigid partners held for a quarter of a second while they move."""
    n_frames, n_markers = take.trusted.shape
    length = max(2, round(_HELD_SECONDS * take.rate))
    if n_frames < 3 * length:
        return None
    rigid = rigidity(take.positions, take.trusted)
    for _ in range(_MOST_TRIES):
        marker = int(rng.integers(n_markers))
        start = int(rng.integers(length, n_frames - 2 * length + 1))
        frames, columns = slice(start, start + length), [marker, *rigid.partners(marker)[0][:_HELD_PARTNERS]]
        if not take.trusted[start - 1 : start + length, columns].all():
            continue
        held = take.positions[start - 1, columns]
        moved = np.linalg.norm(take.positions[frames, columns] - held, axis=2)
        if moved.max(axis=0).min() < _HELD_LEAST:
            continue
        positions = take.positions.copy()
        positions[frames, columns] = held
        faulty = (positions != take.positions).any(axis=2) & take.trusted
        return _variation(replace(take, positions=positions, poses=None), _sources(take), faulty)
    return None


# Things beside the body


def _beside(take: Take, added: Floats, names: Sequence[str], seen: Bools | None = None) -> Variation:
    """Return the take with further markers (F, k, 3), seen in the frames (F, k); by default in all."""
    shape = added.shape[:2]
    seen = np.ones(shape, dtype=bool) if seen is None else seen
    nothing = np.zeros(shape, dtype=bool)
    markers = list(take.markers)
    for name in names:
        markers.append(_unused(name, markers))
    varied = replace(
        take,
        positions=np.concatenate((take.positions, added), axis=1),
        trusted=np.concatenate((take.trusted, seen), axis=1),
        filled=np.concatenate((take.filled, nothing), axis=1),
        moved=np.concatenate((take.moved, nothing), axis=1),
        detached=np.concatenate((take.detached, np.zeros(shape[1], dtype=bool))),
        markers=tuple(markers),
        poses=None,
    )
    return _variation(varied, np.concatenate((_sources(take), np.full(shape, -1, dtype=np.intp)), axis=1))


def _unused(name: str, taken: Sequence[str]) -> str:
    """Return a name that is not taken."""
    while name in taken:
        name += "_"
    return name


def _measured(take: Take, true: Floats, rng: np.random.Generator) -> Floats:
    """Return true positions with the noise of cameras; joints of a skeleton have none."""
    return true + (0.0 if take.skeleton else NOISE) * rng.standard_normal(true.shape)


def _place(take: Take, rng: np.random.Generator) -> Floats | None:
    """Return a random place (3,) in the space of the motion; None for a take in which nothing is seen."""
    if not take.trusted.any():
        return None
    low, high = np.quantile(take.positions[take.trusted], _INSIDE, axis=0)
    return np.asarray(low + rng.random(3) * (high - low))


def _still_marker(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take with a marker at rest."""
    place = _place(take, rng)
    if place is None:
        return None
    true = np.tile(place, (len(take.trusted), 1, 1))
    return _beside(take, _measured(take, true, rng), ["Floor"])


def _box(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take with the four markers of a box at rest, on a rectangle of 400 by 300 mm."""
    place = _place(take, rng)
    if place is None:
        return None
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0][:2]
    corners = np.array([[i, j] for i in (-0.5, 0.5) for j in (-0.5, 0.5)]) * _BOX @ axes
    true = np.tile(place + corners, (len(take.trusted), 1, 1))
    return _beside(take, _measured(take, true, rng), [f"Box{k}" for k in range(1, 5)])


def _cup(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take with a marker at rest that is moved once by 400 mm within a second and rests again."""
    place, seconds = _place(take, rng), len(take.trusted) / take.rate
    if place is None or seconds < _SHORTEST_SECONDS:
        return None
    begin = rng.uniform(*_BEGIN) * seconds
    # Minimum jerk: T. Flash, N. Hogan, 1985, 10 t³ − 15 t⁴ + 6 t⁵
    t = np.clip((np.arange(len(take.trusted)) / take.rate - begin) / _CARRY_SECONDS, 0.0, 1.0)
    share = 10 * t**3 - 15 * t**4 + 6 * t**5
    true = (place + _CARRIED * share[:, None] * _direction(rng))[:, None]
    return _beside(take, _measured(take, true, rng), ["Cup"])


def _ball(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take with a ball at rest that is thrown and, after a flight of 0.8 s, no longer seen."""
    place, seconds = _place(take, rng), len(take.trusted) / take.rate
    if place is None or seconds < _SHORTEST_SECONDS:
        return None
    begin = rng.uniform(*_BEGIN) * seconds
    direction = _direction(rng)
    direction[2] = abs(direction[2])
    t = np.arange(len(take.trusted)) / take.rate - begin
    # ½ a t² in the hand, then v t − ½ g t²
    swing, flight = np.clip(t, 0.0, _SWING_SECONDS), np.maximum(t - _SWING_SECONDS, 0.0)
    along = 0.5 * _THROW / _SWING_SECONDS * swing**2 + _THROW * flight
    true = place + along[:, None] * direction
    true[:, 2] -= 0.5 * _GRAVITY * flight**2
    return _beside(take, _measured(take, true[:, None], rng), ["Ball"], (flight <= _FLIGHT_SECONDS)[:, None])


def _direction(rng: np.random.Generator) -> Floats:
    """Return a random unit vector (3,)."""
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


# First and last poses


def _posed(take: Take, rng: np.random.Generator, n_frames: int, at_end: bool) -> Variation | None:
    """Return the take with the rest pose, or a pose from elsewhere in the take, held before or after the motion."""
    if len(take.trusted) < _FEWEST_FRAMES:
        return None
    pose, seen = _other_pose(take, -1 if at_end else 0)
    held = _measured(take, np.tile(pose, (n_frames, 1, 1)), rng)
    trusted = np.tile(seen, (n_frames, 1))
    nothing = np.zeros_like(trusted)
    added = np.full(trusted.shape, -1, dtype=np.intp)

    def joined(motion: Floats | Bools | Ints, addition: Floats | Bools | Ints) -> np.ndarray:
        return np.concatenate((motion, addition) if at_end else (addition, motion))

    varied = replace(
        take,
        positions=joined(take.positions, held),
        trusted=joined(take.trusted, trusted),
        filled=joined(take.filled, nothing),
        moved=joined(take.moved, nothing),
        poses=None,
    )
    return _variation(varied, joined(_sources(take), added))


def _other_pose(take: Take, beside: int) -> tuple[Floats, Bools]:
    """Return a pose (M, 3) unlike that of the frame ``beside``, at its place, and its trusted markers (M,).

    It is the rest pose of the skeleton, or without one the pose of the frame that differs most in shape.
    """
    skeleton, poses = take.skeleton, take.poses
    if skeleton is not None and poses is not None and len(skeleton.names) == len(take.markers):
        rest = np.array([0.0 if c.is_rotation else poses[beside, k] for k, c in enumerate(skeleton.channels)])
        if np.isfinite(rest).all():
            return forward(skeleton, rest[None])[0][0], np.ones(len(take.markers), dtype=bool)
    common = take.trusted & take.trusted[beside]
    count = np.maximum(common.sum(axis=1), 1)
    offsets = np.where(common[..., None], take.positions - take.positions[beside], 0.0)
    shift = offsets.sum(axis=1) / count[:, None]
    # The square of a difference in shape is that of all offsets less that of their mean.
    shape = (offsets**2).sum(axis=(1, 2)) / count - (shift**2).sum(axis=1)
    shape[common.sum(axis=1) < common.sum(axis=1).max()] = -1.0
    frame = int(np.argmax(shape))
    return take.positions[frame] - shift[frame], take.trusted[frame]


def _stances(take: Take) -> list[tuple[int, int, int]]:
    """Return (marker, start, stop) of markers that are on the ground while the body moves, in the last two thirds."""
    n_frames = len(take.trusted)
    lag = max(1, round(_SPEED_SECONDS * take.rate))
    if n_frames < max(3 * lag, _FEWEST_FRAMES):
        return []
    both = take.trusted[lag:] & take.trusted[:-lag]
    moved = np.where(both[..., None], take.positions[lag:] - take.positions[:-lag], np.nan)
    speed = np.linalg.norm(moved, axis=2) * take.rate / lag
    body = np.array([np.median(row[seen]) if seen.any() else 0.0 for row, seen in zip(speed, both, strict=True)])
    on_ground = (np.nan_to_num(speed, nan=np.inf) < _STANCE_SPEED) & (body > _WALKING_SPEED)[:, None]
    return [
        (marker, start, stop + lag)
        for marker, start, stop in column_runs(on_ground)
        if (stop - start) / take.rate >= _STANCE_SECONDS and start > max(n_frames // 3, _FEWEST_FRAMES)
    ]


def _foot_down(take: Take, rng: np.random.Generator, locked: bool) -> Variation | None:
    """Return the take up to the middle of a stance; ``locked``: the foot holds its place exactly from its start on."""
    stances = _stances(take)
    for choice in rng.permutation(len(stances)):
        marker, start, stop = stances[choice]
        end = (start + stop) // 2
        varied = _at(take, np.arange(end))
        if not locked:
            return varied
        positions = varied.take.positions.copy()
        positions[start:, marker] = positions[start, marker]
        if np.linalg.norm(positions[start:, marker] - take.positions[start:end, marker], axis=1).max() <= _LOCKED:
            return replace(varied, take=replace(varied.take, positions=positions, poses=None))
    return None


# Time


def _at(take: Take, frames: Ints) -> Variation:
    """Return the take with these of its frames, in this order."""
    varied = replace(
        take,
        positions=take.positions[frames],
        trusted=take.trusted[frames],
        filled=take.filled[frames],
        moved=take.moved[frames],
        poses=None if take.poses is None else take.poses[frames],
    )
    return _variation(varied, _sources(take)[frames])


def _interpolated(take: Take, times: Floats, rate: float) -> Variation:
    """Return the take at some times, in frames, on cubic splines through each run of trusted samples."""
    from scipy.interpolate import CubicSpline  # one variation of many needs it, and it is long to load

    shape = (len(times), len(take.markers))
    positions, trusted = np.zeros((*shape, 3)), np.zeros(shape, dtype=bool)
    for marker, start, stop in column_runs(take.trusted):
        inside = (times >= start) & (times <= stop - 1)
        known = take.positions[start:stop, marker]
        if stop - start > 1:
            positions[inside, marker] = CubicSpline(np.arange(start, stop), known)(times[inside])
        else:
            positions[inside, marker] = known[0]
        trusted[inside, marker] = True
    nothing = np.zeros(shape, dtype=bool)
    varied = replace(take, positions=positions, trusted=trusted, filled=nothing, moved=nothing, rate=rate, poses=None)
    return _variation(varied, _sources(take)[np.round(times).astype(np.intp)])


def _pause(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take in which the whole body slows down, pauses for 0.75 s and moves on."""
    n_frames = len(take.trusted)
    if n_frames / take.rate < _SHORTEST_SECONDS:
        return None
    begin = int(rng.uniform(*_BEGIN) * n_frames)
    slower = 0.5 + 0.5 * np.cos(np.linspace(0.0, np.pi, max(2, round(2 * _EASE_SECONDS * take.rate))))
    pause = np.zeros(max(1, round(_PAUSE_SECONDS * take.rate)))
    # Frames of the motion per frame of the take: 1, less, 0, more, 1
    speed = np.concatenate((np.ones(begin), slower, pause, slower[::-1], np.ones(n_frames)))
    times = np.cumsum(speed) - 1.0
    varied = _interpolated(take, times[times <= n_frames - 1], take.rate)
    still = (speed < 1.0)[: len(varied.take.trusted), None, None]
    positions = np.where(still, _measured(take, varied.take.positions, rng), varied.take.positions)
    return replace(varied, take=replace(varied.take, positions=positions))


def _cut(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the first third of the take and, directly after it, the last third."""
    n_frames = len(take.trusted)
    part = n_frames // 3
    if 2 * part < _FEWEST_FRAMES:
        return None
    return _at(take, np.concatenate((np.arange(part), np.arange(n_frames - part, n_frames))))


def _loop(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the first half of the take, twice."""
    half = len(take.trusted) // 2
    return _at(take, np.tile(np.arange(half), 2)) if 2 * half >= _FEWEST_FRAMES else None


def _two_subjects(take: Take, rng: np.random.Generator) -> Variation | None:
    """Return the take beside a copy that is 1.5 m away and a quarter of the take ahead."""
    ahead = len(take.trusted) // 4
    stop = len(take.trusted) - ahead
    if stop < _FEWEST_FRAMES:
        return None
    first, second = _at(take, np.arange(stop)), _at(take, np.arange(ahead, ahead + stop))
    names = [f"second:{name}" for name in take.markers]
    both = _beside(first.take, second.take.positions + np.array([_APART, 0.0, 0.0]), names, second.take.trusted)
    detached = np.concatenate((take.detached, take.detached))
    return _variation(replace(both.take, detached=detached), np.concatenate((first.source, second.source), axis=1))


def _at_rate(take: Take, rng: np.random.Generator, rate: int) -> Variation | None:
    """Return the take at another rate: every n-th frame, or interpolated; None where it has about this rate."""
    step = max(1, round(take.rate / rate))
    near = abs(take.rate / rate / step - 1.0) <= _SAME_RATE
    if near and step > 1:
        varied = _at(take, np.arange(0, len(take.trusted), step))
        varied = replace(varied, take=replace(varied.take, rate=take.rate / step))
    elif not near and take.rate < rate:
        times = np.arange(0.0, len(take.trusted) - 1, take.rate / rate)[:_MOST_FRAMES]
        varied = _interpolated(take, times, float(rate))
    else:
        return None
    return varied if len(varied.take.trusted) >= _FEWEST_FRAMES else None


UNCHANGED = "as it is"
"""The variation without a change."""

VARIATIONS: dict[str, Callable[[Take, np.random.Generator], Variation | None]] = {
    UNCHANGED: _as_it_is,
    "spike": partial(_with_event, kind="spike", size=1.0),
    "jump": partial(_with_event, kind="jump", size=1.0),
    "drift": partial(_with_event, kind="drift", size=_DRIFT_SIZE),
    "limb held": _limb_held,
    "still marker": _still_marker,
    "box at rest": _box,
    "cup moved once": _cup,
    "ball thrown": _ball,
    "pose in frame 1": partial(_posed, n_frames=1, at_end=False),
    "pose in frames 1-30": partial(_posed, n_frames=_HELD_POSE, at_end=False),
    "pose in the last frame": partial(_posed, n_frames=1, at_end=True),
    "foot down at the end": partial(_foot_down, locked=False),
    "foot locked at the end": partial(_foot_down, locked=True),
    "pause": _pause,
    "cut": _cut,
    "loop": _loop,
    "two subjects": _two_subjects,
    **{f"{rate} Hz": partial(_at_rate, rate=rate) for rate in RATES},
}
"""The variations, by name. Those named after a fault have one; in all others every sample is right."""

FAULTY = ("spike", "jump", "drift", "limb held")
"""The variations with a fault."""
