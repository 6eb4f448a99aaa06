"""Changes to takes with poses, as a repair makes them."""

from dataclasses import replace

import numpy as np

from mocapclean.take import Take
from mocapclean.take.posed import with_poses


def turned(take: Take, joint: str, frames: slice, degrees: float) -> Take:
    """The take with all channels of one joint filled in some frames, that many degrees or mm from where they were."""
    column = take.markers.index(joint)
    poses, filled, known = take.poses.copy(), take.filled.copy(), take.known.copy()
    channels = np.flatnonzero(take.owners == column)
    poses[frames, channels[0] : channels[-1] + 1] += degrees
    filled[frames, column] = True
    known[frames, channels[0] : channels[-1] + 1] = False
    return replace(with_poses(take.with_known(known), poses), filled=filled)
