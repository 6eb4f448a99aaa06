"""A take about a point that travels with the body, for methods that predict a marker from its neighbours."""

import numpy as np

from mocapclean.arrays import Bools, Floats, evenly_spaced
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.take import Take

# A take with this many frames learns from no other; a shorter one from as many frames of its session for each that it
# lacks. Chosen on half of the takes of `benchmarks/session.py`: with 1,200 frames of the session instead of 600 for 300
# frames the errors of pca and pma were larger by 3 to 13 %.
ENOUGH_FRAMES = 600
SESSION_SHARE = 2


class TravellingTake:
    """The frames and markers of a take with any trusted sample, about a point that travels with the body.

    trusted: (f, m). local: (f, m, 3) millimetres from the travelling point, 0 where untrusted. The first ``n_own``
    frames are those of the take, the others those of its session.
    """

    def __init__(self, take: Take) -> None:
        self.shape = take.trusted.shape
        frames, columns = np.flatnonzero(take.trusted.any(axis=1)), np.flatnonzero(take.trusted.any(axis=0))
        self._place, self.n_own = np.ix_(frames, columns), len(frames)
        positions, self.trusted = take.positions[self._place], take.trusted[self._place]
        if take.session:
            session = take.session.select(columns)
            seen = np.flatnonzero(session.trusted.any(axis=1))
            lacking = max(0, SESSION_SHARE * (ENOUGH_FRAMES - self.n_own))
            chosen = self.n_own + seen[evenly_spaced(len(seen), lacking)]
            rows = np.append(np.arange(self.n_own), chosen)
            positions, trusted = session.after(positions, self.trusted)
            positions, self.trusted = positions[rows], trusted[rows]
        origin = moving_origin(positions, self.trusted)[:, None]
        self._origin = origin[: self.n_own]
        self.local: Floats = np.where(self.trusted[..., None], positions - origin, 0.0)

    def to_world(self, local: Floats, filled: Bools) -> tuple[Floats, Bools]:
        """Return local positions (f, m, 3) of the take's own frames as positions (F, M, 3), and a mask (f, m) as a mask
        (F, M).
        """
        positions, answered = np.zeros((*self.shape, 3)), np.zeros(self.shape, dtype=bool)
        positions[self._place], answered[self._place] = local + self._origin, filled
        return positions, answered
