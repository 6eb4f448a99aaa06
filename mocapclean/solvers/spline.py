"""Monotone piecewise cubics (PCHIP) across the gaps of each coordinate.

A C¹ cubic through all trusted samples whose slopes are the weighted harmonic means of the neighbouring secants, 0
where these differ in sign: it never overshoots the samples around a gap. A gap that touches the first or last
frame has no second side and is left unfilled. The limiter works per coordinate, so turning the world changes the
answer a little. Cost: O(F M).

F. N. Fritsch, R. E. Carlson, Monotone piecewise cubic interpolation, 1980, doi:10.1137/0717021.
"""

from pydantic.dataclasses import dataclass

from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.interpolation import monotone
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import enclosed
from mocapclean.take import Solution, Take

REFERENCE = "F. N. Fritsch, R. E. Carlson, 1980, Monotone piecewise cubic interpolation, doi:10.1137/0717021"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """Nothing to choose."""


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill the gaps that have a trusted sample of the same marker on both sides."""
    return Solution(positions=monotone(take.positions, take.trusted), filled=enclosed(take.trusted))
