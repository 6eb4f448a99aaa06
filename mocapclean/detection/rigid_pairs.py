"""Pairs of markers at constant distance, and the test whether that distance changes at the frame of a suspected step.

The constants were chosen by hand on the takes of ``bench trust``, seeds 0 to 4 (docs/results.md); no sweep was kept.
"""

import numpy as np

from mocapclean.arrays import Floats, Ints
from mocapclean.detection.steps import SLIDE_SECONDS, SNAP, Step
from mocapclean.geometry.distances import Rigidity
from mocapclean.numerics.robust import nan_median, nan_quantiles

_MOST_CHANGE = 0.5  # mm, change of a distance within the lag that a rigid pair may show
_LAG_SECONDS = 0.5  # s, lag over which the change is taken
_CONSTANT_SHARE = 0.9  # share of the frames in which the change must be that small
_CHANGED = 0.5  # mm, change of the median distance about a step that shows it
_WINDOW_SECONDS = 2.0  # s, frames on each side of a step that the medians are taken over


class RigidPairs:
    """The rigid pairs among markers and their partners.

    positions: (F, M, 3) mm, NaN where not trusted. A pair is rigid if its distance is the same half a
    second later in nine of ten frames. The frames around a given one, at which a step is suspected, do not count.
    """

    def __init__(self, positions: Floats, rigid: Rigidity, rate: float) -> None:
        self.positions, self.rigid = positions, rigid
        self.lag = min(max(1, round(_LAG_SECONDS * rate)), len(positions) // 2)
        self.margin = max(1, round(SLIDE_SECONDS / 2 * rate)) + SNAP
        self.window = max(1, round(_WINDOW_SECONDS * rate))
        self._partners = dict[tuple[int, int], Ints]()

    def partners(self, marker: int, frame: int) -> Ints:
        """Return the rigid partners of a marker, judged without the frames around the given one."""
        if (marker, frame) not in self._partners:
            partners = self.rigid.partners(marker)[0]
            distances = self._distances(marker, partners)
            changes = np.abs(distances[self.lag :] - distances[: -self.lag])
            changes[max(0, frame - self.margin - self.lag) : frame + self.margin] = np.nan
            usual_change = nan_quantiles(changes, (_CONSTANT_SHARE,))[0]
            self._partners[marker, frame] = partners[usual_change <= _MOST_CHANGE]
        return self._partners[marker, frame]

    def changed(self, marker: int, frame: int) -> Ints:
        """Return the partners in rigid pairs with a marker whose median distance changes about a frame.

        The medians leave out the frames of a slide around that frame, or the nearer half of the frames on a side that
        has too few.
        """
        partners = self.partners(marker, frame)
        distances = self._distances(marker, partners)
        first = frame - min(self.margin, frame // 2)
        last = frame + min(self.margin, (len(distances) - frame) // 2)
        before, after = distances[max(0, first - self.window) : first], distances[last:][: self.window]
        if not len(before) or not len(after):
            return partners[:0]
        return partners[np.abs(nan_median(after) - nan_median(before)) > _CHANGED]

    def allow(self, step: Step, stepped: list[int], stepping: list[int]) -> bool:
        """Whether distances in the marker's rigid pairs change as a step requires; True if it has no rigid pair.

        They do if there are none, or if the distances to at least one partner change that has not stepped at the same
        time (``stepped``). A single one that may step itself (``stepping``) must have no other pair that changes.
        """
        if not len(self.partners(step.marker, step.start)):
            return True
        changed = [partner for partner in self.changed(step.marker, step.start).tolist() if partner not in stepped]
        if len(changed) != 1:
            return len(changed) > 1
        (partner,) = changed
        return partner not in stepping or len(self.changed(partner, step.start)) <= 1

    def _distances(self, marker: int, partners: Ints) -> Floats:
        """Return the distances (F, p) from a marker to partners (p,)."""
        return np.asarray(np.linalg.norm(self.positions[:, partners] - self.positions[:, [marker]], axis=2))
