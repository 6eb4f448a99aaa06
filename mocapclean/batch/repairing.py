"""Repair takes as work of a pool: one job in, one row of the report out; a lost process leaves no files behind."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from mocapclean import __version__
from mocapclean.batch.journal import EarlierOutput
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError
from mocapclean.files import check_output, discard_parts, new_file
from mocapclean.formats import companion
from mocapclean.pipeline.inspection import digest
from mocapclean.pipeline.outcome import Outcome
from mocapclean.pipeline.repair import repair
from mocapclean.pipeline.session import load_session
from mocapclean.pipeline.view import View
from mocapclean.report import record
from mocapclean.report.text import summary

_CACHED_DIGESTS = 64
"""Files whose hashes are kept, such as one dictionary for all takes; chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class RepairJob:
    """One take to repair.

    name: of the output in the journal, unique in the run. sidecar, report, page: paths of the take's arrays, of its own
    report and of its data for the run's page, or None. earlier: the output's record in the journals of earlier runs.
    planned_inode: of the file that was at ``output`` when the run was planned, or None. may_rerun: a lost process may
    have run this job before.
    """

    name: str
    source: Path
    output: Path
    sidecar: Path | None = None
    report: Path | None = None
    page: Path | None = None
    earlier: EarlierOutput | None = None
    planned_inode: int | None = None
    may_rerun: bool = False

    @property
    def targets(self) -> list[Path]:
        """Return all files that this job writes."""
        return [path for path in (self.output, self.sidecar, self.report, self.page) if path]


@dataclass(frozen=True, kw_only=True)
class FinishedTake:
    """The result of a job.

    key: the hash of everything the output was made of; empty if the take failed. row: the take's row of the report;
    None if an earlier run's output was kept. summary: the text for the terminal.
    """

    key: str = ""
    row: Mapping[str, Any] | None
    summary: str = ""


@dataclass(frozen=True)
class Repair:
    """Work of a pool that repairs takes with these settings.

    session: the file of the takes to learn from, which each process reads once, or None. session_sha256: their hashes.
    """

    settings: Settings
    session: Path | None = None
    session_sha256: tuple[str, ...] = ()

    def __call__(self, job: RepairJob) -> FinishedTake:
        """Repair one take, unless its output exists and was made of the same input, settings and version."""
        source_sha256, key = self._hashes(job.source)
        may_replace = _may_replace(job)
        if may_replace and job.earlier and key and key == job.earlier.key and _all_exist(job):
            return FinishedTake(key=key, row=None)
        settings = self.settings
        for target in job.targets:
            check_output(target, None, settings.overwrite or may_replace)
        if may_replace:
            settings = settings.but(overwrite=True)
            _discard_parts(job)
        views: list[View] = []
        session = load_session(self.session) if self.session else ()
        keep = views.append if job.page else None
        outcome = repair(job.source, job.output, settings, job.sidecar, keep, session)
        if source_sha256 and outcome.source_sha256 not in ("", source_sha256):
            job.output.unlink(missing_ok=True)
            outcome = failed_outcome(job, "the input changed while it was read. Try again.")
        report = job.report if outcome.status != "failed" else None
        row = record.row(outcome)
        if report and (fault := self._write_report(report, row)):
            outcome = replace(outcome, error=str(fault), exit_code=fault.exit_code)
            row = record.row(outcome)
        if job.page and views and outcome.status != "failed":
            outcome, row = _write_page_data(job.page, outcome, row, views[0])
        shown_report = report or (self.settings.report if isinstance(self.settings.report, Path) else None)
        return FinishedTake(
            key=key if outcome.status != "failed" else "",
            row=row,
            summary=summary(outcome, verbose=self.settings.verbose, report=shown_report),
        )

    def undo(self, job: RepairJob) -> None:
        """Remove partial files, and the complete output of a process that was lost before its result arrived."""
        _discard_parts(job)
        if job.page:
            job.page.unlink(missing_ok=True)
        if inode(job.output) not in (None, job.planned_inode):
            with suppress(OSError):
                job.output.unlink()

    def _hashes(self, source: Path) -> tuple[str, str]:
        """Return the hash of an input, and of everything its output depends on; both empty if a file is unreadable."""
        values: dict[str, Any] = {"version": __version__, **self.settings.identity}
        try:
            source_sha256 = digest(source)
            values["learn_from"] = sorted({*self.session_sha256} - {source_sha256})
            beside = None if self.settings.skeleton else companion(source)
            files = {"input": source, "beside": beside, **dict(self.settings)}
            for name, path in files.items():
                if isinstance(path, Path) and (name in values or name in ("input", "beside")):
                    values[name] = source_sha256 if path == source else _digest(path, path.stat().st_mtime_ns)
        except (OSError, MocapcleanError):
            return "", ""
        return source_sha256, sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()

    def _write_report(self, path: Path, row: Mapping[str, Any]) -> MocapcleanError | None:
        """Write the take's own report; return the error if it cannot be written."""
        try:
            with new_file(path) as part:
                record.write(part, [row], self.settings.as_json())
        except MocapcleanError as error:
            return error
        return None


def _write_page_data(path: Path, outcome: Outcome, row: dict[str, Any], view: View) -> tuple[Outcome, dict[str, Any]]:
    """Write the data of a take for the page of its run; return outcome and row, with the error if it cannot be."""
    from mocapclean.report.page.data import write_take  # only runs with a page need it

    try:
        write_take(path, row, view)
    except MocapcleanError as error:
        outcome = replace(outcome, error=str(error), exit_code=error.exit_code)
        return outcome, record.row(outcome)
    return outcome, row


def _discard_parts(job: RepairJob) -> None:
    for path in job.targets:
        discard_parts(path)


def _may_replace(job: RepairJob) -> bool:
    """Whether the file at the output was written by this run or an earlier one and is unchanged since."""
    if job.may_rerun and inode(job.output) not in (None, job.planned_inode):
        return True
    if job.earlier is None:
        return False
    return not (job.earlier.sha256 and job.output.exists()) or digest(job.output) == job.earlier.sha256


def _all_exist(job: RepairJob) -> bool:
    return all(path.exists() for path in job.targets)


def failed_outcome(job: RepairJob, message: str) -> Outcome:
    """Return the outcome of a take without an output."""
    return Outcome(source=job.source, status="failed", error=f"{job.source}: {message}", exit_code=1)


def inode(path: Path) -> int | None:
    """Return the inode of a file, which changes when the file is replaced; None if there is no file."""
    try:
        return os.stat(path).st_ino
    except OSError:
        return None


@lru_cache(maxsize=_CACHED_DIGESTS)
def _digest(path: Path, modified: int) -> str:
    """Return the hash of a file. modified: its time of modification, ns, so that a changed file is read again."""
    return digest(path)
