"""Quantities that several trust rules need (rigidity, exchanged labels, path analysis), each computed once, at first
use.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.detection.analysis import PathAnalysis, analyse
from mocapclean.detection.exchanges import Exchange, exchange, exchanges
from mocapclean.geometry.distances import Rigidity, rigidity
from mocapclean.numerics.robust import median, nan_median
from mocapclean.take import Take
from mocapclean.take.posed import known_poses, posed

if TYPE_CHECKING:
    from mocapclean.detection.joints import JointFault
    from mocapclean.geometry.joint_motion import JointMotion

FARTHEST = 5e4  # mm: ten times the farthest coordinate from the median of its take in the captures, 5.2 m
_FARTHEST_SHARE = 30.0  # median distances from the median: at most 14 in the captures; counts where a unit is wrong


@dataclass(frozen=True)
class Evidence:
    """A take and everything that the rules examine of it."""

    take: Take

    @cached_property
    def plausible(self) -> Bools:
        """Return the trusted samples (F, M) that lie in a capture volume about the median of all trusted ones.

        Within 50 m of it in each coordinate, or within 30 times the median distance where that is farther. Detached
        markers need not be positions: each has a median and a median distance of its own.
        """
        trusted = self.take.trusted
        plausible = np.zeros_like(trusted)
        attached = ~self.take.detached
        for columns in (np.flatnonzero(attached), *np.flatnonzero(self.take.detached)[:, None]):
            plausible[:, columns] = _in_volume(self.take.positions[:, columns], trusted[:, columns])
        return plausible

    @cached_property
    def rigid(self) -> Rigidity:
        """Return how constant the distances between the markers are; no distance to a detached one is."""
        return self._rigidity(self.take.positions)

    @cached_property
    def exchanges(self) -> tuple[Exchange, ...]:
        """Return the pairs of markers whose labels are exchanged for a time; detached ones have none."""
        judged = self.plausible & ~self.take.detached
        return exchanges(np.where(judged[..., None], self.take.positions, np.nan), self.rigid, self.take.rate)

    @cached_property
    def analysis(self) -> PathAnalysis:
        """Return the analysis of all marker paths, with exchanged labels put right."""
        positions = exchange(self.take.positions, self.exchanges)
        rigid = self._rigidity(positions) if self.exchanges else self.rigid
        return analyse(positions, self.plausible, rigid, self.take.rate)

    @cached_property
    def motion(self) -> "JointMotion":
        """Return the rotations and translations of the joints of a take with poses."""
        from mocapclean.geometry.joint_motion import joint_motion  # takes of markers need none of it

        return joint_motion(*known_poses(self.take))

    @cached_property
    def joint_faults(self) -> "tuple[JointFault, ...]":
        """Return the faults of the joints of a take with poses."""
        from mocapclean.detection.joints import faults  # takes of markers need none of it

        skeleton, _ = posed(self.take)
        return faults(skeleton, self.motion, self.take.rate)

    def _rigidity(self, positions: Floats) -> Rigidity:
        """Return the rigidity of positions (F, M, 3), in which detached markers are partners of none."""
        return rigidity(positions, self.plausible & ~self.take.detached)


def _in_volume(positions: Floats, trusted: Bools) -> Bools:
    """Return the trusted (F, M) samples of positions (F, M, 3) that lie in a capture volume."""
    if not trusted.any():
        return trusted
    distance = np.abs(positions - nan_median(positions[trusted])).max(axis=2)
    farthest = max(FARTHEST, _FARTHEST_SHARE * median(distance[trusted]))
    return np.asarray(trusted & (distance <= farthest))
