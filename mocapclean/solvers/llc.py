"""Locality-constrained coding of partial-body windows over a trained dictionary.

    w = argmin ‖x − wᵀB‖² + λ ‖g ∘ w‖²  subject to  Σw = 1,    g_k = exp((‖x − B_k‖ − max_k ‖x − B_k‖) / σ)     (5), (6)

x are the observed entries of one window of L frames of one part of the body (TO, LA, RA, LL, RL), in the frame that
travels with the body and in units of the part's mean size; B the same entries of the atoms D. The window is rebuilt as
wᵀD; a missing sample is the mean over the windows that hold it.

Z. Wang, Y. Feng, S. Liu, J. Xiao, X. Yang, J. J. Zhang, 2016; the dictionary comes from ``mocapclean train``.

Where this departs from the print, and why:

- The printed (7), w ∝ (C + λ diag(g))⁻¹ 1 with C = (B − x)(B − x)ᵀ, is not the minimiser of (5), which has diag(g²):
  ``llc_exponent`` 2, or 1 as printed. (5) leaves out Σw = 1, which (7) keeps.
- Only the ``neighbours`` nearest atoms are weighed: the penalty keeps the far ones near 0, and their number makes the
  cost. 0 weighs all. ``form="nearest"`` is the fast version of J. Wang et al. (2010), without g.
- A lost root, hip or neck is supplied before anything else from the shape of the torso and what is seen of it, instead
  of being assumed.
- ``seams="blend"`` carries what the windows miss on the trusted samples around a gap linearly into it, so that the
  motion has no jump where the gap begins and ends; "paper" leaves it.
- Where no window of a part holds a trusted sample, the marker goes straight in the frame of the body.
- Windows start at every ``stride``-th frame; 1 is the paper's.

Cost per window: O(K L m) for the distances to K atoms of m markers, O(k² (k + L m)) for k neighbours. Not iterative.
"""

from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Floats, Ints
from mocapclean.dictionaries.dictionary import Dictionary, require_dictionary
from mocapclean.numerics import windows
from mocapclean.numerics.coding.locality import reconstruct
from mocapclean.parameters import STRICT
from mocapclean.solvers.dictionary_fill import Body, finish
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take

T = TypeVar("T", bound=np.generic)

REFERENCE = "Z. Wang et al., 2016, human motion capture data recovery with partial-body dictionaries"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """How a window is coded, and how the windows become a motion."""

    neighbours: Annotated[int, Field(ge=0, description="k, 1, nearest atoms that are weighed; 0: all")] = 100
    weight: Annotated[float, Field(ge=0, description="λ, 1, weight of locality")] = 10.0
    bandwidth: Annotated[float, Field(gt=0, description="σ, 1, decay of locality, in mean sizes of the part")] = 0.1
    llc_exponent: Annotated[
        Literal[1, 2], Field(description="e, 1, power of g in the system: 2 minimises, 1 as printed")
    ] = 2
    form: Annotated[
        Literal["local", "nearest"], Field(description="g, 1, penalty by distance, or none among the neighbours")
    ] = "local"
    trace_weight: Annotated[float, Field(gt=0, description="β, 1, regularisation of form nearest, in traces of C")] = (
        1e-4
    )
    stride: Annotated[int, Field(ge=1, description="s, frames, from one window to the next")] = 3
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
    estimate, n_windows = body.interpolated(), 0
    for part, columns in body.parts():
        n_windows += _fill_part(estimate, body, part, columns, params)
    facts: dict[str, float | int | str] = {"windows": n_windows, "dictionary": body.dictionary.sha256}
    return finish(take, body, estimate, blend=params.seams == "blend", denoise=params.denoise, facts=facts)


def _fill_part(estimate: Floats, body: Body, part: str, columns: Ints, params: Params) -> int:
    """Put the part's windows into estimate (F, M, 3), where there are any; their number."""
    length, n_frames = body.dictionary.window, len(estimate)
    n_padded = max(n_frames, length)
    local = _padded(body.local[:, columns], n_padded)
    seen = _padded(np.repeat(body.trusted[:, columns, None], 3, axis=2), n_padded)
    first = windows.starts(n_padded, length, params.stride)
    observed = windows.cut(seen, first, length)
    first = first[observed.any(axis=1) & ~observed.all(axis=1)]
    if not first.size:
        return 0
    atoms = body.dictionary.atoms[part]
    scale = float(np.sqrt(np.mean(np.sum(atoms**2, axis=1)))) or 1.0
    rebuilt = reconstruct(
        atoms / scale,
        windows.cut(local, first, length) / scale,
        windows.cut(seen, first, length),
        neighbours=params.neighbours,
        weight=params.weight if params.form == "local" else params.trace_weight,
        bandwidth=params.bandwidth if params.form == "local" else 0.0,
        exponent=params.llc_exponent,
    )
    mean, covered = windows.overlap_mean(scale * rebuilt, first, n_padded, length)
    rows = np.flatnonzero(covered[:n_frames])
    estimate[rows[:, None], columns] = mean[rows].reshape(len(rows), -1, 3)
    return len(first)


def _padded(frames: NDArray[T], n_frames: int) -> NDArray[T]:
    flat = np.zeros((n_frames, frames[0].size), dtype=frames.dtype)
    flat[: len(frames)] = frames.reshape(len(frames), -1)
    return flat
