"""Locality-constrained coding of partial-body windows over a trained dictionary.

    w = argmin ‖x − wᵀB‖² + λ ‖g ∘ w‖²  subject to  Σw = 1,    g_k = exp((‖x − B_k‖ − max_k ‖x − B_k‖) / σ)     (5), (6)

x are the observed entries of one window of L frames of one part of the body (TO, LA, RA, LL, RL), in the coordinates
that travel with the body and in units of the part's mean size; B the same entries of the atoms D. The window is rebuilt
as wᵀD; a missing sample is the mean over the windows that hold it.

Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016; the dictionary comes from ``mocapclean train``.

Where this departs from the print, and why:

- The printed (7), w ∝ (C + λ diag(g))⁻¹ 1 with C = (B − x)(B − x)ᵀ, is not the minimiser of (5), which has diag(g²):
  ``llc_exponent`` 2, or 1 as printed. (5) leaves out Σw = 1, which (7) keeps.
- Only the ``neighbours`` nearest atoms are weighed: the penalty keeps the far ones near 0, and their number makes the
  cost. 0 weighs all. ``form="nearest"`` is the fast version of J. Wang et al. (2010), without g.
- A lost root, hip or neck is first supplied from the shape of the torso and its observed markers; the paper assumes
  that none is lost.
- ``seams="blend"`` carries the residual of the windows on the trusted samples around a gap linearly into it, so that
  the motion has no jump where the gap begins and ends; "paper" leaves the jump.
- Where no window of a part holds a trusted sample, the marker is interpolated linearly in body coordinates.
- Windows start at every ``stride``-th frame; 1 is the paper's.

Cost per window: O(K L m) for the distances to K atoms of m markers, O(k² (k + L m)) for k neighbours. Not iterative.
"""

from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics import windows
from mocapclean.numerics.coding.locality import reconstruct
from mocapclean.parameters import About, Field, parameters
from mocapclean.solvers.dictionary_fill import BodyTake, solution_of
from mocapclean.solvers.method import Traits
from mocapclean.take import Solution, Take

T = TypeVar("T", bound=np.generic)

REFERENCE = "Z. Wang et al., 2016, human motion capture data recovery with partial-body dictionaries"

TRAITS = Traits(needs_dictionary=True)


@parameters
class Params:
    """The coding of a window, and the step from windows to a motion."""

    neighbours: Annotated[int, Field(ge=0), About(symbol="k", text="nearest atoms that are weighed; 0: all")] = 100
    weight: Annotated[float, Field(ge=0), About(symbol="λ", text="weight of locality")] = 10.0
    bandwidth: Annotated[float, Field(gt=0), About(symbol="σ", text="decay of locality, in mean sizes of the part")] = (
        0.1
    )
    llc_exponent: Annotated[
        Literal[1, 2], About(symbol="e", text="power of g in the system: 2 minimises, 1 as printed")
    ] = 2
    form: Annotated[
        Literal["local", "nearest"], About(symbol="g", text="penalty by distance, or none among the neighbours")
    ] = "local"
    trace_weight: Annotated[
        float, Field(gt=0), About(symbol="β", text="regularisation of form nearest, in traces of C")
    ] = 1e-4
    stride: Annotated[int, Field(ge=1), About(symbol="s", unit="frames", text="from one window to the next")] = 3
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
    estimate, n_windows = body.interpolated(), 0
    for part, columns in body.parts():
        n_windows += _fill_part(estimate, body, part, columns, params)
    facts: dict[str, float | int | str] = {"windows": n_windows, "dictionary": body.dictionary.sha256}
    blend = params.seams == "blend"
    return solution_of(take, body, estimate, fillable, blend=blend, denoise=params.denoise, facts=facts)


def _fill_part(estimate: Floats, body: BodyTake, part: str, columns: Ints, params: Params) -> int:
    """Put the rebuilt windows of a part into estimate (F, M, 3), in place, and return their number."""
    # The windows with an observed and a missing entry; a take shorter than a window is padded with missing frames.
    length, n_frames = body.dictionary.window, len(estimate)
    n_padded = max(n_frames, length)
    local = _padded(body.local[:, columns], n_padded)
    observed = _padded(np.repeat(body.trusted[:, columns, None], 3, axis=2), n_padded)
    first = windows.starts(n_padded, length, params.stride)
    observed_windows = windows.cut(observed, first, length)
    first = first[observed_windows.any(axis=1) & ~observed_windows.all(axis=1)]
    if not first.size:
        return 0
    # (5), in units of the root mean square size of an atom; form nearest has no g and its own weight.
    atoms = body.dictionary.atoms[part]
    scale = float(np.sqrt(np.mean(np.sum(atoms**2, axis=1)))) or 1.0
    local_form = params.form == "local"
    rebuilt = reconstruct(
        atoms / scale,
        windows.cut(local, first, length) / scale,
        windows.cut(observed, first, length),
        neighbours=params.neighbours,
        weight=params.weight if local_form else params.trace_weight,
        bandwidth=params.bandwidth if local_form else 0.0,
        exponent=params.llc_exponent,
    )
    # The mean over the windows that hold a frame.
    mean, covered = windows.overlap_mean(scale * rebuilt, first, n_padded, length)
    rows = np.flatnonzero(covered[:n_frames])
    estimate[rows[:, None], columns] = mean[rows].reshape(len(rows), -1, 3)
    return len(first)


def _padded(frames: NDArray[T], n_frames: int) -> NDArray[T]:
    """Return the frames as rows, with rows of zeros up to ``n_frames``."""
    flat = np.zeros((n_frames, frames[0].size), dtype=frames.dtype)
    flat[: len(frames)] = frames.reshape(len(frames), -1)
    return flat
