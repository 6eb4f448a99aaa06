"""Straight lines across the gaps of each coordinate.

x(t) = x_a + (t − a) / (b − a) · (x_b − x_a) between the trusted frames a and b around the gap. A gap at the first or
last frame of the take has a trusted sample on one side only and is left unfilled. Cost: O(F M).
"""

from mocapclean.arrays import Bools
from mocapclean.numerics.interpolation import linear
from mocapclean.parameters import parameters
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = "Linear interpolation between the trusted samples around a gap."

TRAITS = Traits(extrapolates=False, self_checked=True)


@parameters
class Params:
    """No parameter."""


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with the gaps (F, M) between two trusted samples of their marker filled."""
    return Solution(positions=linear(take.positions, take.trusted), filled=fillable)
