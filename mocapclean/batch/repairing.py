"""Repair as work of a batch: one job in, one row of the report out, and nothing left behind by a lost process."""

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
from mocapclean.batch.journal import Before
from mocapclean.config.settings import Settings
from mocapclean.errors import MocapcleanError
from mocapclean.files import check_output, discard_parts, new_file
from mocapclean.formats import companion
from mocapclean.pipeline.outcome import Outcome
from mocapclean.pipeline.repair import digest, repair
from mocapclean.report import record
from mocapclean.report.text import summary


@dataclass(frozen=True, kw_only=True)
class Job:
    """One take to repair.

    name: its own in the run and the journal. sidecar, report: where its arrays and its own report go, if anywhere.
    before: what earlier runs say of the output. inode: of the file that was at ``output`` when the run was planned, if
    any. again: whether another process may have done it, and been lost, since.
    """

    name: str
    source: Path
    output: Path
    sidecar: Path | None = None
    report: Path | None = None
    before: Before | None = None
    inode: int | None = None
    again: bool = False

    @property
    def targets(self) -> list[Path]:
        """All files that this job writes."""
        return [path for path in (self.output, self.sidecar, self.report) if path]


@dataclass(frozen=True, kw_only=True)
class Done:
    """A finished take: its row, or None when an earlier run's still stands; a key if all went well; its summary."""

    key: str = ""
    take: Mapping[str, Any] | None
    text: str = ""


@dataclass(frozen=True)
class Repair:
    """Repair takes with these settings."""

    settings: Settings

    def __call__(self, job: Job) -> Done:
        """Repair one take, unless its output is there and was made of the same input, settings and version."""
        source, key = self._key(job.source)
        own = _is_own(job)
        if own and job.before and key and key == job.before.key and _is_there(job):
            return Done(key=key, take=None)
        settings = self.settings
        for target in job.targets:
            check_output(target, None, settings.overwrite or own)
        if own:
            settings = settings.model_copy(update={"overwrite": True})
            _discard_parts(job)
        outcome = repair(job.source, job.output, settings, job.sidecar)
        if source and outcome.source_sha256 not in ("", source):
            job.output.unlink(missing_ok=True)
            outcome = failed(job, "the input changed while it was read. Try again.")
        report = job.report if outcome.status != "failed" else None
        if report:
            outcome = self._write_report(report, outcome)
        shown = report or (self.settings.report if isinstance(self.settings.report, Path) else None)
        return Done(
            key=key if outcome.status != "failed" else "",
            take=record.row(outcome),
            text=summary(outcome, verbose=self.settings.verbose, report=shown),
        )

    def undo(self, job: Job) -> None:
        """Remove half files, and a whole one whose process was lost before it could tell."""
        _discard_parts(job)
        if inode(job.output) not in (None, job.inode):
            with suppress(OSError):
                job.output.unlink()

    def _key(self, source: Path) -> tuple[str, str]:
        """The hash of an input, and of all that decides what is made of it; empty where a file cannot be read."""
        values: dict[str, Any] = {"version": __version__, **self.settings.identity}
        try:
            found = digest(source)
            beside = None if self.settings.skeleton else companion(source)
            files = {"input": source, "beside": beside, **dict(self.settings)}
            for name, path in files.items():
                if isinstance(path, Path) and (name in values or name in ("input", "beside")):
                    values[name] = found if path == source else _digest(path, path.stat().st_mtime_ns)
        except (OSError, MocapcleanError):
            return "", ""
        return found, sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()

    def _write_report(self, path: Path, outcome: Outcome) -> Outcome:
        try:
            with new_file(path) as part:
                record.write(part, [record.row(outcome)], self.settings.model_dump(mode="json"))
        except MocapcleanError as fault:
            return replace(outcome, error=str(fault), exit_code=fault.exit_code)
        return outcome


def _discard_parts(job: Job) -> None:
    for path in job.targets:
        discard_parts(path)


def _is_own(job: Job) -> bool:
    """Whether this or an earlier run says of the output that it is its own, and nobody has changed it since."""
    if job.again and inode(job.output) not in (None, job.inode):
        return True
    if job.before is None:
        return False
    return not (job.before.sha256 and job.output.exists()) or digest(job.output) == job.before.sha256


def _is_there(job: Job) -> bool:
    return all(path.exists() for path in job.targets)


def failed(job: Job, message: str) -> Outcome:
    """The outcome of a take that nothing was written for."""
    return Outcome(source=job.source, status="failed", error=f"{job.source}: {message}", exit_code=1)


def inode(path: Path) -> int | None:
    """What tells a file from one that has replaced it; None where there is none."""
    try:
        return os.stat(path).st_ino
    except OSError:
        return None


@lru_cache(maxsize=64)
def _digest(path: Path, changed: int) -> str:
    return digest(path)
