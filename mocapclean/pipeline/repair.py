"""Repair one take: prepare, fill, write, verify, and record what happened."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter

from mocapclean import formats, logs, progress
from mocapclean.config.settings import Settings
from mocapclean.dictionaries.dictionary import load
from mocapclean.errors import MocapcleanError
from mocapclean.files import check_output
from mocapclean.pipeline import sidecar
from mocapclean.pipeline.completion import complete, facts, requested, turns
from mocapclean.pipeline.contacts import Contact, broken
from mocapclean.pipeline.inspection import digest
from mocapclean.pipeline.outcome import Outcome
from mocapclean.pipeline.prepare import prepare, read_reference
from mocapclean.pipeline.session import SessionTake, with_session
from mocapclean.pipeline.summary import summarise, with_accuracy
from mocapclean.pipeline.view import Keep, view
from mocapclean.take import Take
from mocapclean.take.status import Codes, Status, withdraw

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
        with logs.about(source), logs.timed("repaired"):
            outcome = _repair(source, output, settings, arrays, keep, session)
    except MocapcleanError as error:
        outcome = Outcome(source=source, status="failed", error=str(error), exit_code=error.exit_code)
    except MemoryError:
        message = f"{source}: there is not enough memory for this take."
        outcome = Outcome(source=source, status="failed", error=message, exit_code=1)
    if outcome.status == "failed":
        logs.event("failed", take=source, error=outcome.error)
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
    wanted = requested(selected, codes, settings, excluded=prepared.excluded, touched=prepared.touched)
    done = complete(selected, codes, wanted, settings, library, prepared.largest)
    settings, sd = done.settings, done.sd
    progress.stage("writing")
    written = formats.write(
        prepared.with_selected(done.take), output, invalidate=settings.invalidate, overwrite=settings.overwrite
    )
    with _removed_on_failure(output):
        after = written.select(prepared.columns)
        _record_written(codes, after, _writer_reason(written))
        if arrays:
            sidecar.save(arrays, selected, after, codes, sd, settings.method)
        outcome = summarise(selected, after, codes, settings, sd, turns(selected, done.solution, sd))
        outcome = replace(outcome, contacts_broken=_contacts_broken(after, done.around))
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
            choice=done.choice,
            parameters=asdict(settings.params),
            outdated=formats.outdated(written),
            solution=facts(done.solution),
            self_check=done.checked,
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


def _contacts_broken(after: Take, around: Sequence[Contact]) -> tuple[tuple[str, int, int], ...] | None:
    """Return joint, first and last frame number of each contact that the repair breaks; None for markers."""
    if after.poses is None:
        return None
    return tuple((after.markers[c.joint], *after.numbers(c.start, c.stop)) for c in broken(after, around))


def _record_written(codes: Codes, after: Take, reason: Status) -> None:
    """Update the status of samples that the file writer changed or could not store."""
    withdraw(codes, ~after.filled, reason)
    codes[after.moved] = Status.MOVED


def _writer_reason(written: Take) -> Status:
    """Return why the writer left samples out that were to be written, from its own findings."""
    reasons = [_WRITER_REASONS[finding.rule] for finding in written.findings if finding.rule in _WRITER_REASONS]
    return reasons[0] if reasons else Status.NO_POSE
