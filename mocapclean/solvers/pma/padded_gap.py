"""A gap with the trusted frames on both sides, and the ramp that makes a path meet them."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats


@dataclass(frozen=True)
class PaddedGap:
    """A gap of a marker, with the adjacent trusted frame on each side where there is one.

    span: the frames of the gap and of these. left, right: whether there is a trusted frame before, and after.
    """

    marker: int
    span: slice
    left: bool
    right: bool

    @property
    def inner(self) -> slice:
        """The frames of the gap within its span."""
        return slice(int(self.left), -1 if self.right else None)

    def without_ramp(self, path: Floats, first: Floats, last: Floats) -> Floats:
        """Return a path (n, d) over the span less the linear ramp between its residuals (d,) at the two ends.

        With a trusted frame on one side only, the residual there counts for both ends.
        """
        before = first if self.left else last if self.right else np.zeros_like(first)
        after = last if self.right else before
        share = np.linspace(0.0, 1.0, len(path))[:, None]
        corrected: Floats = path - (1.0 - share) * before - share * after
        return corrected

    def meeting(self, path: Floats, known: Floats) -> Floats:
        """Return a path (n, d) over the span, made to meet the known values (n, d) at its ends."""
        residual = path - known
        return self.without_ramp(path, residual[0], residual[-1])
