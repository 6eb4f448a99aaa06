"""Damage of known place in the poses of a skeleton: pops, lost joints and limbs, root spikes and zeros, holds, spans.

Several events are put into one copy of a take, set apart in time, in joints that move. An event lies where the channels
that it concerns are known in the take as it is.
"""

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.euler import is_ball, rotations_of, shifts_of
from mocapclean.geometry.joint_motion import angles_between, from_vectors, joint_motion, times, with_motion
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Take
from mocapclean.take.posed import known_poses, posed_take

DAMAGES = (
    *(("pop", size) for size in (10, 20, 45)),
    *(("joint lost", size) for size in (5, 20, 60)),
    ("limb lost", 20),
    ("root spike", 1),
    ("root zero", 10),
    *(("hold", size) for size in (10, 30, 60)),
    ("span", 40),
)
"""The kinds of damage with their sizes: degrees of a pop, frames of all others."""

DETECTED = ("pop", "root spike", "root zero", "hold")
"""The kinds whose frames nothing marks, so that the rules must find them."""

MOST_EVENTS = 30
"""Events in a copy; by hand, so that a long take does not outweigh the others."""

_APART, _LENGTHS_APART = 40, 3  # frames, and lengths of an event, at least, from one event to the next
_MARGIN = 8  # frames at both ends of a take without an event
_CLEAR = 5  # frames beside an event in which its channels are known in the take as it is
_MOVES = 5.0  # degrees that a joint turns away from its first rotation, at least, to be one that moves; by hand
_SPIKE = 200.0, 800.0  # mm of a body of the height below
_HEIGHT = 1700.0  # mm, the span of a body of scale 1 between its farthest joints
_FROM_ZERO = 0.05  # of the body's span that a root is away from zero, at least, for zeros to be damage; by hand
_SPAN_DEGREES = 30.0  # of the rotation that fades in and out of a span; by hand


@dataclass(frozen=True)
class Event:
    """The damage of one joint in frames from start to stop (half open), and its channels."""

    joint: int
    start: int
    stop: int
    channels: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Damaged:
    """A copy of a take with damage. The channels of user spans and lost joints are unknown in it."""

    take: Take
    events: tuple[Event, ...]

    @property
    def mask(self) -> Bools:
        """The damaged channels (F, C)."""
        assert self.take.poses is not None
        mask = np.zeros(self.take.poses.shape, dtype=bool)
        for event in self.events:
            mask[event.start : event.stop, list(event.channels)] = True
        return mask


def damaged(take: Take, kind: str, size: int, seed: int, right: Bools | None = None) -> Damaged | None:
    """Return a copy of a take with poses with damage of one kind; None where it has no place for it.

    right: (F, C) channels that events may lie in, those that are known without it.
    """
    body = _Body(take, right)
    rng = np.random.default_rng([seed, size, zlib.crc32(kind.encode())])
    length = 1 if kind == "pop" else size
    poses, known = body.poses.copy(), body.known.copy()
    events = []
    for start in _starts(len(poses), length, rng):
        event = _PLACES[kind](body, slice(start, start + length), rng)
        if event is None:
            continue
        frames, channels = slice(event.start, event.stop), list(event.channels)
        _WRITERS[kind](body, poses, event, size, rng)
        if kind in ("joint lost", "limb lost", "span"):
            known[frames, channels] = False
        events.append(event)
    if not events:
        return None
    return Damaged(take=posed_take(body.skeleton, poses, take.rate).with_known(known), events=tuple(events))


def span_of(take: Take) -> float:
    """Return the distance of the two farthest joints, mm, median over some frames."""
    sampled = take.positions[:: max(1, len(take.positions) // 20)]
    return float(np.median([np.linalg.norm(p[:, None] - p[None], axis=2).max() for p in sampled]))


def below(skeleton: Skeleton, joint: int) -> list[int]:
    """Return a joint and all that hang on it."""
    inside = [joint]
    for other, parent in enumerate(skeleton.parents):
        if parent in inside:
            inside.append(other)
    return inside


class _Body:
    """The undamaged take, and which of its joints move."""

    def __init__(self, take: Take, right: Bools | None) -> None:
        self.skeleton, self.poses, self.known = known_poses(take)
        self.right = self.known if right is None else self.known & right
        self.motion = joint_motion(self.skeleton, self.poses, self.known)
        self.rotations = self.motion.rotations
        self.turning, self.shifting = rotations_of(self.skeleton), shifts_of(self.skeleton)
        turned = angles_between(self.rotations[:1], self.rotations).max(axis=0)
        self.movers: Ints = np.flatnonzero(self.motion.turns & (turned >= _MOVES))
        self.span = span_of(take)
        self.turn = 0  # of the joints that events are put in, one after the other

    def is_right(self, frames: slice, channels: list[int]) -> bool:
        """Whether these channels can be trusted in these frames and beside them."""
        return bool(self.right[max(0, frames.start - _CLEAR) : frames.stop + _CLEAR, channels].all())


def _starts(n_frames: int, length: int, rng: np.random.Generator) -> Iterator[int]:
    """Yield the first frames of events, far enough apart."""
    step = length + max(_APART, _LENGTHS_APART * length)
    last = n_frames - _MARGIN - length
    if last < _MARGIN:
        return
    first = _MARGIN + int(rng.integers(0, min(step, last - _MARGIN + 1)))
    starts = np.arange(first, last + 1, step)
    if len(starts) > MOST_EVENTS:
        starts = np.sort(rng.choice(starts, MOST_EVENTS, replace=False))
    yield from map(int, starts)


def _in_turn(body: _Body, rng: np.random.Generator) -> Iterator[int]:
    """Yield the joints that move, in a random order that goes on from event to event."""
    if not body.turn:
        rng.shuffle(body.movers)
    for _ in range(len(body.movers)):
        joint = int(body.movers[body.turn % len(body.movers)])
        body.turn += 1
        yield joint


def _joint(body: _Body, frames: slice, rng: np.random.Generator) -> Event | None:
    """Return the next joint that can be damaged in these frames."""
    for joint in _in_turn(body, rng):
        if body.is_right(frames, body.turning[joint]):
            return Event(joint, frames.start, frames.stop, tuple(body.turning[joint]))
    return None


def _moving_joint(body: _Body, frames: slice, rng: np.random.Generator) -> Event | None:
    """Return the next joint that turns far enough in these frames for a hold to be seen."""
    for joint in _in_turn(body, rng):
        turned = angles_between(body.rotations[frames.start - 1, joint], body.rotations[frames, joint])
        if turned.max() >= _MOVES and body.is_right(frames, body.turning[joint]):
            return Event(joint, frames.start, frames.stop, tuple(body.turning[joint]))
    return None


def _limb(body: _Body, frames: slice, rng: np.random.Generator) -> Event | None:
    """Return the next joint but the root on which others hang that turn, with the channels of all of them."""
    for joint in _in_turn(body, rng):
        inside = below(body.skeleton, joint)
        channels = [channel for other in inside for channel in body.turning[other]]
        n_turning = sum(bool(body.turning[other]) for other in inside)
        if n_turning > 1 and body.skeleton.parents[joint] >= 0 and body.is_right(frames, channels):
            return Event(joint, frames.start, frames.stop, tuple(channels))
    return None


def _root(body: _Body, frames: slice, rng: np.random.Generator) -> Event | None:
    """Return the root's position channels."""
    root = body.skeleton.parents.index(-1)
    channels = body.shifting[root]
    if len(channels) < 3 or not body.is_right(frames, channels):
        return None
    return Event(root, frames.start, frames.stop, tuple(channels))


def _root_off_zero(body: _Body, frames: slice, rng: np.random.Generator) -> Event | None:
    """Return the root's position channels where zeros are far from them."""
    event = _root(body, frames, rng)
    if event is None:
        return None
    distances = np.linalg.norm(body.poses[frames][:, list(event.channels)], axis=1)
    return event if distances.min() >= _FROM_ZERO * body.span else None


def _turn(body: _Body, poses: Floats, event: Event, degrees: Floats, rng: np.random.Generator) -> None:
    """Turn a joint by angles (n,) of its frames about one random axis, or within its channels if they are fewer."""
    frames, channels = slice(event.start, event.stop), list(event.channels)
    axes = [body.skeleton.channels[index].axis for index in channels]
    direction = rng.normal(size=3 if is_ball(axes) else len(channels))
    direction /= np.linalg.norm(direction)
    if not is_ball(axes):
        poses[frames, channels] += degrees[:, None] * direction
        return
    rotations = body.rotations.copy()
    rotations[frames, event.joint] = times(rotations[frames, event.joint], from_vectors(degrees[:, None] * direction))
    wanted = np.zeros(poses.shape, dtype=bool)
    wanted[frames, channels] = True
    around = slice(max(0, event.start - 2), event.stop + 2)
    turned = with_motion(
        body.skeleton, body.poses[around], wanted[around], rotations[around], body.motion.translations[around]
    )
    poses[frames, channels] = turned[event.start - around.start :][: event.stop - event.start, channels]


def _pop(body: _Body, poses: Floats, event: Event, size: int, rng: np.random.Generator) -> None:
    """Turn a joint in one frame."""
    _turn(body, poses, event, np.array([float(size)]), rng)


def _lose(body: _Body, poses: Floats, event: Event, size: int, rng: np.random.Generator) -> None:
    """Take the numbers away."""
    poses[event.start : event.stop, list(event.channels)] = np.nan


def _spike(body: _Body, poses: Floats, event: Event, size: int, rng: np.random.Generator) -> None:
    """Move the root by 0.2 to 0.8 m, scaled by the size of the body."""
    direction = rng.normal(size=len(event.channels))
    distance = rng.uniform(*_SPIKE) * body.span / _HEIGHT
    poses[event.start : event.stop, list(event.channels)] += distance * direction / np.linalg.norm(direction)


def _zero(body: _Body, poses: Floats, event: Event, size: int, rng: np.random.Generator) -> None:
    """Write zeros."""
    poses[event.start : event.stop, list(event.channels)] = 0.0


def _hold(body: _Body, poses: Floats, event: Event, size: int, rng: np.random.Generator) -> None:
    """Keep the values of the frame before."""
    channels = list(event.channels)
    poses[event.start : event.stop, channels] = body.poses[event.start - 1, channels]


def _fade(body: _Body, poses: Floats, event: Event, size: int, rng: np.random.Generator) -> None:
    """Turn a joint by an angle that fades in and out."""
    share = np.arange(1, event.stop - event.start + 1) / (event.stop - event.start + 1)
    _turn(body, poses, event, _SPAN_DEGREES * np.sin(np.pi * share) ** 2, rng)


_Place = Callable[[_Body, slice, np.random.Generator], Event | None]
_Writer = Callable[[_Body, Floats, Event, int, np.random.Generator], None]
_PLACES: dict[str, _Place] = {
    "pop": _joint,
    "joint lost": _joint,
    "limb lost": _limb,
    "root spike": _root,
    "root zero": _root_off_zero,
    "hold": _moving_joint,
    "span": _joint,
}
_WRITERS: dict[str, _Writer] = {
    "pop": _pop,
    "joint lost": _lose,
    "limb lost": _lose,
    "root spike": _spike,
    "root zero": _zero,
    "hold": _hold,
    "span": _fade,
}
