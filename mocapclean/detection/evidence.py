"""Quantities that several trust rules need (rigidity, exchanged labels, path analysis), each computed once, at first
use.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.detection.analysis import PathAnalysis, analyse
from mocapclean.detection.exchanges import Exchange, exchange, exchanges
from mocapclean.geometry.distances import Rigidity, rigidity
from mocapclean.take import Take

_FARTHEST = 1e8  # mm, 100 km: chosen by hand; no capture volume is larger in any unit, and damaged numbers are


@dataclass(frozen=True)
class Evidence:
    """A take and everything that the rules examine of it."""

    take: Take

    @cached_property
    def plausible(self) -> Bools:
        """Return the trusted samples (F, M) within 100 km of the median of all trusted ones."""
        trusted = self.take.trusted
        if not trusted.any():
            return trusted
        middle = np.median(self.take.positions[trusted], axis=0)
        return np.asarray(trusted & (np.abs(self.take.positions - middle) <= _FARTHEST).all(axis=2))

    @cached_property
    def rigid(self) -> Rigidity:
        """Return how constant the distances between the markers are."""
        return rigidity(self.take.positions, self.plausible)

    @cached_property
    def exchanges(self) -> tuple[Exchange, ...]:
        """Return the pairs of markers whose labels are exchanged for a time."""
        return exchanges(np.where(self.plausible[..., None], self.take.positions, np.nan), self.rigid)

    @cached_property
    def analysis(self) -> PathAnalysis:
        """Return the analysis of all marker paths, with exchanged labels put right."""
        positions = exchange(self.take.positions, self.exchanges)
        rigid = rigidity(positions, self.plausible) if self.exchanges else self.rigid
        return analyse(positions, self.plausible, rigid, self.take.rate)
