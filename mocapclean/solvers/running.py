"""Run a method on a take: the one place that calls the ``solve`` of a method's module."""

from typing import Any

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.dictionaries.dictionary import Dictionary, require_dictionary
from mocapclean.errors import SolverError
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.fillable import enclosed, fillable
from mocapclean.solvers.method import KnownBones, Traits
from mocapclean.take import Solution, Take
from mocapclean.take.bones import bones_of


def run_method(
    name: str,
    take: Take,
    params: Any,
    *,
    wanted: Bools | None = None,
    dictionary: Dictionary | None = None,
) -> Solution:
    """Return the answer of a registered method for a take.

    params: the method's ``Params``. wanted: (F, M) samples whose gaps need an answer, None for all; most methods fill
    the others as well. dictionary: for the methods that need one. Raises UsageError where a dictionary is missing or
    does not fit the take, SolverError where the method has no answer, such as without the bones that it needs.
    """
    module = SOLVERS[name]
    traits = module.TRAITS
    # Nothing to fill, and nothing to correct: an answer without a call
    gaps = fillable(take.trusted)
    corrects = traits.cleans_complete_takes and params.denoise and take.trusted.any()
    if not (gaps.any() or corrects):
        return _nothing_to_fill(take, gaps, traits)
    if not traits.extrapolates:
        gaps = enclosed(take.trusted)
    # The further arguments of ``solve``, as the traits declare them
    inputs: list[Any] = []
    if traits.gap_by_gap:
        inputs.append(wanted if wanted is not None else np.ones_like(gaps))
    if traits.needs_dictionary:
        inputs.append(require_dictionary(dictionary))
    if traits.needs_bones:
        inputs.append(_bones(take, traits))
    return module.solve(take, params, gaps, *inputs)


def _nothing_to_fill(take: Take, gaps: Bools, traits: Traits) -> Solution:
    """Return the Solution without a filled sample, ``sd`` included where the method has error bars."""
    return Solution(
        positions=np.where(take.trusted[..., None], take.positions, 0.0),
        filled=gaps,
        sd=np.zeros(gaps.shape) if traits.error_bars else None,
        reason="nothing to fill",
        facts=traits.idle_facts,
    )


def _bones(take: Take, traits: Traits) -> KnownBones:
    """Return the bones of the take; SolverError: there is none."""
    known = KnownBones(*bones_of(take))
    if not known.bones:
        raise SolverError(traits.needs_bones.format(n_markers=len(take.markers)))
    return known
