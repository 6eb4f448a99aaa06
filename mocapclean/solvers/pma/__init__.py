"""Probabilistic model averaging: five predictors of a gap, each frame weighed by the likelihood of its distances.

    x̂ = Σ_i w_i x̂_i / Σ_i w_i    w_i = Π_k p_k(|x̂_i − P_k|),  k = 1, 2, 3

P_1, P_2, P_3 are the three markers seen all through the gap whose distance to the lost one varies least, p_k the
density of that distance where it is known. The predictors are

1. ``local``: straight lines in the coordinates of the three markers,
2. ``polynomial``: a quadratic regression of the local coordinates on the shape of the three, |P_1 P_2| and P_3,
3. ``kernel``: a general regression network on the same shape, standardised,
4. ``linear``: a linear regression on all markers seen through the gap whose distance varies by less than ``loosest``,
5. ``pca``: strategy R2 of Gløersen and Federolf.

Each is made to meet the trusted samples on both sides by a linear ramp, one-sided at the ends of a take. The average is
moved, towards or away from P_3, P_2, P_1 in turn, until its distances lie within the 1st and 99th percentile of the
known ones. Markers are filled in the order of their presence, and each then serves as a reference for the next.

M. Tits, J. Tilmanne, T. Dutoit, 2018, doi:10.1371/journal.pone.0199744.

Where this departs from the authors' program, and why:

- Nothing is filtered. Theirs passes everything through a sliding median and mean of 0.07 s, before and after, which
  moves the truth itself by up to a centimetre in quick motion. ``output_filter`` does so with the filled samples.
- Where they draw frames at random to learn from, here they are evenly spaced.
- The three references are the first in order that are seen all through the gap and span a plane. Where there are none,
  the predictors that need none are averaged with equal weights.
- Markers that are seldom trusted are filled, where theirs are dropped below 30 %; a marker serves as soon as it is
  filled, even in part.
- References enter the regressions unfiltered, and a local coordinate that varies by rounding alone is no predictor.

Cost for each gap: O(N G) with up to N = 1000 frames to learn from and G in the gap, a least-squares problem of up to
500 × 3M, and the cost of ``pca``.
"""

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.solvers.method import Traits
from mocapclean.solvers.pma.averaging import GapFiller, frames_in
from mocapclean.solvers.pma.params import Params as Params
from mocapclean.solvers.pma.sliding import median_mean
from mocapclean.solvers.travelling import TravellingTake
from mocapclean.take import Solution, Take

REFERENCE = (
    "M. Tits, J. Tilmanne, T. Dutoit, 2018, Robust and automatic motion-capture data recovery using soft skeleton "
    "constraints and model averaging, doi:10.1371/journal.pone.0199744"
)

TRAITS = Traits(learns_from_session=True)


def solve(take: Take, params: Params, fillable: Bools) -> Solution:
    """Return the take with every enclosed gap filled, and the gaps at the ends that have references or helpers."""
    travelling = TravellingTake(take)
    n_own, seen = travelling.n_own, travelling.trusted[: travelling.n_own]
    filler = GapFiller(travelling.local, travelling.trusted, n_own, params, take.rate)
    for marker in filler.order():
        filler.fill(marker)
    local = filler.local[:n_own]
    if params.output_filter:
        width = frames_in(params.output_filter, take.rate)
        local = np.where(seen[..., None], local, median_mean(local.reshape(len(local), -1), width).reshape(local.shape))
    positions, filled = travelling.to_world(local, filler.known[:n_own] & ~seen)
    return Solution(positions=positions, filled=filled, facts={"gaps_without_references": filler.n_without_references})
