"""Regression kriging in axes that move with body segments: several models, averaged by their errors in the take itself.

For a gap of marker k, y is the position of k in a frame of reference that travels with its body segment. The frame is
aligned with those of k's most rigid neighbours that are known in the whole gap; a_t are their positions in the frame:

    y_t = μ + aᵗW + g(t) + ε      W a ridge regression, g a Matérn process bridged over the gap

Six such predictors, and seven in gaps of at least ``motion``, differ in the frame (turning, only shifting, on the
circle of a joint between two markers at known distances) and in the features a (few or many neighbours, with or without
the nearness to poses and their displacements over 1/20 s). They are combined with weights w ≥ 0, Σ w = 1, that minimise
the mean square error on windows. A window is a stretch as long as the gap in which k is known; it is held out and
predicted as the gap is. The same errors give the standard deviation of every filled sample: their size, the variance of
g over the gap, and how much more the predictors disagree in the gap than in windows.

Two more predictors use the marker's own path alone: it stays, or moves on as it did. A gap is predicted from them where
they err clearly less on windows that resemble the gap.

Near neighbours at a nearly constant distance from k weigh most. Gaps of up to 1/24 s are bridged over time first, and
then count as known. A gap whose neighbours come and go is filled in segments, which are joined by kriging of their
errors. Where most frames lack neighbours, later passes learn from the samples that earlier ones filled.
Filled samples are moved so that the bones of a skeleton, and pairs of markers that prove rigid, keep their lengths.
Nearly rigid pairs stay within the distances that the take shows.

Our own method. Its parts: N. Cressie, 1993, doi:10.1002/9781119115151 (regression kriging); W. Kabsch, 1976,
doi:10.1107/S0567739476001873 (frames); L. Breiman, 1996, doi:10.1007/BF00117832 (stacking).

Cost per gap of L frames with q neighbours: O(n q²) for the n frames, about 500 + L, that are learnt from and tested on,
and O(q³) for 24 ridge systems in each predictor. Only the search for windows grows with the take.
"""

from typing import Annotated

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.kriging.passes import fill_in_passes
from mocapclean.solvers.kriging.take_state import TakeState
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = (
    "Regression kriging in body-segment frames, stacked; this project. After N. Cressie, 1993, Statistics for spatial "
    "data, doi:10.1002/9781119115151"
)


TRAITS = Traits(
    error_bars=True,
    gap_by_gap=True,
    self_checked=True,
    learns_from_session=True,
    turns_joints=True,
    idle_facts={"passes": 0},
)


@parameters
class Params:
    """The parameters of the method: how much data a gap is learnt from, and which distances count as rigid."""

    rigidity: Annotated[
        float,
        Field(gt=0),
        About(symbol="s", unit="mm", text="SD of a distance below which neighbours count as equally rigid"),
    ] = 2.0
    noise: Annotated[
        float, Field(gt=0), About(symbol="e", unit="mm", text="errors below which windows count as equal")
    ] = 0.03
    windows: Annotated[int, Field(ge=0), About(symbol="w", text="most windows that a gap is tried on")] = 12
    learnt: Annotated[int, Field(ge=20), About(symbol="n", text="most frames that a gap is learnt from")] = 300
    shrinkage: Annotated[
        float, Field(ge=0, lt=1), About(symbol="c", text="share taken off the covariances of the predictors' errors")
    ] = 0.3
    passes: Annotated[int, Field(ge=1), About(symbol="p", text="most passes, where gaps learn from filled samples")] = 4
    motion: Annotated[
        float,
        Field(ge=0),
        About(symbol="m", unit="s", text="length of a gap from which the motion of neighbours predicts it"),
    ] = 0.25
    bone_spread: Annotated[
        float, Field(ge=0), About(symbol="b", unit="mm", text="largest SD of a distance that counts as a bone's length")
    ] = 0.05


def solve(take: Take, params: Params, fillable: Bools, wanted: Bools, begun: Solution | None = None) -> Solution:
    """Return a Solution with every gap filled that has known samples beside it or known neighbours.

    Gaps at the ends of the take are included; a marker needs ten known samples.

    wanted: (F, M) bool, the samples whose gaps need a fill; other gaps are filled only where these learn from them.
    begun: a solution of the take with more samples trusted, whose filled samples are kept; only the gaps beside them
    are then filled. ``sd`` is given for every filled sample.
    """
    state = TakeState(take, params, begun)
    passes = fill_in_passes(state, fillable, wanted)
    positions, sd = state.positions[: state.n_own], state.sd[: state.n_own]
    filled = fillable & np.isfinite(sd)
    return Solution(
        positions=np.where(filled[..., None] | take.trusted[..., None], positions, 0.0),
        filled=filled,
        sd=np.where(filled, sd, 0.0),
        reason="closed form" if passes else "nothing to fill",
        facts={"passes": passes},
    )
