"""Small trained dictionaries for tests."""

import numpy as np

from mocapclean.dictionaries.body_parts import BodyParts
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.dictionaries.training import train
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.take import Take

SMALL = Params(window=12, atoms=60, windows=400, sweeps=2, hole_passes=1, poses=300)


def twelve_parts() -> BodyParts:
    """Parts of the 12 markers m0 to m11: a trunk of 3, a limb of 5, a limb of 4."""
    trunk, left, right = (tuple(f"m{k}" for k in span) for span in (range(3), range(3, 8), range(8, 12)))
    return BodyParts(
        parts={"TO": trunk, "LA": (), "RA": (), "LL": left, "RL": right},
        origin=("m0",),
        right=("m1",),
        left=("m2",),
        top=("m0",),
        torso=trunk,
    )


def learn(positions: np.ndarray, rate: float, params: Params = SMALL) -> Dictionary:
    """A dictionary of clean positions (F, 12, 3)."""
    trusted = np.ones(positions.shape[:2], dtype=bool)
    take = Take(positions=positions, trusted=trusted, markers=tuple(f"m{k}" for k in range(12)), rate=rate)
    return train([take], twelve_parts(), params)
