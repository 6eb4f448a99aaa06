"""The sparsest mixture of training poses that agrees with the observed markers of a pose.

    w = argmin ½ ‖wᵀD_o − x_o‖² + λ ‖w‖₁,     x_m = wᵀD_m

x is one frame, in the coordinates that travel with the body; o are its observed and m its missing entries; the rows of
D are training poses of unit norm. J. Xiao, Y. Feng, W. Hu, 2011, as described by Z. Wang et al. (2016) and C.-H. Tan et
al. (2015); its own text was not at hand.

Where this departs from those descriptions, and why:

- λ is a share of the least λ for which w = 0, |D_o x_o|_∞, so that neither the unit of length nor the number of
  observed markers matters.
- A lost root, hip or neck is first supplied from the shape of the torso and its observed markers.
- ``seams="blend"`` carries the residual of the mixture on the trusted samples around a gap linearly into it; "paper"
  fills each frame independently, and the motion flickers.

Each frame is solved exactly, by feature-sign search from the codes of the frame before. Cost per frame: O(P M) for a
round over P poses, a few rounds of some ten small steps each.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics.coding.dictionary_learning import normalised
from mocapclean.numerics.coding.sparse_coding import lasso
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.dictionary_fill import BodyTake, solution_of
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

REFERENCE = (
    "J. Xiao, Y. Feng, W. Hu, 2011, predicting missing markers in human motion capture using l1-sparse representation"
)

TRAITS = Traits(needs_dictionary=True)


@parameters
class Params:
    """The sparsity of a mixture, and the step from frames to a motion."""

    sparsity_weight: Annotated[
        float,
        Field(gt=0, lt=1),
        About(symbol="λ", text="weight of the l1 norm, as a share of the least that gives no mixture"),
    ] = 1e-3
    seams: Annotated[
        Literal["blend", "paper"],
        About(symbol="r", text="carry the residual on the samples adjacent to a gap into it, or not"),
    ] = "blend"
    denoise: Annotated[
        float,
        Field(ge=0),
        About(symbol="μ", unit="frames^4", text="weight of squared second differences after filling; 0: none"),
    ] = 0.0


def solve(take: Take, params: Params, fillable: Bools, dictionary: Dictionary) -> Solution:
    """Return the take with all fillable samples (F, M) filled.

    Raises UsageError where the dictionary is of other markers or another rate.
    """
    body = BodyTake(take, dictionary)
    estimate = body.interpolated()
    poses = normalised(body.dictionary.poses.reshape(len(body.dictionary.poses), -1))
    codes, n_frames, n_failed, n_active = np.zeros(len(poses)), 0, 0, 0
    for frame in np.flatnonzero(body.trusted.any(axis=1) & ~body.trusted.all(axis=1)):
        observed = np.repeat(body.trusted[frame], 3)
        pose = body.local[frame].reshape(-1)
        # λ as a share of |D_o x_o|_∞; the missing entries of the pose are 0.
        penalty = params.sparsity_weight * float(np.abs(poses @ pose).max())
        # w by the lasso over the observed entries, then x_m = wᵀD_m.
        codes, optimal = lasso(poses, pose, observed, penalty, codes)
        estimate[frame] = (codes @ poses).reshape(-1, 3)
        n_frames, n_failed, n_active = n_frames + 1, n_failed + (not optimal), n_active + int(np.count_nonzero(codes))
    facts: dict[str, float | int | str] = {
        "frames": n_frames,
        "frames_not_optimal": n_failed,
        "mean_active_poses": n_active / max(n_frames, 1),
        "dictionary": body.dictionary.sha256,
    }
    blend = params.seams == "blend"
    return solution_of(take, body, estimate, fillable, blend=blend, denoise=params.denoise, facts=facts)
