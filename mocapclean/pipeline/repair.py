"""Repair one take: prepare, fill, write, verify, and record what happened."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from mocapclean import formats, progress
from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.config.settings import Settings
from mocapclean.dictionaries.dictionary import load
from mocapclean.errors import MocapcleanError, UsageError
from mocapclean.evaluation import metrics, self_check
from mocapclean.files import check_output
from mocapclean.pipeline import sidecar
from mocapclean.pipeline.bending import bending
from mocapclean.pipeline.choose import check_filled, settle_method, solver
from mocapclean.pipeline.contacts import Contact, broken, contacts, kept
from mocapclean.pipeline.filling import merge
from mocapclean.pipeline.inspection import digest
from mocapclean.pipeline.outcome import Outcome
from mocapclean.pipeline.prepare import Prepared, matching, prepare, read_reference
from mocapclean.pipeline.session import SessionTake, with_session
from mocapclean.pipeline.summary import Turns, summarise, with_accuracy
from mocapclean.pipeline.view import Keep, view
from mocapclean.solvers import SOLVERS
from mocapclean.take import Solution, Take
from mocapclean.take.status import Codes, Status, counted, decide, supplied, supply, undecided, withdraw

_WRITER_REASONS = {"fit": Status.NO_POSE, "write": Status.STORED_AS_MISSING}
"""What the finding of a writer, by its rule, means for samples that it could not write."""


def repair(
    source: Path,
    output: Path,
    settings: Settings,
    arrays: Path | None = None,
    keep: Keep | None = None,
    session: Sequence[SessionTake] = (),
) -> Outcome:
    """Repair one file into another. Whatever goes wrong with this take is an Outcome, not an exception.

    arrays: where the sidecar goes, or None for no sidecar. keep: called with the view of the repaired take.
    session: takes that it is learnt from as well.
    """
    started = perf_counter()
    try:
        outcome = _repair(source, output, settings, arrays, keep, session)
    except MocapcleanError as error:
        outcome = Outcome(source=source, status="failed", error=str(error), exit_code=error.exit_code)
    except MemoryError:
        message = f"{source}: there is not enough memory for this take."
        outcome = Outcome(source=source, status="failed", error=message, exit_code=1)
    return replace(outcome, seconds=perf_counter() - started)


def _repair(
    source: Path,
    output: Path,
    settings: Settings,
    arrays: Path | None,
    keep: Keep | None,
    session: Sequence[SessionTake],
) -> Outcome:
    check_output(output, source, settings.overwrite)
    prepared = prepare(source, settings)
    source_sha256 = digest(source)
    selected, learnt_from = with_session(prepared.selected, source, source_sha256, session)
    truth = read_reference(selected, settings)
    library = load(settings.dictionary) if settings.dictionary else None
    codes = prepared.codes
    wanted = _request(prepared, codes, settings)
    checks_itself = settings.checks_itself
    settings, choice, checked = settle_method(selected, wanted, settings, library)
    if not prepared.touched.any():
        nothing = np.zeros_like(selected.trusted)
        solution = Solution(positions=selected.positions, filled=nothing, reason="nothing to fill")
    else:
        progress.stage("filling")
        solution = solver(settings.method, settings, library)(selected, wanted)
    # Candidates of auto were compared on all their answers. Where uncertain ones are left, the chosen is checked again.
    leaves_some = settings.largest_error is not None and SOLVERS[settings.method].TRAITS.error_bars
    if checks_itself and (checked is None or leaves_some):
        checked = check_filled(selected, wanted, solution, settings, library)
    sd = _error_bars(selected, solution, wanted, settings)
    if sd is not None and checked is not None:
        sd = self_check.widened(sd, selected.trusted, checked)
    _set_final_status(prepared, codes, solution, sd, settings)
    merged = merge(selected, solution, supplied(codes))
    around = contacts(selected, merged.filled) if selected.poses is not None else ()
    if settings.keep_contacts:
        merged = kept(selected, merged, around)
    progress.stage("writing")
    written = formats.write(
        prepared.with_selected(merged), output, invalidate=settings.invalidate, overwrite=settings.overwrite
    )
    with _removed_on_failure(output):
        after = written.select(prepared.columns)
        _record_written(codes, after, _writer_reason(written))
        if arrays:
            sidecar.save(arrays, selected, after, codes, sd, settings.method)
        outcome = summarise(selected, after, codes, settings, sd, _turns(selected, solution, sd))
        outcome = replace(outcome, contacts_broken=_contacts_broken(after, around))
        if truth is not None:
            outcome = with_accuracy(outcome, after, truth)
        if keep is not None:
            keep(view(prepared.whole, selected, written, after, codes, sd, invalidated=settings.invalidate))
        return replace(
            outcome,
            source=source,
            output=output,
            sidecar=arrays,
            format=prepared.format,
            source_sha256=source_sha256,
            output_sha256=digest(output),
            method=settings.method,
            choice=choice,
            parameters=asdict(settings.params),
            outdated=formats.outdated(written),
            solution=_facts(solution),
            self_check=checked,
            reference=settings.reference,
            learnt_from=learnt_from,
        )


@contextmanager
def _removed_on_failure(output: Path) -> Iterator[None]:
    """Remove a written output again when a later step fails, because then its take has failed."""
    try:
        yield
    except BaseException:
        output.unlink(missing_ok=True)
        raise


def _request(prepared: Prepared, codes: Codes, settings: Settings) -> Bools:
    """Return the samples (F, M) of gaps that the options allow to be filled, and set the status of untrusted ones that
    stay unfilled. A gap that is partly outside of the frames to repair counts as a whole.
    """
    selected = prepared.selected
    asked_for = np.full(selected.trusted.shape, not settings.markers)
    for pattern in settings.markers:
        asked_for[:, matching(pattern, selected, "--markers")] = True
    asked_for &= ~prepared.excluded
    decide(codes, ~asked_for, Status.NOT_ASKED_FOR)
    never_seen = np.broadcast_to(~selected.trusted.any(axis=0), asked_for.shape)
    decide(codes, never_seen, Status.NEVER_SEEN)
    too_long = np.zeros_like(asked_for)
    if settings.max_gap is not None:
        for marker, start, stop in column_runs(~selected.trusted):
            too_long[start:stop, marker] = stop - start > settings.max_gap
    decide(codes, too_long, Status.TOO_LONG)
    return np.asarray(asked_for & prepared.touched & ~too_long)


def _error_bars(selected: Take, solution: Solution, wanted: Bools, settings: Settings) -> Floats | None:
    """Return the sd (F, M) of the wanted samples that the method answered, NaN elsewhere; None if it gives none."""
    if solution.sd is None and settings.max_error is not None and not selected.trusted.all():
        raise UsageError(
            f"max_error must go with a method that gives error bars. {settings.method} gives none as it is set."
        )
    if solution.sd is None:
        return None
    return np.where(wanted & solution.filled & ~selected.trusted, solution.sd, np.nan)


def _contacts_broken(after: Take, around: Sequence[Contact]) -> tuple[tuple[str, int, int], ...] | None:
    """Return joint, first and last frame number of each contact that the repair breaks; None for markers."""
    if after.poses is None:
        return None
    return tuple((after.markers[c.joint], *after.numbers(c.start, c.stop)) for c in broken(after, around))


def _turns(selected: Take, solution: Solution, sd: Floats | None) -> Turns | None:
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


def _set_final_status(
    prepared: Prepared, codes: Codes, solution: Solution, sd: Floats | None, settings: Settings
) -> None:
    """Set the final status of every untrusted sample that has none yet: filled, or the reason why not."""
    selected = prepared.selected
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
    out_of_range: Bools = np.any(np.isfinite(size) & (size > prepared.largest), axis=2)
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


def _record_written(codes: Codes, after: Take, reason: Status) -> None:
    """Update the status of samples that the file writer changed or could not store."""
    withdraw(codes, ~after.filled, reason)
    codes[after.moved] = Status.MOVED


def _writer_reason(written: Take) -> Status:
    """Return why the writer left samples out that were to be written, from its own findings."""
    reasons = [_WRITER_REASONS[finding.rule] for finding in written.findings if finding.rule in _WRITER_REASONS]
    return reasons[0] if reasons else Status.NO_POSE


def _facts(solution: Solution) -> Mapping[str, Any]:
    """Return how the method ended and what it chose by itself, for the report."""
    return {
        "converged": solution.converged,
        "iterations": solution.iterations,
        "reason": solution.reason,
        "objective": solution.trace[-1] if solution.trace else None,
        **solution.facts,
    }
