"""Weights of the neighbours of a marker: markers close to it, at distances that hardly vary, weigh most."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.distances import distances_of_each, exact_pairs
from mocapclean.solvers.kriging.frame_selection import spread_out

# The constants below were chosen by hand on the captures of `mocapclean bench markers`; no sweep was kept.
MAX_DISTANCE_FRAMES = 300  # frames over which the distances of a marker are measured
NEAR_RATIO = 25.0  # times the rigidity parameter, the distance (50 mm) below which neighbours weigh about equally
EXACT_SHARE = 0.005
"""Of the rigidity parameter, the SD of a distance (0.01 mm) below which a marker follows another exactly.

Measured markers never do, computed points do: ``mocapclean bench markers`` leaves points out by the same limit.
"""
N_NEAREST = 8  # heaviest neighbours that show how fast a marker may move; chosen by hand, no sweep was kept
FEATURE_SLACK = 2.5  # times the rigidity parameter, the SD of a distance (5 mm) below which features are scaled alike


@dataclass(frozen=True)
class NeighbourDistances:
    """Mean and variance of the distances between markers, and the neighbour weights that follow from them.

    mean, variance: (M, M), mm and mm²; row k is taken over frames in which marker k is trusted. Both are infinite for
    pairs that are seldom trusted together. rigidity: mm, the SD of a distance below which neighbours weigh alike.
    """

    mean: Floats
    variance: Floats
    rigidity: float

    @classmethod
    def measured(
        cls, positions: Floats, trusted: Bools, rigidity: float, *, n_own: int | None = None, exact: bool = False
    ) -> "NeighbourDistances":
        """Return the distances of positions (F, M, 3), each marker's over up to 300 frames in which it is trusted.

        exact: whether points that follow each other exactly are neighbours, as the joints of a skeleton are. If not,
        the variance of their distance is infinite: such a point is computed from the other one, not measured.
        """
        mean, variance = distances_of_each(positions, trusted, partial(_sampled, n_own or len(trusted)))
        if not exact:
            variance[exact_pairs(np.sqrt(variance), EXACT_SHARE * rigidity)] = np.inf
        return cls(mean, variance, rigidity)

    def weights(self, marker: int) -> Floats:
        """Return the weight (M,) of each marker as a neighbour of one; 0 for itself and for pairs never measured.

        w = 1 / ((Var d + r²) (E d + 25 r))      d the distance, r the rigidity parameter
        """
        return self.weights_between(np.intp(marker), np.arange(len(self.mean)))

    def nearest(self, marker: int) -> Ints:
        """Return the columns of the up to 8 heaviest neighbours of a marker."""
        weights = self.weights(marker)
        heaviest = np.argsort(-weights, kind="stable")[:N_NEAREST]
        return heaviest[weights[heaviest] > 0.0]

    def weights_between(self, markers: Ints | np.intp, neighbours: Ints) -> Floats:
        """Return the weights, as in ``weights``, of neighbours for markers of any shapes that broadcast."""
        variance = self.variance[markers, neighbours] + self.rigidity**2
        distance = self.mean[markers, neighbours] + NEAR_RATIO * self.rigidity
        weights = 1.0 / (variance * distance)
        return np.where(np.isfinite(weights) & (markers != neighbours), weights, 0.0)

    def rigid_scales(self, marker: int | Ints, neighbours: Ints) -> Floats:
        """Return the scale factors (..., n) of neighbour positions as regression features in turning axes.

        A factor is 1 / SD of the distance, so that the ridge penalty shrinks loosely tied neighbours more.
        """
        slack = FEATURE_SLACK * self.rigidity
        return np.asarray(1.0 / np.sqrt(self.variance[marker, neighbours] + slack**2), dtype=np.float64)

    def shifting_scales(self, marker: int | Ints, neighbours: Ints) -> Floats:
        """Return the scale factors (..., n) of neighbour positions as features in axes that only shift: 1 / (mean
        distance + constant).
        """
        distance = self.mean[marker, neighbours] + NEAR_RATIO * self.rigidity
        return np.asarray(1.0 / distance, dtype=np.float64)


def _sampled(n_own: int, frames: Ints) -> Ints:
    """Return up to ``MAX_DISTANCE_FRAMES`` of some frames, evenly chosen; those from ``n_own`` on where others lack."""
    own = spread_out(frames[frames < n_own], MAX_DISTANCE_FRAMES, 1)
    return np.append(own, spread_out(frames[frames >= n_own], MAX_DISTANCE_FRAMES - len(own), 1))
