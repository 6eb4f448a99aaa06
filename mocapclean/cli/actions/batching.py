"""The inputs, limits and signal handling of commands for many takes."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

from mocapclean import logs, progress
from mocapclean.batch import inputs
from mocapclean.batch.inputs import Input
from mocapclean.batch.limits import WorkerLimits, memory_limiter, processors
from mocapclean.batch.pool import Stop
from mocapclean.cli.guard import complain
from mocapclean.cli.stages import drawn_bar
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError

_FEW_NAMES = 3  # most names of files in a remark
_FINISHING = b"mocapclean: Finishing running takes. Press Ctrl-C again to stop now.\n"
_DROPPING = b"mocapclean: Stopping. Running takes are dropped.\n"


def select_inputs(
    files: tuple[Path, ...], files_from: BinaryIO | None, null: bool, relative_to: Path | None, settings: Settings
) -> list[Input]:
    """Return all inputs of a command, in a fixed order; raise UsageError if there is none."""
    if not files and files_from is None:
        raise UsageError("Missing argument: name files or folders, or give --files-from.")
    if relative_to and not relative_to.is_dir():
        raise UsageError(f"--relative-to must be a folder. Got {relative_to}.")
    if settings.out_dir is None and any(map(os.path.isdir, files)):
        raise UsageError(f"{next(filter(os.path.isdir, files))}: an input folder needs --out-dir.")
    left_out: list[Path] = []
    takes = [*inputs.find(files, relative_to, settings.out_dir, left_out)]
    if files_from is not None:
        takes += inputs.find(inputs.read_list(files_from, null), relative_to or Path(), settings.out_dir, left_out)
    if left_out and not settings.quiet:
        names = ", ".join(path.name for path in left_out[:_FEW_NAMES])
        more = ", ..." if len(left_out) > _FEW_NAMES else ""
        complain(f"Files in folders that hold no take are left out: {len(left_out)} ({names}{more}).")
    if settings.scheduler:
        takes = [replace(each, path=Path(os.path.abspath(each.path))) for each in takes]
    takes = inputs.matching(takes, settings.include_files, settings.exclude_files)
    if not takes:
        raise UsageError(f"the inputs must hold at least one take ({', '.join(inputs.SUFFIXES)}). Got none.")
    return takes


def worker_limits(settings: Settings, *, alone: bool) -> WorkerLimits:
    """Return the limits of a run.

    alone: whether it has one take, which then uses all cores itself, in this process unless it has a limit.
    """
    if settings.memory is not None and not settings.scheduler:
        memory_limiter()
    cores = processors() if settings.workers == "auto" else settings.workers
    if alone and settings.timeout is None and settings.memory is None:
        return WorkerLimits(workers=0, cores=cores)
    return WorkerLimits(workers=1 if alone else cores, timeout=settings.timeout, memory=settings.memory)


@contextlib.contextmanager
def stopping(*, on_cluster: bool = False) -> Iterator[Stop]:
    """Handle SIGINT and SIGTERM inside the block: the first stops the run, the second ends it at once.

    on_cluster: SIGTERM lets running takes finish, as SIGINT does.
    """
    stop = Stop(lambda number: os.write(2, _FINISHING if on_cluster or number == signal.SIGINT else _DROPPING))
    previous = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


class TakeBar:
    """The bar over the takes of a run, on a terminal; a run of one take, a quiet one and one that logs have none."""

    def __init__(self, n_takes: int, *, quiet: bool) -> None:
        self._bar: Any = None
        if n_takes != 1 and not (quiet or logs.shown_level()) and sys.stderr.isatty():
            self._bar = drawn_bar(total=n_takes, unit="take")

    def __enter__(self) -> "TakeBar":
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    @contextlib.contextmanager
    def aside(self) -> Iterator[None]:
        """Take all bars off the terminal while the block prints."""
        progress.finish()
        if self._bar is None:
            yield
            return
        with self._bar.external_write_mode():
            yield

    def advance(self, note: str = "") -> None:
        """Count one more take as done, and show a note beside the number."""
        if self._bar is not None:
            self._bar.set_postfix_str(note, refresh=False)
            self._bar.update()


def one_take_alone(n_takes: int, limits: WorkerLimits, *, quiet: bool) -> None:
    """Show stages only for a run of one take; one in a worker process has a single stage."""
    if n_takes != 1 or quiet:
        progress.silence()
    elif limits.workers:
        progress.stage("in a process of its own")
