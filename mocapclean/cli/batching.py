"""Options of commands that take many takes, and how these become inputs."""

import contextlib
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import click

from mocapclean.batch import inputs
from mocapclean.batch.inputs import Input
from mocapclean.batch.limits import Limits, processors
from mocapclean.batch.pool import Stop
from mocapclean.cli.options import FILE, Command
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError


class _Shard(click.ParamType[tuple[int, int]]):
    name = "i/n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Two whole numbers, 1 <= i <= n."""
        index, slash, count = str(value).partition("/")
        if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
            self.fail(f"a shard must be i/n with 1 <= i <= n, such as 3/20. Got {value!r}.", param, ctx)
        return int(index), int(count)


_SELECTING = (
    click.option(
        "--files-from", type=click.File("rb"), help="File with more inputs, one a line; - for standard input."
    ),
    click.option("-0", "--null", is_flag=True, help="In --files-from a NUL ends a name, as in 'find -print0'."),
    click.option("--include-files", multiple=True, metavar="GLOB", help="Only files that match; with a / by the path."),
    click.option("--exclude-files", multiple=True, metavar="GLOB", help="No files that match."),
    click.option("--relative-to", type=FILE, help="Mirror the tree below this folder (--files-from: the current one)."),
    click.option("--shard", type=_Shard(), help="Do part i of n only, for job arrays; the parts share no take."),
)
_WORKING = (
    click.option("--workers", metavar="N|auto", help="Takes at a time, each in a process (default: 1)."),
    click.option("--timeout", type=float, metavar="SECONDS", help="Give up a take that needs longer."),
    click.option("--memory", metavar="SIZE", help="Give up a take that needs more memory, such as 2GiB."),
)
_CLUSTER = click.option("--scheduler", metavar="ADDRESS", help="Let a Dask cluster do it, such as tcp://head:8786.")


def batching(command: Command) -> Command:
    """Add the options that decide which takes, and how many at a time."""
    for option in reversed((*_SELECTING, *_WORKING, _CLUSTER)):
        command = option(command)
    return command


def working(command: Command) -> Command:
    """Add the options that decide how many takes at a time, and what each may need."""
    for option in reversed(_WORKING):
        command = option(command)
    return command


def select(
    files: tuple[Path, ...], files_from: BinaryIO | None, null: bool, relative_to: Path | None, chosen: Settings
) -> list[Input]:
    """All inputs, in a fixed order; UsageError where there is none."""
    if not files and files_from is None:
        raise UsageError("Missing argument: name files or folders, or give --files-from.")
    if relative_to and not relative_to.is_dir():
        raise UsageError(f"--relative-to must be a folder. Got {relative_to}.")
    if chosen.out_dir is None and any(map(os.path.isdir, files)):
        raise UsageError(f"{next(filter(os.path.isdir, files))}: an input folder needs --out-dir.")
    found = [*inputs.named(files, relative_to, chosen.out_dir)]
    if files_from is not None:
        found += inputs.named(inputs.listed(files_from, null), relative_to or Path(), chosen.out_dir)
    if chosen.scheduler:
        found = [replace(each, path=Path(os.path.abspath(each.path))) for each in found]
    found = inputs.chosen(found, chosen.include_files, chosen.exclude_files)
    if not found:
        raise UsageError(f"there must be at least one take ({', '.join(inputs.SUFFIXES)}). Got none.")
    return found


def limits(chosen: Settings, *, alone: bool) -> Limits:
    """How many processes, and what each take may need; a take that is ``alone`` and has no limit needs no process."""
    workers = processors() if chosen.workers == "auto" else chosen.workers
    if alone and chosen.timeout is None and chosen.memory is None:
        workers = 0
    return Limits(workers=workers, timeout=chosen.timeout, memory=chosen.memory)


@contextlib.contextmanager
def stopping() -> Iterator[Stop]:
    """Let SIGINT and SIGTERM stop a run in two steps."""
    stop = Stop(lambda: os.write(2, b"mocapclean: begins nothing more; again to stop at once.\n"))
    previous = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
