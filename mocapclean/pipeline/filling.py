"""The answer of a method for a take, of markers or of joints, and the take with what is accepted of it."""

from dataclasses import replace
from typing import Any

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.pipeline.joints import fill_poses, merge_poses
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take


def answer(
    method: str,
    take: Take,
    params: Any,
    wanted: Bools,
    dictionary: Dictionary | None = None,
    begun: Solution | None = None,
) -> Solution:
    """Return the answer of a method with its ``Params`` for the wanted samples (F, M) of a take.

    begun: see ``run_method``; a take with poses is always filled anew.
    """
    if take.poses is not None:
        return fill_poses(method, take, params, wanted, dictionary)
    return run_method(method, take, params, wanted=wanted, dictionary=dictionary, begun=begun)


def merge(take: Take, solution: Solution, accepted: Bools) -> Take:
    """Return the take with a solution's samples where they are accepted (F, M), answered and untrusted.

    Trusted samples that the solver was asked to denoise (``moved``) are put in as well.
    """
    if solution.poses is not None:
        return merge_poses(take, solution, accepted)
    filled = accepted & solution.filled & ~take.trusted
    moved = take.trusted & solution.moved if solution.moved is not None else np.zeros_like(filled)
    positions = np.where((filled | moved)[..., None], solution.positions, take.positions)
    return replace(take, positions=positions, filled=take.filled | filled, moved=take.moved | moved)
