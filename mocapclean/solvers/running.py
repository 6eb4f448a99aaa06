"""Run a method on a take: the one place that calls the ``solve`` of a method's module."""

from dataclasses import replace
from typing import Any

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.dictionaries.dictionary import Dictionary, require_dictionary
from mocapclean.errors import SolverError
from mocapclean.numerics.robust import nan_median
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
    begun: Solution | None = None,
) -> Solution:
    """Return the answer of a registered method for a take.

    A method that uses other markers is run on the columns that are not detached. What it cannot fill is bridged over
    time: short dropouts, in which nothing is seen, before it, and the gaps of detached columns, which it does not see.

    params: the method's ``Params``. wanted: (F, M) samples whose gaps need an answer, None for all; most methods fill
    the others as well. dictionary: for the methods that need one. begun: the answer of the method for the take with
    more samples trusted, from which a method that goes gap by gap begins; the others begin anew. Raises UsageError
    where a dictionary is missing or does not fit the take. Raises SolverError where the method has no answer, such as
    without the bones that it needs.
    """
    traits = SOLVERS[name].TRAITS
    if not traits.learns_from_session:
        take = replace(take, session=None)
    if not traits.extrapolates or not (take.detached.any() or _has_dropouts(take)):
        # Each column by itself, or nothing that the method cannot fill.
        return _solve(name, take, params, wanted, dictionary, begun)
    # Few takes have these, and the default method is loaded for them.
    from mocapclean.solvers.over_time import bridge_all, bridge_dropouts

    attached = np.flatnonzero(~take.detached)
    part = take.select(attached)
    # The method takes the samples that are bridged over time as known.
    positions, sd = bridge_dropouts(part)
    bridged = np.isfinite(sd)
    known = replace(part, positions=positions, trusted=part.trusted | bridged)
    part_wanted = wanted if wanted is None else wanted[:, attached]
    part_begun = begun and replace(
        begun, positions=begun.positions[:, attached], filled=begun.filled[:, attached], sd=_columns(begun.sd, attached)
    )
    answer = _solve(name, known, params, part_wanted, dictionary, part_begun)
    solution = _with_bridged(answer, bridged, positions, sd)
    if not take.detached.any():
        return solution
    return _with_detached(take, attached, solution, *bridge_all(take.select(np.flatnonzero(take.detached))))


def _columns(values: Floats | None, columns: Ints) -> Floats | None:
    """Return some columns of an array (F, M), if there is one."""
    return None if values is None else values[:, columns]


def _has_dropouts(take: Take) -> bool:
    """Whether there are frames in which nothing is seen, of a take in which something is."""
    return bool(take.trusted.any() and not take.trusted.any(axis=1).all())


def _with_bridged(solution: Solution, bridged: Bools, positions: Floats, bridged_sd: Floats) -> Solution:
    """Return a solution with the samples (F, M) that were bridged before it, and that it took as known.

    Where the method predicts from bridged samples, its variance grows by their median variance in the frame.
    """
    if not bridged.any():
        return solution
    sd, moved = solution.sd, solution.moved
    if sd is not None:
        variances = np.where(bridged.any(axis=1), nan_median(np.square(bridged_sd).T), 0.0)
        sd = np.where(bridged, bridged_sd, np.sqrt(np.square(sd) + solution.filled * variances[:, None]))
    return replace(
        solution,
        positions=np.where(bridged[..., None], positions, solution.positions),
        filled=solution.filled | bridged,
        sd=sd,
        reason=solution.reason if solution.filled.any() else "bridged over time",
        moved=None if moved is None else moved & ~bridged,
    )


def _with_detached(take: Take, attached: Ints, solution: Solution, positions: Floats, sd: Floats) -> Solution:
    """Return the solution of the attached columns, with the detached columns bridged over time, in the take's order."""
    detached = np.flatnonzero(take.detached)

    def joined(of_attached: Any, of_detached: Any) -> Any:
        """Return arrays of both kinds of columns as one (F, M, ...)."""
        columns = np.zeros((*take.trusted.shape, *of_attached.shape[2:]), dtype=of_attached.dtype)
        columns[:, attached], columns[:, detached] = of_attached, of_detached
        return columns

    bridged = np.isfinite(sd)
    known = bridged | take.trusted[:, detached]
    return replace(
        solution,
        positions=joined(solution.positions, np.where(known[..., None], positions, 0.0)),
        filled=joined(solution.filled, bridged),
        sd=None if solution.sd is None else joined(solution.sd, np.where(bridged, sd, 0.0)),
        outliers=None if solution.outliers is None else joined(solution.outliers, 0.0),
        moved=None if solution.moved is None else joined(solution.moved, False),
        reason=solution.reason if solution.filled.any() else "bridged over time",
    )


def _solve(
    name: str,
    take: Take,
    params: Any,
    wanted: Bools | None,
    dictionary: Dictionary | None,
    begun: Solution | None,
) -> Solution:
    """Return the answer of a method for a take whose columns it all may use."""
    module = SOLVERS[name]
    traits = module.TRAITS
    # Nothing to fill, and nothing to correct: an answer without a call
    gaps = fillable(take.trusted) if traits.extrapolates else enclosed(take.trusted)
    corrects = traits.cleans_complete_takes and params.denoise and take.trusted.any()
    if not (gaps.any() or corrects):
        return _nothing_to_fill(take, gaps, traits)
    # The further arguments of ``solve``, as the traits declare them
    inputs: list[Any] = []
    if traits.gap_by_gap:
        inputs += [wanted if wanted is not None else np.ones_like(gaps), begun]
    if traits.needs_dictionary:
        inputs.append(require_dictionary(dictionary))
    if traits.needs_bones:
        inputs.append(_bones(take, traits))
    with SOLVERS.blamed(name):
        return _sound(module.solve(take, params, gaps, *inputs), take, params)


def _sound(solution: Solution, take: Take, params: Any) -> Solution:
    """Return a solution; raise ValueError unless it fits the take and no trusted sample is moved.

    Its arrays have the shapes of the take and the types of a Solution, and are finite where it is filled. Only with its
    parameter ``denoise`` may a method move trusted samples, because the user asks for it then.
    """
    if not isinstance(solution, Solution):
        raise ValueError(f"solve must return a Solution, got {type(solution).__name__}")
    if solution.moved is not None and not getattr(params, "denoise", False):
        raise ValueError("moved must be None unless the parameter denoise asks for it")
    shape = take.trusted.shape
    for name, expected in (("positions", (*shape, 3)), ("filled", shape), ("sd", shape), ("moved", shape)):
        values = getattr(solution, name)
        if values is None:
            continue
        if np.shape(values) != expected:
            raise ValueError(f"{name} must have the shape {expected}, got {np.shape(values)}")
        kind = "float" if name in ("positions", "sd") else "bool"
        if getattr(values, "dtype", np.dtype(object)).kind != kind[0]:
            raise ValueError(f"{name} must be an array of {kind}")
    if not np.isfinite(solution.positions[solution.filled]).all():
        raise ValueError("positions must be finite where filled")
    if solution.sd is not None and not (solution.sd[solution.filled] >= 0).all():
        raise ValueError("sd must not be negative where filled")
    return solution


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
