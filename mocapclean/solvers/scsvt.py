"""Skeleton-constrained singular value thresholding: the low-rank matrix whose bones are no longer than they are.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the trusted entries,  ‖C_i z‖ ≤ d_i

i runs over the bones and frames with an untrusted end; C_i z is the difference of the two ends, d_i the length of
the bone. The rest is ``svt``. As printed, the multipliers climb the dual from y = B, p = 0, s = 0 (20), (22), (23):

    Z = 𝒟_τ(y + Σ C_iᵀ p_i)    y += δ (B − Z) on the trusted entries    (p_i, s_i) = 𝒫((p_i, s_i) − δ (C_i z, d_i))

𝒫 projects on the cone ‖p‖ ≤ s: (p, s) itself inside, 0 below it, else (‖p‖ + s) / 2 · (p / ‖p‖, 1).

C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5, whose lengths are in units of 56.444 mm:
τ = 8 √(F · 3M), δ = 0.75, and a root mean square residual of 0.01 over the trusted entries as the end.

Where this departs from the print, and why:

- The print has (p, s) in place of (p, ‖p‖) in the last case of 𝒫. That is not in the cone and loses the constraint.
- The ascent is safe for δ < 2 / λ, λ the largest eigenvalue of AᵀA + CᵀC, A being the selection of the trusted
  entries: 0.76 with one missing joint at the end of a chain, 0.59 with one inside it. ``iteration="paper"`` keeps δ
  at 1.9 / λ or below; ``"accelerated"`` is the splitting of ``svt`` with the bones as bounds.
- The printed end does not look at the bones. ``"accelerated"`` goes on until none is too long by more than
  ``bone_tolerance``; ``"paper"`` ends as printed. It tests Z before there is one; the test belongs after the update.
- Without a skeleton the bones are pairs of markers that the trusted samples show to be rigid.
- Kick-start and ``origin`` are those of ``svt``. The limit of iterations is not printed.

The constraint has one side: bones may still come out too short.

Cost per iteration: that of ``svt`` and two sparse products over the constraints.
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import SolverError
from mocapclean.geometry.skeleton import Bone
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import Iterate
from mocapclean.parameters import STRICT
from mocapclean.solvers import svt
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take
from mocapclean.take.bones import bones_of

REFERENCE = (
    "C.-H. Tan, J. Hou, L.-P. Chau, 2015, Motion capture data recovery using skeleton constrained singular value "
    "thresholding, doi:10.1007/s00371-014-1031-5"
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(svt.Params):
    """Those of ``svt``, and how well the bones must hold."""

    bone_tolerance: Annotated[
        float, Field(ge=0, description="ε, mm, accelerated: how much too long the worst bone may be at the end")
    ] = 2.82222
    step: Annotated[float, Field(gt=0, lt=2, description="δ, 1, step of the plain ascent, at most 1.9 / λ")] = 0.75
    max_iterations: Annotated[int, Field(ge=1, description="k_max, 1, most iterations after the kick-start")] = 10000


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence; the trace is the residual of the trusted entries in mm.

    Raises SolverError for a take without bones.
    """
    wanted = fillable(take.trusted)
    data = centred_matrix(take.positions, take.trusted, about_mean=params.origin == "mean")
    if not wanted.any():
        return Solution(positions=data.positions(data.values), filled=wanted, reason="nothing to fill")
    source, bones = bones_of(take)
    if not bones and data.values.any():
        raise SolverError(
            "scsvt must have bones: a skeleton that names the markers, or markers that keep their distance. "
            f"Got none among {len(take.markers)} markers; give a skeleton or use svt."
        )
    edges = loose_edges(bones, take.markers, take.trusted)
    plain = params.iteration == "paper"
    found = svt.minimise(
        data,
        edges,
        params,
        step=min(params.step, 1.9 / edges.curvature(data.known)) if plain else 0.0,
        excess_tolerance=np.inf if plain else params.bone_tolerance,
    )
    return Solution(
        positions=data.positions(found.matrix),
        filled=wanted,
        converged=found.converged,
        iterations=len(found.trace),
        reason=_reason(found, params),
        trace=tuple(found.trace),
        facts={"bones": len(bones), "bones_from": source, "excess_mm": found.excess},
    )


def loose_edges(bones: tuple[Bone, ...], markers: tuple[str, ...], trusted: Bools) -> DistanceBounds:
    """The bones, frame by frame, that have an untrusted end and both ends among the markers trusted somewhere."""
    used = np.flatnonzero(trusted.any(axis=0))
    column = {markers[marker]: k for k, marker in enumerate(used)}
    kept = [bone for bone in bones if bone.start in column and bone.end in column]
    start = np.array([column[bone.start] for bone in kept], dtype=np.intp)
    end = np.array([column[bone.end] for bone in kept], dtype=np.intp)
    known = trusted[:, used]
    frames, loose = np.nonzero(~(known[:, start] & known[:, end]))
    samples = frames * known.shape[1]
    lengths = np.array([bone.length for bone in kept])
    return DistanceBounds(samples + start[loose], samples + end[loose], lengths[loose], known.size)


def _reason(found: Iterate, params: Params) -> str:
    state = f"residual {found.residual:.2g} mm, longest bone excess {found.excess:.2g} mm"
    return state if found.converged else f"max_iterations {params.max_iterations} reached; {state}"
