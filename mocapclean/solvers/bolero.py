"""BoLeRO: DynaMMo with bones that keep their lengths.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, r I)    |x_u − x_v| = ℓ_e for a bone e = (u, v)

First the system is learned as in ``dynammo``. Then, in every iteration, the missing samples at an end of a bone are
moved from C E[z_t] to the nearest place that keeps the lengths (``constraint="hard"``, Newton's method on the
optimality conditions), or towards it (``"soft"``), and count as data for the next iteration:

    min_y |y − C ẑ|²  subject to the bones,   or   min_y |y − C ẑ|² + Σ_e w_e c_e²,   c_e = (|y_u − y_v|² − ℓ_e²) / 2ℓ_e

so that expectation and maximisation raise the likelihood of data and estimates together. L. Li, J. McCann, N. S.
Pollard, C. Faloutsos, 2010, doi:10.2312/SCA/SCA10/179-188.

Where this departs from the print, and why:

- All departures of ``dynammo``. Missing samples without a bone are integrated out, as there.
- The lengths come from the skeleton or from pairs of markers that are rigid where both are trusted. The authors'
  programs measure them on the complete take, hidden samples included.
- Markers on skin are no skeleton: a measured length has a spread s_e, and "hard" gives it the weight w_e = r / s_e²,
  which yields the likeliest place under both. Exact constraints of three such lengths move a marker by many times s_e.
- Newton's step is taken whole, after some projections onto the tangents of the bones, and no longer than half a
  bone; the authors halve every step. More bones than a marker has freedom are satisfied in the least squares.
- The authors' soft penalty is 100 (|·|² − ℓ²)² against |y − C ẑ|² / r in metres, so its relative weight depends on r.
  Here c_e is the stretch of a bone, in the unit of y − C ẑ, and w is its weight relative to |y − C ẑ|².

Cost per iteration: that of ``dynammo``, and O((U + E)³) per Newton step for each frame with U missing coordinates and
E bones on them.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.geometry.bone_projection import project_to_bone_lengths, tied_points
from mocapclean.geometry.skeleton import Bone
from mocapclean.numerics.state_space.smoother import Masks
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers import dynammo
from mocapclean.solvers.method import KnownBones, Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = (
    "L. Li, J. McCann, N. S. Pollard, C. Faloutsos, 2010, BoLeRO: a principled technique for including bone length "
    "constraints in motion capture occlusion filling, doi:10.2312/SCA/SCA10/179-188"
)

TRAITS = Traits(
    needs_bones=(
        "bolero must know the length of a bone. Got no skeleton with joints of these names and no two markers that "
        "stay at one distance; give a skeleton, or use dynammo."
    )
)


@parameters
class Params(dynammo.Params):
    """The parameters of dynammo, and the constraint of the bones."""

    constraint: Annotated[
        Literal["hard", "soft"],
        About(symbol="g", text="bones keep their length within its spread, or tend to"),
    ] = "hard"
    bone_weight: Annotated[
        float,
        Field(ge=0),
        About(symbol="w", text="weight of a bone's squared stretch relative to a squared residual, soft only"),
    ] = 100.0
    bone_iterations: Annotated[
        int, Field(ge=1), About(symbol="b", text="most iterations with bones, at the end of max_iterations")
    ] = 20


def solve(take: Take, params: Params, fillable: Bools, known_bones: KnownBones) -> Solution:
    """Return the take with all fillable samples (F, M) filled.

    ``positions`` holds the projected estimate where missing, and C E[z_t] where trusted. The trace is that of
    ``dynammo``, then the log-likelihood per trusted and projected coordinate.
    """
    columns = dynammo.Columns(take, params.frame)
    learner = BoneLearner(columns, params, take, known_bones.bones)
    learner.learn()
    states = columns.positions(learner.system.expected_values(learner.smoothed.means))
    return Solution(
        positions=np.where(take.trusted[..., None], states, columns.positions(learner.guess)),
        filled=fillable,
        converged=learner.converged,
        iterations=learner.iterations,
        reason=learner.reason,
        trace=tuple(learner.trace),
        facts={
            "states": len(learner.system.dynamics.start),
            "bones": len(known_bones.bones),
            "bones_from": known_bones.source,
            "largest_kkt_residual_mm": columns.spread * learner.residual,
        },
    )


class BoneLearner(dynammo.Learner):
    """Expectation maximisation that continues, once it is stationary, with the lengths of bones as constraints.

    ends: (E, 2) the columns of the bones' ends. lengths: (E,) and variances: (E,) of the lengths, in spreads. tied:
    (F, m) the missing samples at an end of a bone. residual: the largest of the last projection.
    """

    params: Params

    def __init__(self, columns: dynammo.Columns, params: Params, take: Take, bones: tuple[Bone, ...]) -> None:
        super().__init__(columns, params)
        place = {marker: k for k, marker in enumerate(np.array(take.markers)[columns.used])}
        used = [bone for bone in bones if bone.start in place and bone.end in place]
        self.ends = np.array([(place[bone.start], place[bone.end]) for bone in used], dtype=np.intp).reshape(-1, 2)
        self.lengths = np.array([bone.length for bone in used]) / columns.spread
        self.variances = np.square([bone.spread for bone in used]) / columns.spread**2
        missing = ~columns.seen & columns.seen.any(axis=1, keepdims=True)
        self.tied = tied_points(missing, self.ends, columns.seen)
        self.residual, self.constrained = 0.0, False

    def learn(self) -> None:
        """Learn without bones first, then with bones and with the samples at their ends as data."""
        params = self.params
        if self.tied.any():
            self.limit = max(params.max_iterations - params.bone_iterations, 1)
        super().learn()
        if self.tied.any():
            self.constrained, self.converged, self.limit = True, False, params.max_iterations
            self.counted = Masks(self.counted.seen | self.tied)
            self.guess = self.impute()
            self.iterate(params.bone_iterations, params.tolerance)

    @property
    def reason(self) -> str:
        """Why the iteration ended."""
        if self.converged or self.iterations == self.params.max_iterations:
            return super().reason
        return limit_reached(self.params, "bone_iterations")

    def impute(self) -> Floats:
        """Return the trusted values, and C E[z_t] elsewhere, projected on the bones' lengths in the second stage."""
        guess = super().impute()
        if not self.constrained:
            return guess
        # min_y |y − C ẑ|² + Σ_e w_e c_e²; an infinite w_e is a constraint
        weights = self._hard_weights() if self.params.constraint == "hard" else self.params.bone_weight
        points = guess.reshape(len(guess), -1, 3)
        points, errors = project_to_bone_lengths(points, self.tied, self.columns.seen, self.ends, self.lengths, weights)
        self.residual = float(errors.max())
        return points.reshape(guess.shape)

    def _hard_weights(self) -> Floats:
        """Return w_e = r / s_e² for each bone (E,), infinite where the length has no spread."""
        infinite = np.full_like(self.variances, np.inf)
        return np.divide(self.system.noise_variance, self.variances, out=infinite, where=self.variances > 0)
