"""What a picture of a take is drawn from: its samples before and after, their status, bars and neighbours."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.distances import rigidity
from mocapclean.geometry.upright import up_axis
from mocapclean.take import Event, Take
from mocapclean.take.status import Codes, counted, supplied

_CUSTOM = 2.0  # how much more the y axis of a skeleton counts; chosen by hand, for dancers who lie or bend
_NEIGHBOURS = 4  # most neighbours of a marker in a picture; chosen by hand, so that they can be read


@dataclass(frozen=True, kw_only=True)
class View:
    """The arrays of one take for pictures.

    before: the take with the trust that detection left. after: the take as it was written, or ``before`` where nothing
    was. codes: (F, M) the status of every sample. sd: (F, M) mm, or None if the method gives none. poses: (F, C) the
    channels of the skeleton before and after, or None. events: of the file. invalidated: whether distrusted samples
    that were left are marked missing in the output.
    """

    before: Take
    after: Take
    codes: Codes
    sd: Floats | None = None
    poses: tuple[Floats, Floats] | None = None
    events: tuple[Event, ...] = ()
    invalidated: bool = False

    @property
    def in_file(self) -> Bools:
        """The samples (F, M) that the input file has."""
        return np.isfinite(self.before.positions).all(axis=2) & ~self.before.distrusted_by("missing")

    @property
    def in_output(self) -> Bools:
        """The samples (F, M) that the output has."""
        finite = np.isfinite(self.after.positions).all(axis=2)
        kept = self.before.trusted | ~counted(self.codes) if self.invalidated else self.in_file
        return np.asarray(finite & (kept | supplied(self.codes)))

    def neighbours(self) -> list[list[int]]:
        """Return for each marker the columns of up to four others whose distance to it varies least, near ones first.

        They are the partners of ``geometry.distances``: a method may weigh others besides them.
        """
        pairs = rigidity(self.before.positions, self.before.trusted)
        return [pairs.partners(marker)[0][:_NEIGHBOURS].tolist() for marker in range(len(self.before.markers))]

    def up_axis(self) -> int:
        """Return the axis that is most likely vertical, 1 or 2; no file format states the vertical of its samples.

        Skeletons have their y axis up by custom.
        """
        weight = _CUSTOM if self.poses is not None else 1.0
        return up_axis(self.before.positions, self.before.trusted, weight)


Keep = Callable[[View], object]
"""A function that is given the view of a take as soon as the take is done."""


def view(
    whole: Take, before: Take, written: Take, after: Take, codes: Codes, sd: Floats | None, *, invalidated: bool = False
) -> View:
    """Return the view of a take.

    whole: the take with all markers of the file as read, and written: the same as written. before and after: the
    selected markers of both.
    """
    poses = None if whole.poses is None or written.poses is None else (whole.poses, written.poses)
    return View(
        before=before,
        after=after,
        codes=codes,
        sd=sd,
        poses=poses,
        events=formats.events(whole),
        invalidated=invalidated,
    )
