"""Faults of cameras and labelling, put into a take whose true positions are known.

A take gets a number of events of each kind for every 10,000 trusted samples. Their size is a multiple of the kind's own
unit. Sizes and durations are chosen by hand, no sweep was kept; docs/results.md has what the trust rules find of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.alignment import align_shapes
from mocapclean.geometry.distances import rigidity
from mocapclean.numerics import interpolation
from mocapclean.simulate.bounds import require_between
from mocapclean.take import Take

_MARGIN = 10  # frames between two events of a marker, and between an event and the ends of the take
_MOST_TRIES = 200  # random places that are tried for an event
_SAMPLES_PER_RATE = 10_000  # trusted samples in which a rate of 1 has one event

_SPIKE = 20.0  # mm, distance from the true position
_SPIKE_FRAMES = (1, 3)  # shortest and longest
_JUMP = 40.0  # mm, distance from the true position
_JUMP_FRAMES = (3, 100)  # shortest and longest
_FLICKER = 10.0  # mm, SD of each coordinate
_FLICKER_FRAMES = (10, 10)  # shortest and longest
_FROZEN = 20.0  # mm, least distance that the true marker reaches while its position is frozen
_FROZEN_FRAMES = (10, 60)  # shortest and longest
_SWAP = 80.0  # mm, least distance of two markers whose labels are exchanged
_SWAP_FRAMES = (5, 100)  # shortest and longest
_SWAP_CANDIDATES = 5  # markers nearest beyond that distance, of which one is drawn
_DRIFT = 20.0  # mm, final distance of a drifted marker from its true place on the segment
_DRIFT_MARGIN = 5  # a drift begins after the first and before the last 1/5 of the take
_DRIFT_FEWEST_MARKERS = 4  # markers of a take with drifts: one that drifts and three that hold its segment
_MARKERS_PER_DRIFT = 3  # at most one marker in so many drifts
_SLIDE_SECONDS = 0.5  # longest time of a gradual drift; half of the drifts are at once


@dataclass(frozen=True, kw_only=True)
class Event:
    """One fault: its kind, the columns of its markers (two for a swap), and its half-open span of frames."""

    kind: str
    markers: tuple[int, ...]
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class Injected:
    """A take with faults, its faulty samples (F, M), and the events; the take before injection has the truth."""

    take: Take
    faulty: Bools
    events: tuple[Event, ...]

    def samples(self, event: Event) -> Bools:
        """Return the samples (F, M) of one event."""
        mask = np.zeros_like(self.faulty)
        mask[event.start : event.stop, list(event.markers)] = True
        return mask & self.faulty


def inject(
    take: Take, rng: np.random.Generator, kinds: Sequence[str] = (), rate: float = 1.0, size: float = 1.0
) -> Injected:
    """Return a take with ``rate`` faults of each kind (all of ``FAULTS`` by default) for every 10,000 trusted samples.

    size: 1 gives spikes of 20 mm, jumps of 40 mm, exchanges of markers at least 80 mm apart, markers that are frozen
    while they move 20 mm, flicker of 10 mm SD per coordinate, drifts of 20 mm; 2 twice as much. Events change trusted
    samples alone. They keep 10 frames from other events of the marker and from the ends of the take. At least one event
    of each kind is tried; fewer than wanted are made where no place is free. Raises UsageError for an unknown kind, a
    negative rate, or a size that is not positive.
    """
    chosen = tuple(kinds) or tuple(FAULTS)
    for kind in chosen:
        if kind not in FAULTS:
            raise UsageError(f"a fault must be one of {', '.join(FAULTS)}. Got {kind!r}.")
    require_between("The rate of faults", rate, 0.0, 1000.0)
    require_between("The size of faults", size, 1e-3, 1e3)
    injector = _Injector(take, rng, size)
    wanted = max(1, round(rate * take.trusted.sum() / _SAMPLES_PER_RATE)) if rate else 0
    for kind in chosen:
        for _ in range(wanted):
            FAULTS[kind](injector)
    return Injected(
        take=replace(take, positions=injector.positions), faulty=injector.faulty, events=tuple(injector.events)
    )


class _Injector:
    """The positions with all faults so far, and where further faults may be.

    truth, positions: (F, M, 3), without and with faults. trusted, faulty: (F, M). occupied: (F, M), the samples that no
    further event may change. rate: frames per second. size: that of ``inject``.
    """

    def __init__(self, take: Take, rng: np.random.Generator, size: float) -> None:
        self.truth, self.trusted, self.rate = take.positions, take.trusted, take.rate
        self.rng, self.size = rng, size
        self.positions = take.positions.copy()
        self.faulty = np.zeros_like(take.trusted)
        self.occupied = ~take.trusted
        self.occupied[:_MARGIN] = self.occupied[len(self.occupied) - _MARGIN :] = True
        self.events: list[Event] = []

    def free_span(self, shortest: int, longest: int) -> tuple[int, int, int] | None:
        """Return a random free span (marker, start, stop) of a random marker; None if no try is free."""
        n_frames, n_markers = self.occupied.shape
        for _ in range(_MOST_TRIES):
            length = int(self.rng.integers(shortest, longest + 1))
            if length + 2 * _MARGIN > n_frames:
                continue
            marker = int(self.rng.integers(n_markers))
            start = int(self.rng.integers(_MARGIN, n_frames - _MARGIN - length + 1))
            if self.is_free(marker, start, start + length):
                return marker, start, start + length
        return None

    def is_free(self, marker: int, start: int, stop: int) -> bool:
        """Whether an event may change these frames of a marker."""
        return not self.occupied[start:stop, marker].any()

    def direction(self) -> Floats:
        """Return a random unit vector (3,), of uniform distribution over the sphere."""
        vector = self.rng.normal(size=3)
        return np.asarray(vector / np.linalg.norm(vector))

    def add(self, kind: str, markers: tuple[int, ...], start: int, stop: int, positions: Floats) -> None:
        """Make an event with these positions (stop - start, len(markers), 3)."""
        columns = list(markers)
        self.positions[start:stop, columns] = positions
        self.faulty[start:stop, columns] = True
        self.occupied[max(0, start - _MARGIN) : stop + _MARGIN, columns] = True
        self.events.append(Event(kind=kind, markers=markers, start=start, stop=stop))

    def displace(self, kind: str, n_frames: tuple[int, int], offsets: Callable[[int], Floats]) -> None:
        """Make an event in which a marker has offsets (n, 3) from its true positions.

        n_frames: the shortest and the longest event.
        """
        span = self.free_span(*n_frames)
        if span:
            marker, start, stop = span
            displaced = self.truth[start:stop, marker] + offsets(stop - start)
            self.add(kind, (marker,), start, stop, displaced[:, None])


def _spike(injector: _Injector) -> None:
    """Add 1 to 3 frames with one offset of 20 mm."""
    injector.displace("spike", _SPIKE_FRAMES, lambda n: np.tile(_SPIKE * injector.size * injector.direction(), (n, 1)))


def _jump(injector: _Injector) -> None:
    """Add 3 to 100 frames with one offset of 40 mm, as of a reflection in place of the marker."""
    injector.displace("jump", _JUMP_FRAMES, lambda n: np.tile(_JUMP * injector.size * injector.direction(), (n, 1)))


def _flicker(injector: _Injector) -> None:
    """Add 10 frames of white noise, 10 mm SD per coordinate."""
    injector.displace(
        "flicker", _FLICKER_FRAMES, lambda n: injector.rng.normal(scale=_FLICKER * injector.size, size=(n, 3))
    )


def _frozen(injector: _Injector) -> None:
    """Add 10 to 60 frames with the position of the frame before, in which the true marker gets at least 20 mm away."""
    for _ in range(_MOST_TRIES):
        span = injector.free_span(*_FROZEN_FRAMES)
        if span is None:
            return
        marker, start, stop = span
        last = injector.truth[start - 1, marker]
        distance = np.linalg.norm(injector.truth[start:stop, marker] - last, axis=1)
        if distance.max() >= _FROZEN * injector.size:
            injector.add("frozen", (marker,), start, stop, np.tile(last, (stop - start, 1, 1)))
            return


def _swap(injector: _Injector) -> None:
    """Exchange two labels for 5 to 100 frames: a marker and one of the 5 nearest that stay at least 80 mm away."""
    for _ in range(_MOST_TRIES):
        span = injector.free_span(*_SWAP_FRAMES)
        if span is None:
            return
        marker, start, stop = span
        paths = injector.truth[start:stop]
        least_distance = np.linalg.norm(paths - paths[:, [marker]], axis=2).min(axis=0)
        candidates = [
            int(other)
            for other in np.argsort(least_distance)
            if least_distance[other] >= _SWAP * injector.size and injector.is_free(int(other), start, stop)
        ][:_SWAP_CANDIDATES]
        if candidates:
            other = candidates[int(injector.rng.integers(len(candidates)))]
            injector.add("swap", (marker, other), start, stop, paths[:, [other, marker]])
            return


def _drift(injector: _Injector) -> None:
    """Displace a marker by 20 mm on its segment from some frame to the end, at once or over up to half a second."""
    n_frames, n_markers = injector.occupied.shape
    n_drifting = sum(event.kind == "drift" for event in injector.events)
    if n_drifting >= max(1, n_markers // _MARKERS_PER_DRIFT) or n_markers < _DRIFT_FEWEST_MARKERS:
        return
    earliest = n_frames // _DRIFT_MARGIN
    for _ in range(_MOST_TRIES):
        marker = int(injector.rng.integers(n_markers))
        start = int(injector.rng.integers(earliest, max(n_frames - earliest, earliest + 1)))
        stop = n_frames
        usable = injector.trusted[:, marker]
        other_events = injector.occupied[start : stop - _MARGIN, marker] & usable[start : stop - _MARGIN]
        if other_events.any() or not usable[start:].any():
            continue
        # Half of the drifts are gradual, from 1 frame to half a second.
        longest_slide = max(2, round(_SLIDE_SECONDS * injector.rate))
        slide = int(injector.rng.integers(1, longest_slide)) if injector.rng.random() < 0.5 else 1
        share = np.minimum(np.arange(1, stop - start + 1) / slide, 1.0)[:, None]
        offset = share * _DRIFT * injector.size * injector.direction()
        rotated = (_segment_rotations(injector, marker)[start:] @ offset[..., None])[..., 0]
        truth = injector.truth[start:, marker]
        displaced = np.where(usable[start:, None], truth + rotated, truth)
        injector.add("drift", (marker,), start, stop, displaced[:, None])
        injector.faulty[start:, marker] &= usable[start:]
        return


def _segment_rotations(injector: _Injector, marker: int) -> Floats:
    """Return the rotations (F, 3, 3) of a marker's segment from the middle frame; I with fewer than 3 partners."""
    filled = interpolation.linear(injector.truth, injector.trusted)
    partners, weights = rigidity(injector.truth, injector.trusted).partners(marker)
    if len(partners) < 3:
        return np.broadcast_to(np.eye(3), (len(filled), 3, 3))
    positions = np.moveaxis(filled[:, partners], 2, 0)[:, None]
    rotations, _ = align_shapes(positions[:, :, len(filled) // 2], positions, weights[None])
    return np.moveaxis(rotations[:, :, 0], 2, 0)


FAULTS: dict[str, Callable[[_Injector], None]] = {
    "drift": _drift,
    "swap": _swap,
    "jump": _jump,
    "frozen": _frozen,
    "flicker": _flicker,
    "spike": _spike,
}
"""The kinds of faults, in the order in which they are put into a take."""
