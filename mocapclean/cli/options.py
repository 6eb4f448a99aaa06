"""Options that several commands share; declarations alone, which load nothing but click."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)

_READING = (
    click.option("--skeleton", type=FILE, help="Joints and bones: the .asf of an .amc; for C3D an .asf or .bvh."),
    click.option("--rate", type=float, help="Frames per second, for files without a rate (AMC: 120)."),
    click.option("--unit", help="Unit of length, in place of the file's own: mm, cm, m, in, ft, or mm per unit."),
    click.option("--gaps", type=FILE, help="CSV of spans to distrust: marker,first,last (the file's frame numbers)."),
    click.option("--markers", multiple=True, metavar="NAME", help="Repair only these markers; wildcards allowed."),
    click.option("--exclude", multiple=True, metavar="NAME", help="Ignore these markers; wildcards allowed."),
    click.option("--detect/--no-detect", default=None, help="Look for untrustworthy samples (default: yes)."),
    click.option("--config", type=FILE, help="YAML file with options of this command and parameters of methods."),
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="KEY=VALUE",
        help="Set a parameter of the method, or any key as a.b=value.",
    ),
)


def reading(command: Command) -> Command:
    """Add the options that decide what is read and which samples are trusted."""
    for option in reversed(_READING):
        command = option(command)
    return command


class _Shard(click.ParamType[tuple[int, int]]):
    """The type of ``--shard``: i/n with 1 <= i <= n."""

    name = "i/n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """Return (i, n)."""
        index, slash, count = str(value).partition("/")
        if not (slash and index.isdecimal() and count.isdecimal() and 1 <= int(index) <= int(count)):
            self.fail(f"a shard must be i/n with 1 <= i <= n, such as 3/20. Got {value!r}.", param, ctx)
        return int(index), int(count)


_SELECTING = (
    click.option("--files-from", type=click.File("rb"), help="List of more inputs, one per line; - for stdin."),
    click.option("-0", "--null", is_flag=True, help="Names in --files-from end with NUL, as from 'find -print0'."),
    click.option(
        "--include-files", multiple=True, metavar="GLOB", help="Only files of this name; with / of this path."
    ),
    click.option("--exclude-files", multiple=True, metavar="GLOB", help="No files of this name; with / of this path."),
    click.option("--relative-to", type=FILE, help="Mirror paths below this folder (--files-from: the current one)."),
    click.option("--shard", type=_Shard(), help="Do only part i of n, for job arrays; no two parts share a take."),
)
_WORKING = (
    click.option(
        "--workers",
        metavar="N|auto",
        help="Takes at the same time, or cores for a single take (default: auto, all cores).",
    ),
    click.option("--timeout", type=float, metavar="SECONDS", help="A take that needs longer fails."),
    click.option("--memory", metavar="SIZE", help="A take that needs more memory fails; such as 2GiB."),
)
_CLUSTER = click.option("--scheduler", metavar="ADDRESS", help="Run on a Dask cluster, such as tcp://head:8786.")


def batching(command: Command) -> Command:
    """Add the options that select takes and decide where and how many run at the same time."""
    for option in reversed((*_SELECTING, *_WORKING, _CLUSTER)):
        command = option(command)
    return command


def working(command: Command) -> Command:
    """Add the options that decide how many takes run at the same time, and what each may use."""
    for option in reversed(_WORKING):
        command = option(command)
    return command
