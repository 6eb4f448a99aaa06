"""How rigidly markers are tied to each other, and which of them say most of where one is."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.robust import nan_median

_SAMPLE = 300
_ENOUGH = 10
_SLACK, _NEAR = 10.0, 50.0
PARTNERS = 10


@dataclass(frozen=True)
class Rigidity:
    """Median and robust SD (M, M) of the distances between markers; an infinite SD where too seldom seen together."""

    distance: Floats
    spread: Floats

    def partners(self, marker: int) -> tuple[Ints, Floats]:
        """The up to 10 markers that say most of where one is, and how much: 1 / (SD² + slack²) / (distance + 50)."""
        weights = 1.0 / (self.spread[marker] ** 2 + _SLACK**2) / (self.distance[marker] + _NEAR)
        weights[marker] = 0.0
        order = np.argsort(-weights, kind="stable")[:PARTNERS]
        chosen = order[weights[order] > 0]
        return chosen, weights[chosen]


def rigidity(positions: Floats, trusted: Bools) -> Rigidity:
    """The rigidity of all pairs, over up to 300 frames of positions (F, M, 3)."""
    frames = np.unique(np.linspace(0, len(trusted) - 1, min(len(trusted), _SAMPLE)).astype(int))
    known = np.where(trusted[frames, :, None], positions[frames], np.nan)
    n_markers = positions.shape[1]
    distance, spread = np.zeros((n_markers, n_markers)), np.full((n_markers, n_markers), np.inf)
    for a in range(n_markers - 1):
        offset = known[:, a + 1 :] - known[:, [a]]
        apart = np.sqrt(np.einsum("fmc,fmc->fm", offset, offset))
        seen = np.isfinite(apart).sum(axis=0) >= min(_ENOUGH, len(frames))
        middle = nan_median(apart)
        deviation = 1.4826 * nan_median(np.abs(apart - middle))
        distance[a, a + 1 :] = distance[a + 1 :, a] = np.where(seen, middle, 0.0)
        spread[a, a + 1 :] = spread[a + 1 :, a] = np.where(seen, deviation, np.inf)
    return Rigidity(distance, spread)
