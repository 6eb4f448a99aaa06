"""Frames of reference that move with a body: one for each frame of a take."""

from dataclasses import dataclass

from mocapclean.arrays import Floats


@dataclass(frozen=True)
class BodyFrames:
    """One frame of reference for each frame of a take: axes as rows (..., F, 3, 3), and origins (..., F, 3).

    Leading axes, such as one for each of several bodies, are common to both and to the positions.
    """

    axes: Floats
    origins: Floats

    def to_local(self, positions: Floats) -> Floats:
        """Return world positions (..., F, M, 3) in the coordinates of the body."""
        return (positions - self.origins[..., None, :]) @ self.axes.swapaxes(-1, -2)

    def to_world(self, positions: Floats) -> Floats:
        """Return positions (..., F, M, 3) in the coordinates of the body as world positions."""
        return positions @ self.axes + self.origins[..., None, :]
