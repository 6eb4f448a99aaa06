"""Fill the untrusted samples of a take in memory; trusted ones change only where the method is asked to denoise."""

from dataclasses import replace
from typing import Any

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import UsageError
from mocapclean.parameters import faults
from mocapclean.pipeline.joints import fill_poses, merge_poses
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take


def fill(take: Take, method: str = DEFAULT_METHOD, *, library: Dictionary | None = None, **parameters: Any) -> Take:
    """Return the take with its untrusted samples filled by one method; trusted ones stay unless the method denoises.

    parameters: the method's own (``mocapclean methods`` lists them). library: the trained Dictionary, for methods that
    need one. Raises UsageError for an unknown method or parameter, SolverError when the method has no
    answer.
    """
    if method not in SOLVERS:
        raise UsageError(f"a method must be one of {', '.join(SOLVERS)}. Got {method!r}.")
    if refused := faults(SOLVERS[method].Params, parameters):
        text = "; ".join(f"{name}: {fault}, got {value!r}" for name, fault, value in refused)
        raise UsageError(f"the parameters of {method} must be valid. {text}.")
    params = SOLVERS[method].Params(**parameters)
    everything = np.ones_like(take.trusted)
    return merge(take, answer(method, take, params, everything, library), everything)


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
