"""A take about a point that travels with the body, for methods that predict a marker from its neighbours."""

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.take import Take


class TravellingTake:
    """The frames and markers of a take with any trusted sample, about a point that travels with the body.

    trusted: (f, m). local: (f, m, 3) millimetres from the travelling point, 0 where untrusted.
    """

    def __init__(self, take: Take) -> None:
        self.shape = take.trusted.shape
        self._place = np.ix_(np.flatnonzero(take.trusted.any(axis=1)), np.flatnonzero(take.trusted.any(axis=0)))
        self.trusted = take.trusted[self._place]
        positions = take.positions[self._place]
        self._origin = moving_origin(positions, self.trusted)[:, None]
        self.local: Floats = np.where(self.trusted[..., None], positions - self._origin, 0.0)

    def to_world(self, local: Floats, filled: Bools) -> tuple[Floats, Bools]:
        """Return local positions (f, m, 3) as positions (F, M, 3), and a mask (f, m) as a mask (F, M)."""
        positions, answered = np.zeros((*self.shape, 3)), np.zeros(self.shape, dtype=bool)
        positions[self._place], answered[self._place] = local + self._origin, filled
        return positions, answered
