"""Faults as cameras and labelling make them, put into a take whose truth is known.

A take gets events of each kind, so many for each 10,000 samples, of a size given in multiples of the kind's own unit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.alignment import align_shapes
from mocapclean.geometry.distances import rigidity
from mocapclean.numerics import interpolation
from mocapclean.simulate.bounds import within
from mocapclean.take import Take

_MARGIN = 10
_TRIES = 200
_MOST_DRIFTING = 3
_SLIDE_SECONDS = 0.5


@dataclass(frozen=True, kw_only=True)
class Event:
    """One fault: its kind, the columns of its markers (two for a swap), and its half-open span of frames."""

    kind: str
    markers: tuple[int, ...]
    start: int
    stop: int


@dataclass(frozen=True, kw_only=True)
class Injected:
    """A take with faults, the samples (F, M) that are faulty, and the events. The truth is the take before."""

    take: Take
    faulty: Bools
    events: tuple[Event, ...]

    def samples(self, event: Event) -> Bools:
        """The samples (F, M) of one event."""
        mask = np.zeros_like(self.faulty)
        mask[event.start : event.stop, list(event.markers)] = True
        return mask & self.faulty


def inject(
    take: Take, rng: np.random.Generator, kinds: Sequence[str] = (), rate: float = 1.0, size: float = 1.0
) -> Injected:
    """Put faults into a take: ``rate`` events of each kind (all of ``FAULTS`` by default) for each 10,000 samples.

    size: 1 gives spikes of 20 mm, jumps of 40 mm, exchanges of markers 80 mm apart at least, markers that are frozen
    while they move 20 mm, flicker of 10 mm SD per coordinate, drifts of 20 mm; 2 twice as much. Events touch trusted
    samples only, keep 10 frames from each other on a marker and from the ends of the take, and a kind that finds no
    room has fewer; at least one is tried for. Raises UsageError for an unknown kind, a negative rate, a size that is
    not positive.
    """
    chosen = tuple(kinds) or tuple(FAULTS)
    for kind in chosen:
        if kind not in FAULTS:
            raise UsageError(f"a fault must be one of {', '.join(FAULTS)}. Got {kind!r}.")
    within("The rate of faults", rate, 0.0, 1000.0)
    within("The size of faults", size, 1e-3, 1e3)
    scene = _Scene(take, rng, size)
    wanted = max(1, round(rate * take.trusted.sum() / 10_000)) if rate else 0
    for kind in chosen:
        for _ in range(wanted):
            FAULTS[kind](scene)
    return Injected(take=replace(take, positions=scene.positions), faulty=scene.faulty, events=tuple(scene.events))


class _Scene:
    """A take in the making: where there is room, and what has been done to it."""

    def __init__(self, take: Take, rng: np.random.Generator, size: float) -> None:
        self.truth, self.trusted, self.rate = take.positions, take.trusted, take.rate
        self.rng, self.size = rng, size
        self.positions = take.positions.copy()
        self.faulty = np.zeros_like(take.trusted)
        self.taken = ~take.trusted
        self.taken[:_MARGIN] = self.taken[len(self.taken) - _MARGIN :] = True
        self.events: list[Event] = []

    def span(self, shortest: int, longest: int) -> tuple[int, int, int] | None:
        """A random free span of a random marker: (marker, start, stop); None where none was met."""
        n_frames, n_markers = self.taken.shape
        for _ in range(_TRIES):
            length = int(self.rng.integers(shortest, longest + 1))
            if length + 2 * _MARGIN > n_frames:
                continue
            marker = int(self.rng.integers(n_markers))
            start = int(self.rng.integers(_MARGIN, n_frames - _MARGIN - length + 1))
            if self.is_free(marker, start, start + length):
                return marker, start, start + length
        return None

    def is_free(self, marker: int, start: int, stop: int) -> bool:
        return not self.taken[start:stop, marker].any()

    def direction(self) -> Floats:
        vector = self.rng.normal(size=3)
        return np.asarray(vector / np.linalg.norm(vector))

    def add(self, kind: str, markers: tuple[int, ...], start: int, stop: int, positions: Floats) -> None:
        """Make an event of these positions (stop - start, len(markers), 3)."""
        columns = list(markers)
        self.positions[start:stop, columns] = positions
        self.faulty[start:stop, columns] = True
        self.taken[max(0, start - _MARGIN) : stop + _MARGIN, columns] = True
        self.events.append(Event(kind=kind, markers=markers, start=start, stop=stop))

    def shift(self, kind: str, longest: int, shortest: int, offset: Callable[[int], Floats]) -> None:
        """An event that moves one marker by offsets (n, 3)."""
        found = self.span(shortest, longest)
        if found:
            marker, start, stop = found
            moved = self.truth[start:stop, marker] + offset(stop - start)
            self.add(kind, (marker,), start, stop, moved[:, None])


def _spike(scene: _Scene) -> None:
    """1 to 3 frames, each 20 mm off in the same direction."""
    scene.shift("spike", 3, 1, lambda n: np.tile(20.0 * scene.size * scene.direction(), (n, 1)))


def _jump(scene: _Scene) -> None:
    """3 to 100 frames 40 mm off: a reflection."""
    scene.shift("jump", 100, 3, lambda n: np.tile(40.0 * scene.size * scene.direction(), (n, 1)))


def _flicker(scene: _Scene) -> None:
    """10 frames of white noise, 10 mm SD per coordinate."""
    scene.shift("flicker", 10, 10, lambda n: scene.rng.normal(scale=10.0 * scene.size, size=(n, 3)))


def _frozen(scene: _Scene) -> None:
    """10 to 60 frames at the place of the frame before, while the true marker gets 20 mm away from it at least."""
    for _ in range(_TRIES):
        found = scene.span(10, 60)
        if found is None:
            return
        marker, start, stop = found
        held = scene.truth[start - 1, marker]
        if np.linalg.norm(scene.truth[start:stop, marker] - held, axis=1).max() >= 20.0 * scene.size:
            scene.add("frozen", (marker,), start, stop, np.tile(held, (stop - start, 1, 1)))
            return


def _swap(scene: _Scene) -> None:
    """5 to 100 frames of two labels exchanged: a marker and one of the 5 nearest that stay 80 mm away at least."""
    for _ in range(_TRIES):
        found = scene.span(5, 100)
        if found is None:
            return
        marker, start, stop = found
        path = scene.truth[start:stop]
        apart = np.linalg.norm(path - path[:, [marker]], axis=2).min(axis=0)
        able = [
            int(other)
            for other in np.argsort(apart)
            if apart[other] >= 80.0 * scene.size and scene.is_free(int(other), start, stop)
        ][:5]
        if able:
            other = able[int(scene.rng.integers(len(able)))]
            scene.add("swap", (marker, other), start, stop, path[:, [other, marker]])
            return


def _drift(scene: _Scene) -> None:
    """From some frame on 20 mm away in its segment for good, at once (re-attached) or over up to half a second."""
    n_frames, n_markers = scene.taken.shape
    drifting = sum(event.kind == "drift" for event in scene.events)
    if drifting >= max(1, n_markers // _MOST_DRIFTING) or n_markers < 4:
        return
    for _ in range(_TRIES):
        marker = int(scene.rng.integers(n_markers))
        start = int(scene.rng.integers(n_frames // 5, max(n_frames - n_frames // 5, n_frames // 5 + 1)))
        stop = n_frames
        usable = scene.trusted[:, marker]
        if (scene.taken[start : stop - _MARGIN, marker] & usable[start : stop - _MARGIN]).any() or not usable[
            start:
        ].any():
            continue
        slide = (
            int(scene.rng.integers(1, max(2, round(_SLIDE_SECONDS * scene.rate)))) if scene.rng.random() < 0.5 else 1
        )
        share = np.minimum(np.arange(1, stop - start + 1) / slide, 1.0)[:, None]
        offset = share * 20.0 * scene.size * scene.direction()
        turned = (_segment(scene, marker)[start:] @ offset[..., None])[..., 0]
        moved = np.where(usable[start:, None], scene.truth[start:, marker] + turned, scene.truth[start:, marker])
        scene.add("drift", (marker,), start, stop, moved[:, None])
        scene.faulty[start:, marker] &= usable[start:]
        return


def _segment(scene: _Scene, marker: int) -> Floats:
    """The rotations (F, 3, 3) of the segment that carries a marker."""
    filled = interpolation.linear(scene.truth, scene.trusted)
    partners, weights = rigidity(scene.truth, scene.trusted).partners(marker)
    if len(partners) < 3:
        return np.broadcast_to(np.eye(3), (len(filled), 3, 3))
    seen = np.moveaxis(filled[:, partners], 2, 0)[:, None]
    turn, _ = align_shapes(seen[:, :, len(filled) // 2], seen, weights[None])
    return np.moveaxis(turn[:, :, 0], 2, 0)


FAULTS: dict[str, Callable[[_Scene], None]] = {
    "drift": _drift,
    "swap": _swap,
    "jump": _jump,
    "frozen": _frozen,
    "flicker": _flicker,
    "spike": _spike,
}
