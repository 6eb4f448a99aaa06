"""The sparsest mixture of training poses that agrees with what is seen of a pose.

    w = argmin ½ ‖wᵀD_o − x_o‖² + λ ‖w‖₁,     x_m = wᵀD_m

x is one frame, in the frame that travels with the body; o are its observed and m its missing entries; the rows of D are
training poses of unit norm. J. Xiao, Y. Feng, W. Hu, 2011, as described by Z. Wang et al. (2016)
and C.-H. Tan et al. (2015); its own text was not at hand.

Where this departs from what is told of it, and why:

- λ is a share of the least λ for which w = 0, |D_o x_o|_∞, so that neither the unit of length nor the number of markers
  seen matters.
- A lost root, hip or neck is supplied before anything else from the shape of the torso and what is seen of it.
- ``seams="blend"`` carries what the mixture misses on the trusted samples around a gap linearly into it; "paper" leaves
  the frames to themselves, which flicker.

Each frame is solved exactly, by feature-sign search from the codes of the frame before. Cost per frame: O(P M) for a
round over P poses, a few rounds of some ten small steps each.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.dictionaries.dictionary import Dictionary, require_dictionary
from mocapclean.numerics.coding.dictionary_learning import normalised
from mocapclean.numerics.coding.sparse_coding import lasso
from mocapclean.parameters import STRICT
from mocapclean.solvers.dictionary_fill import Body, finish
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

REFERENCE = (
    "J. Xiao, Y. Feng, W. Hu, 2011, predicting missing markers in human motion capture using l1-sparse representation"
)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """How sparse a mixture is, and how the frames become a motion."""

    sparsity_weight: Annotated[
        float,
        Field(gt=0, lt=1, description="λ, 1, weight of the l1 norm, as a share of the least that gives no mixture"),
    ] = 1e-3
    seams: Annotated[
        Literal["blend", "paper"], Field(description="r, 1, carry the misfit beside a gap into it, or not")
    ] = "blend"
    denoise: Annotated[
        float, Field(ge=0, description="μ, frames^4, weight of squared second differences after filling; 0: none")
    ] = 0.0


def solve(take: Take, params: Params, library: Dictionary | None = None) -> Solution:
    """Fill every marker and frame that has some evidence; ``library`` is the trained Dictionary.

    Raises UsageError without one, or when it is of other markers or another rate.
    """
    if not fillable(take.trusted).any():
        return Solution(positions=take.positions, filled=fillable(take.trusted), reason="nothing to fill")
    body = Body(take, require_dictionary(library))
    estimate = body.interpolated()
    poses = normalised(body.dictionary.poses.reshape(len(body.dictionary.poses), -1))
    codes, n_frames, n_failed, n_active = np.zeros(len(poses)), 0, 0, 0
    for frame in np.flatnonzero(body.trusted.any(axis=1) & ~body.trusted.all(axis=1)):
        seen = np.repeat(body.trusted[frame], 3)
        pose = body.local[frame].reshape(-1)
        penalty = params.sparsity_weight * float(np.abs(poses @ pose).max())
        codes, optimal = lasso(poses, pose, seen, penalty, codes)
        estimate[frame] = (codes @ poses).reshape(-1, 3)
        n_frames, n_failed, n_active = n_frames + 1, n_failed + (not optimal), n_active + int(np.count_nonzero(codes))
    facts: dict[str, float | int | str] = {
        "frames": n_frames,
        "frames_not_optimal": n_failed,
        "mean_active_poses": n_active / max(n_frames, 1),
        "dictionary": body.dictionary.sha256,
    }
    return finish(take, body, estimate, blend=params.seams == "blend", denoise=params.denoise, facts=facts)
