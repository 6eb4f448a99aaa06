"""Monotone piecewise cubics (PCHIP) across the gaps of each coordinate.

The curve is a C¹ cubic through all trusted samples. Its slopes are the weighted harmonic means of the adjacent secants,
or 0 where these differ in sign, so it never overshoots the samples around a gap. A gap at the first or last frame of
the take has a trusted sample on one side only and is left unfilled. The slopes are limited in each coordinate by
itself, so rotating the world changes the answer a little. Cost: O(F M).

F. N. Fritsch, R. E. Carlson, Monotone piecewise cubic interpolation, 1980, doi:10.1137/0717021.
"""

from mocapclean.arrays import Bools
from mocapclean.numerics.interpolation import monotone
from mocapclean.parameters import parameters
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = "F. N. Fritsch, R. E. Carlson, 1980, Monotone piecewise cubic interpolation, doi:10.1137/0717021"

TRAITS = Traits(extrapolates=False, self_checked=True)


@parameters
class Params:
    """No parameter."""


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with the gaps (F, M) between two trusted samples of their marker filled."""
    return Solution(positions=monotone(take.positions, take.trusted), filled=fillable)
