"""Simulated takes on which the laws of methods are tried: a walking body with gaps, and degenerate takes."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.body_parts import BodyParts
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.dictionaries.training import train
from mocapclean.dictionaries.training_parameters import Params as TrainingParams
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Take

RATE = 60.0  # Hz
N_MARKERS = 12  # of the walker: three on the trunk, and on each limb two above and three below, less one
SMALL = TrainingParams(window=12, atoms=60, windows=400, sweeps=2, hole_passes=1, poses=300)
"""The training of a small dictionary, which takes a second; chosen by hand."""


def make_take(positions: Floats, trusted: Bools) -> Take:
    """Return a take of positions (F, M, 3), mm, whose markers are m0, m1 and so on."""
    names = tuple(f"m{k}" for k in range(positions.shape[1]))
    return Take(positions=positions, trusted=trusted, markers=names, rate=RATE)


def walker(n_frames: int = 180) -> Floats:
    """Return the positions (F, 12, 3), mm, of a trunk that walks and sways, with two limbs of two segments each."""
    t = np.arange(n_frames) / RATE
    trunk = np.stack([900 * t, 40 * np.sin(2 * np.pi * t), 1000 + 25 * np.sin(4 * np.pi * t)], axis=1)
    cluster = np.array([[60.0, 0, 0], [0, 50, 20], [-40, -30, 50]])
    parts = [trunk[:, None] + cluster]
    for side in (-1.0, 1.0):
        upper = 0.5 * side * np.sin(2 * np.pi * t)
        lower = upper + 0.3 * np.cos(2 * np.pi * t + side)
        knee = trunk + [0, 150 * side, -100] + 400 * np.stack([np.sin(upper), 0 * t, -np.cos(upper)], axis=1)
        ankle = knee + 400 * np.stack([np.sin(lower), 0 * t, -np.cos(lower)], axis=1)
        parts.append(knee[:, None] + cluster[:2])
        parts.append(ankle[:, None] + cluster)
    return np.concatenate(parts, axis=1)[:, :N_MARKERS]


def gapped(*, dropouts: bool = True) -> Take:
    """Return the walker with gaps inside and at both ends, and a marker that is never trusted.

    dropouts: whether there are also two spans in which nothing is trusted. One is short enough to be bridged over time
    before the method sees the take.
    """
    positions = walker()
    trusted = np.ones(positions.shape[:2], dtype=bool)
    trusted[40:70, 3] = trusted[60:100, 8] = trusted[120:125, 1] = False
    trusted[:12, 5] = trusted[-9:, 10] = False
    trusted[:, 7] = False
    if dropouts:
        trusted[90] = trusted[130:152] = False
    return make_take(np.where(trusted[..., None], positions, 0.0), trusted)


def occluded() -> tuple[Take, Floats]:
    """Return the walker without a second of two markers, and its true positions (F, 12, 3), mm."""
    truth, second = walker(240), int(RATE)
    trusted = np.ones(truth.shape[:2], dtype=bool)
    trusted[80 : 80 + second, 9] = trusted[140 : 140 + second, 4] = False
    return make_take(np.where(trusted[..., None], truth, 0.0), trusted), truth


def twelve_parts() -> BodyParts:
    """Return the body parts of the walker: a trunk of 3 markers, a limb of 5 and one of 4."""
    trunk, left, right = (tuple(f"m{k}" for k in span) for span in (range(3), range(3, 8), range(8, N_MARKERS)))
    return BodyParts(
        parts={"TO": trunk, "LA": (), "RA": (), "LL": left, "RL": right},
        origin=("m0",),
        right=("m1",),
        left=("m2",),
        top=("m0",),
        torso=trunk,
    )


def learn(positions: Floats, rate: float, params: TrainingParams = SMALL) -> Dictionary:
    """Return a dictionary of clean positions (F, 12, 3), mm, at a rate, Hz."""
    take = replace(make_take(positions, np.ones(positions.shape[:2], dtype=bool)), rate=rate)
    return train([take], twelve_parts(), params)


@cache
def walker_dictionary(scale: float) -> Dictionary:
    """Return a dictionary of the walker, in a unit of length of 1 / scale millimetres."""
    learnt = learn(walker(300), RATE)
    atoms = {part: scale * words for part, words in learnt.atoms.items()}
    return replace(learnt, atoms=atoms, poses=scale * learnt.poses)


def _noise(n_frames: int, n_markers: int, *, value: float = 0.0, noise: float = 1.0) -> Take:
    """Return normal noise about a value, mm, of which one sample is missing."""
    rng = np.random.default_rng(5)
    positions = value + noise * rng.normal(size=(n_frames, n_markers, 3))
    trusted = np.ones((n_frames, n_markers), dtype=bool)
    trusted[n_frames // 2, 0] = False
    return make_take(positions, trusted)


def _with_losses(*lost: tuple[int | slice, int | slice]) -> Take:
    """Return 20 frames of 5 markers with more samples lost, by indices (frames, markers)."""
    take = _noise(20, 5)
    trusted = take.trusted.copy()
    for where in lost:
        trusted[where] = False
    return make_take(take.positions, trusted)


_EVERY = slice(None)


@cache
def degenerate() -> Mapping[str, Take]:
    """Return takes that are short, flat, empty or far away, by what they are."""
    return {
        "one marker": _noise(9, 1),
        "two markers": _noise(9, 2),
        "one frame": _noise(1, 4),
        "two frames": _noise(2, 4),
        "three frames": _noise(3, 2),
        "more columns than frames": _noise(7, 12),
        "all of a marker missing": _with_losses((_EVERY, 2)),
        "all but one marker missing": _with_losses((_EVERY, slice(1, None))),
        "all but one sample of a marker missing": _with_losses((slice(1, None), 3)),
        "a frame with nothing": _with_losses((8, _EVERY)),
        "only one frame with anything": _with_losses((slice(0, 8), _EVERY), (slice(9, None), _EVERY)),
        "constant": _noise(20, 5, value=7.0, noise=0.0),
        "all at the origin": _noise(20, 5, noise=0.0),
        "a kilometre away": _noise(20, 5, value=1e6),
        "nothing trusted": make_take(np.full((6, 3, 3), np.nan), np.zeros((6, 3), dtype=bool)),
        "no frames": make_take(np.zeros((0, 3, 3)), np.zeros((0, 3), dtype=bool)),
        "no markers": make_take(np.zeros((6, 0, 3)), np.zeros((6, 0), dtype=bool)),
    }


def with_bones(take: Take) -> Take:
    """Return a take whose markers are joints of a chain of bones of 1 mm."""
    before = np.zeros((len(take.markers), 3))
    before[1:, 0] = 1.0
    chain = Skeleton(
        names=take.markers,
        parents=tuple(range(-1, len(take.markers) - 1)),
        before=before,
        after=np.zeros_like(before),
        frames=np.tile(np.eye(3), (len(take.markers), 1, 1)),
        channels=(),
        product=(),
    )
    return replace(take, skeleton=chain)


def with_all_markers(take: Take) -> Take:
    """Return a take with the twelve markers of the walker; those that it lacks are never trusted."""
    n_frames, n_markers = take.trusted.shape
    positions, trusted = np.zeros((n_frames, N_MARKERS, 3)), np.zeros((n_frames, N_MARKERS), dtype=bool)
    positions[:, :n_markers], trusted[:, :n_markers] = take.positions, take.trusted
    return make_take(positions, trusted)
