"""Skeleton-constrained singular value thresholding: the low-rank matrix whose bones are not too long.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the trusted entries,  ‖C_i z‖ ≤ d_i

i runs over the bones and frames with an untrusted end; C_i z is the difference of the two ends, d_i the length of
the bone. The rest is ``svt``. As printed, the multipliers ascend the dual from y = B, p = 0, s = 0 (20), (22), (23):

    Z = 𝒟_τ(y + Σ C_iᵀ p_i)    y += δ (B − Z) on the trusted entries    (p_i, s_i) = 𝒫((p_i, s_i) − δ (C_i z, d_i))

𝒫 projects on the cone ‖p‖ ≤ s: (p, s) itself inside, 0 below it, else (‖p‖ + s) / 2 · (p / ‖p‖, 1).

C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5, whose lengths are in units of 56.444 mm:
τ = 8 √(F · 3M), δ = 0.75, and a root mean square residual of 0.01 over the trusted entries to stop at.

Where this departs from the print, and why:

- The print has (p, s) in place of (p, ‖p‖) in the last case of 𝒫. That is not in the cone and loses the constraint.
- The ascent is safe for δ < 2 / λ, λ the largest eigenvalue of AᵀA + CᵀC, A being the selection of the trusted
  entries: 0.76 with one missing joint at the end of a chain, 0.59 with one inside it. ``iteration="paper"`` keeps δ
  at 1.9 / λ or below; ``"accelerated"`` is the splitting of ``svt`` with the bones as bounds.
- The printed stopping rule ignores the bones. ``"accelerated"`` goes on until none is too long by more than
  ``bone_tolerance``; ``"paper"`` stops as printed. The print tests Z before Z exists; here the test follows the update.
- A ``tolerance`` below 2e-5 spreads of the take is reached by semismooth Newton steps in place of the splitting.
  It then holds for the bones, too. An iteration is then an update of the multipliers.
- Without a skeleton the bones are pairs of markers whose distance is constant over the trusted samples.
- The skipped first iterations and ``origin`` are those of ``svt``. The limit of iterations is not printed.

The constraint has one side: bones may still come out too short.

Cost per iteration: that of ``svt`` and two sparse products over the constraints.
"""

from typing import Annotated

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.geometry.skeleton import Bone
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import Iterate
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers import svt
from mocapclean.solvers.method import KnownBones, Traits, limit_reached
from mocapclean.take import Solution, Take

REFERENCE = (
    "C.-H. Tan, J. Hou, L.-P. Chau, 2015, Motion capture data recovery using skeleton constrained singular value "
    "thresholding, doi:10.1007/s00371-014-1031-5"
)

TRAITS = Traits(
    needs_bones=(
        "scsvt must have bones: a skeleton that names the markers, or markers that keep their distance. "
        "Got none among {n_markers} markers; give a skeleton or use svt."
    )
)

_SAFE_STEP = 1.9  # δ λ of the plain ascent at most; it is safe below 2


@parameters
class Params(svt.Params):
    """The parameters of ``svt``, and the tolerance of the bones."""

    bone_tolerance: Annotated[
        float,
        Field(ge=0),
        About(symbol="ε", unit="mm", text="accelerated: how much too long the worst bone may be at the end"),
    ] = 2.82222
    step: Annotated[float, Field(gt=0, lt=2), About(symbol="δ", text="step of the plain ascent, at most 1.9 / λ")] = (
        0.75
    )
    max_iterations: Annotated[int, Field(ge=1), About(symbol="k_max", text="most iterations after the kick-start")] = (
        10000
    )


def solve(take: Take, params: Params, fillable: Bools, known_bones: KnownBones) -> Solution:
    """Return the take with all fillable samples (F, M) filled.

    The trace is the residual of the trusted entries in mm.
    """
    data = centred_matrix(take.positions, take.trusted, about_mean=params.origin == "mean")
    edges = loose_edges(known_bones.bones, take.markers, take.trusted)
    plain = params.iteration == "paper"
    result = svt.minimise(
        data,
        edges,
        params,
        step=min(params.step, _SAFE_STEP / edges.curvature(data.known)) if plain else 0.0,
        excess_tolerance=np.inf if plain else params.bone_tolerance,
    )
    state = f"residual {result.residual:.2g} mm, longest bone excess {result.excess:.2g} mm"
    return Solution(
        positions=data.positions(result.matrix),
        filled=fillable,
        converged=result.converged,
        iterations=len(result.trace),
        reason=_reason(result, params, state),
        trace=tuple(result.trace),
        facts={"bones": len(known_bones.bones), "bones_from": known_bones.source, "excess_mm": result.excess},
    )


def _reason(result: Iterate, params: Params, state: str) -> str:
    """Return why the iteration ended, and its state."""
    if result.contradictory:
        return f"the lengths of the bones exclude each other; {state}"
    return state if result.converged else limit_reached(params, "max_iterations", state)


def loose_edges(bones: tuple[Bone, ...], markers: tuple[str, ...], trusted: Bools) -> DistanceBounds:
    """Return the bones, frame by frame, with an untrusted end; both ends are trusted in some frame of the take."""
    # The columns of the matrix are the markers that are trusted in some frame.
    used = np.flatnonzero(trusted.any(axis=0))
    column = {markers[marker]: k for k, marker in enumerate(used)}
    usable = [bone for bone in bones if bone.start in column and bone.end in column]
    start = np.array([column[bone.start] for bone in usable], dtype=np.intp)
    end = np.array([column[bone.end] for bone in usable], dtype=np.intp)
    # Sample numbers run over the columns of a frame, then over the frames.
    known = trusted[:, used]
    frames, loose = np.nonzero(~(known[:, start] & known[:, end]))
    samples = frames * known.shape[1]
    lengths = np.array([bone.length for bone in usable])
    return DistanceBounds(samples + start[loose], samples + end[loose], lengths[loose], known.size)
