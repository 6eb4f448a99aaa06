"""Fill a take in memory as the settings ask: choose the method, fill, check, widen error bars, and accept samples.

The command and the function ``mocapclean.fill`` both work through ``complete``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mocapclean import logs, progress
from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import Settings
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.errors import UsageError
from mocapclean.evaluation import metrics, self_check
from mocapclean.evaluation.self_check import SelfCheck
from mocapclean.pipeline.bending import bending
from mocapclean.pipeline.choose import check_filled, settle_method, solver
from mocapclean.pipeline.contacts import Contact, contacts, kept
from mocapclean.pipeline.filling import merge
from mocapclean.pipeline.outcome import MethodChoice
from mocapclean.pipeline.prepare import matching
from mocapclean.pipeline.summary import Turns
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution, Take
from mocapclean.take.status import Codes, Status, counted, decide, supplied, supply, undecided


@dataclass(frozen=True, kw_only=True)
class Completion:
    """A take whose accepted samples are filled, and what is known about them.

    take: the filled take. codes: (F, M) the status of every sample. sd: (F, M) mm, the error bars of what the method
    answered, NaN elsewhere; None without any. settings: with the method that was chosen. choice: how it was chosen, or
    None. checked: the self-check, or None. around: the contacts of joints beside the filled spans.
    """

    take: Take
    codes: Codes
    sd: Floats | None
    solution: Solution
    settings: Settings
    choice: MethodChoice | None
    checked: SelfCheck | None
    around: Sequence[Contact] = ()


def complete(
    selected: Take,
    codes: Codes,
    wanted: Bools,
    settings: Settings,
    dictionary: Dictionary | None = None,
    largest: float = np.inf,
) -> Completion:
    """Return a take with its wanted samples filled where the settings accept the answer.

    codes: (F, M) the status of every sample as ``requested`` leaves it; set in place. wanted: (F, M). largest: mm, the
    largest coordinate that is accepted. Raises SolverError where the method has no answer, UsageError where the
    settings do not go with it.
    """
    checks_itself = settings.checks_itself
    settings, choice, checked = settle_method(selected, wanted, settings, dictionary)
    logs.event("method", method=settings.method, because=choice and choice.because)
    logs.detail("parameters", **asdict(settings.params))
    if not (~selected.trusted & counted(codes)).any():
        nothing = np.zeros_like(selected.trusted)
        solution = Solution(positions=selected.positions, filled=nothing, reason="nothing to fill")
    else:
        progress.stage("filling")
        with logs.timed("filled", method=settings.method, wanted=int((wanted & ~selected.trusted).sum())) as values:
            solution = solver(settings.method, settings, dictionary)(selected, wanted)
            values |= {"filled": int(solution.filled.sum()), **facts(solution)}
    # Candidates of auto were compared on all their answers. Where uncertain ones are left, the chosen is checked again.
    leaves_some = settings.largest_error is not None and SOLVERS[settings.method].TRAITS.error_bars
    if checks_itself and (checked is None or leaves_some):
        with logs.timed("self-check") as values:
            checked = check_filled(selected, wanted, solution, settings, dictionary)
            values |= _measured(checked)
    sd = _error_bars(selected, solution, wanted, settings)
    if sd is not None and checked is not None:
        sd = self_check.widened(sd, selected.trusted, checked)
    _set_final_status(selected, codes, solution, sd, settings, largest)
    merged = merge(selected, solution, supplied(codes))
    left = ~selected.trusted & counted(codes) & ~supplied(codes)
    logs.event("accepted", filled=int(supplied(codes).sum()), left=int(left.sum()))
    around = contacts(selected, merged.filled) if selected.poses is not None else ()
    return Completion(
        take=kept(selected, merged, around) if settings.keep_contacts else merged,
        codes=codes,
        sd=sd,
        solution=solution,
        settings=settings,
        choice=choice,
        checked=checked,
        around=around,
    )


def _measured(checked: SelfCheck) -> dict[str, Any]:
    """Return what a self-check has measured, or why nothing, for the log."""
    total, error = checked.total, checked.total.error
    measured = {"gaps": total.gaps, "samples": total.samples, "because": checked.because or None}
    return measured | ({"rmse_3d": error.rmse_3d, "largest": error.largest} if error else {})


def requested(
    selected: Take, codes: Codes, settings: Settings, *, excluded: Bools | None = None, touched: Bools | None = None
) -> Bools:
    """Return the samples (F, M) that the settings allow to be filled, and set the status of untrusted others in place.

    codes: (F, M) the status after detection. excluded: (M,) the joints that take part without being filled, or None.
    touched: (F, M) the gaps that may be filled, None for all; one that is partly outside of the frames to repair counts
    as a whole.
    """
    asked_for = np.full(selected.trusted.shape, not settings.markers)
    for pattern in settings.markers:
        asked_for[:, matching(pattern, selected, "markers")] = True
    if excluded is not None:
        asked_for &= ~excluded
    decide(codes, ~asked_for, Status.NOT_ASKED_FOR)
    never_seen = np.broadcast_to(~selected.trusted.any(axis=0), asked_for.shape)
    decide(codes, never_seen, Status.NEVER_SEEN)
    too_long = np.zeros_like(asked_for)
    if settings.max_gap is not None:
        for marker, start, stop in column_runs(~selected.trusted):
            too_long[start:stop, marker] = stop - start > settings.max_gap
    decide(codes, too_long, Status.TOO_LONG)
    return np.asarray(asked_for & ~too_long & (True if touched is None else touched))


def turns(selected: Take, solution: Solution, sd: Floats | None) -> Turns | None:
    """Return what the answer for a take with poses is worth in degrees, and how well its poses were fitted.

    Bars in degrees are wider by as much as those in millimetres.
    """
    if selected.poses is None:
        return None
    degrees = None
    if solution.sd_degrees is not None and solution.sd is not None and sd is not None:
        wider = np.divide(sd, solution.sd, out=np.ones_like(sd), where=solution.sd > 0.0)
        degrees = np.where(np.isfinite(sd), solution.sd_degrees * wider, np.nan)
    return Turns(sd=degrees, misfit=solution.misfit)


def facts(solution: Solution) -> Mapping[str, Any]:
    """Return how the method ended and what it chose by itself, for the report."""
    return {
        "converged": solution.converged,
        "iterations": solution.iterations,
        "reason": solution.reason,
        "objective": solution.trace[-1] if solution.trace else None,
        **solution.facts,
    }


def _error_bars(selected: Take, solution: Solution, wanted: Bools, settings: Settings) -> Floats | None:
    """Return the sd (F, M) of the wanted samples that the method answered, NaN elsewhere; None if it gives none."""
    if solution.sd is None and settings.max_error is not None and not selected.trusted.all():
        raise UsageError(
            f"max_error must go with a method that gives error bars. {settings.method} gives none as it is set."
        )
    if solution.sd is None:
        return None
    return np.where(wanted & solution.filled & ~selected.trusted, solution.sd, np.nan)


def _set_final_status(
    selected: Take, codes: Codes, solution: Solution, sd: Floats | None, settings: Settings, largest: float
) -> None:
    """Set the final status of every untrusted sample that has none yet: filled, or the reason why not."""
    if solution.unreachable is not None:
        decide(codes, solution.unreachable, Status.NO_POSE)
    nothing_seen = np.broadcast_to(~selected.trusted.any(axis=1, keepdims=True), codes.shape)
    decide(codes, ~solution.filled & nothing_seen, Status.NOTHING_SEEN)
    decide(codes, ~solution.filled & _gaps_at_ends(selected), Status.AT_END)
    decide(codes, ~solution.filled, Status.NO_ANSWER)
    uncertain = Status.TOO_UNCERTAIN if settings.max_error is not None else Status.POOR
    decide(codes, _too_uncertain(selected, sd, counted(codes), settings), uncertain)
    # A coordinate that is not finite stays in, for the writer to refuse: it would be a fault of the method.
    size = np.abs(solution.positions)
    out_of_range: Bools = np.any(np.isfinite(size) & (size > largest), axis=2)
    decide(codes, out_of_range, Status.OUT_OF_RANGE)
    if sd is not None and not settings.fill_poor:
        decide(codes, _bending(selected, solution, codes), Status.BENDING)
    supply(codes, undecided(codes))


def _bending(selected: Take, solution: Solution, codes: Codes) -> Bools:
    """Return the samples (F, M) of gaps whose answers would make a rigid pair of markers worse.

    The joints of a skeleton have no such gaps, because its bones keep their lengths when it is written.
    """
    worse = np.zeros_like(selected.trusted)
    if selected.skeleton is None:
        bent = bending(selected, merge(selected, solution, undecided(codes)))
        for marker, start, stop in column_runs(~selected.trusted & counted(codes)):
            worse[start:stop, marker] = bent[start:stop, marker].any()
    return worse


def _gaps_at_ends(selected: Take) -> Bools:
    """Return the untrusted samples (F, M) of gaps that touch the first or last frame."""
    at_ends = np.zeros_like(selected.trusted)
    for marker, start, stop in column_runs(~selected.trusted):
        at_ends[start:stop, marker] = start == 0 or stop == len(at_ends)
    return at_ends


def _too_uncertain(selected: Take, sd: Floats | None, inside: Bools, settings: Settings) -> Bools:
    """Return the samples (F, M) of gaps inside the frames to repair whose expected 3D error is above the limit."""
    uncertain = np.zeros_like(selected.trusted)
    if sd is not None:
        for marker, start, stop in column_runs(~selected.trusted & inside):
            expected = metrics.expected_error(sd[start:stop, marker])
            uncertain[start:stop, marker] = settings.too_uncertain(expected)
    return uncertain
