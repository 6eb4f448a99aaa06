"""Straight lines across the gaps of each coordinate.

x(t) = x_a + (t − a) / (b − a) · (x_b − x_a) between the trusted frames a and b around the gap. A gap that touches
the first or last frame has no second side and is left unfilled. Cost: O(F M).
"""

from pydantic.dataclasses import dataclass

from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.interpolation import linear
from mocapclean.parameters import STRICT
from mocapclean.solvers.fillable import enclosed
from mocapclean.take import Solution, Take

REFERENCE = "Linear interpolation between the trusted samples around a gap."


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """Nothing to choose."""


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill the gaps that have a trusted sample of the same marker on both sides."""
    return Solution(positions=linear(take.positions, take.trusted), filled=enclosed(take.trusted))
