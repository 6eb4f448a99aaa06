"""Straight lines about a point that travels with the body: a method that is in no registry but that of its tests.

As a script it is the command ``mocapclean`` with this method in the registry.
"""

from typing import Annotated

from mocapclean.arrays import Bools
from mocapclean.geometry.moving_origin import moving_origin
from mocapclean.numerics.interpolation import linear
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = "A toy of the tests."

TRAITS = Traits(self_checked=True)


@parameters
class Params:
    """How much of the travel is followed."""

    share: Annotated[float, Field(ge=0, le=1), About(symbol="a", text="share of the travel that is followed")] = 1.0


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with all fillable samples (F, M) filled."""
    origin = params.share * moving_origin(take.positions, take.trusted)[:, None]
    return Solution(positions=linear(take.positions - origin, take.trusted) + origin, filled=fillable)


if __name__ == "__main__":
    import sys

    from mocapclean.solvers import SOLVERS

    SOLVERS["toy"] = sys.modules["__main__"]

    from mocapclean.cli import cli

    cli()
