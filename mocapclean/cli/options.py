"""Options that several commands share, and their places in the help; declarations, which load nothing but click."""

from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click

from mocapclean.cli import completing

Decorated = TypeVar("Decorated", bound=Callable[..., Any])

FILE = click.Path(path_type=Path)
TAKES = "FILES_OR_FOLDERS..."
"""The metavar of the takes of every command."""

PURPOSES = {
    "Takes": (
        *("files-from", "null", "include-files", "exclude-files", "relative-to", "folder", "mask-from", "learn-from"),
        *("skeleton", "rate", "unit", "format", "reference"),
    ),
    "Samples": ("markers", "exclude", "frames", "most-frames", "events", "gaps", "detect", "replace", "only-missing"),
    "Output": (
        *("output", "out-dir", "overwrite", "report", "no-report", "html", "sidecar", "junit", "summary"),
        *("annotations", "plots", "json", "quiet", "verbose"),
    ),
    "Configuration": ("config", "set"),
    "Run": ("workers", "timeout", "memory", "scheduler", "shard", "resume", "seed", "help"),
}
"""The headings of the help below those of the command's own options, and the options under each."""


class Command(click.Command):
    """A command whose help lists its options by purpose, its own first."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one section for each purpose that has options."""
        for heading, params in self.by_purpose(ctx).items():
            records = [record for each in params if (record := each.get_help_record(ctx))]
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)

    def by_purpose(self, ctx: click.Context) -> dict[str, list[click.Parameter]]:
        """Return the options of the command under the heading of their purpose."""
        purpose_of = {name: heading for heading, names in PURPOSES.items() for name in names}
        found: dict[str, list[click.Parameter]] = {heading: [] for heading in ("Options", *PURPOSES)}
        for param in self.get_params(ctx):
            if isinstance(param, click.Option):
                name = max(param.opts, key=len).removeprefix("--")
                found[purpose_of.get(name, "Options")].append(param)
        return {heading: params for heading, params in found.items() if params}


def examples(*commands: str) -> str:
    """Return the end of a command's help: commands that a user can type, each on a line of its own."""
    return "\n".join(["Examples:", "", "\b", *(f"  {command}" for command in commands)])


def overwriting(default: bool | None = None) -> Callable[[Decorated], Decorated]:
    """Return the option ``--overwrite``; default: False for commands without a configuration, which may set it."""
    return click.option("--overwrite/--no-overwrite", default=default, help="Replace existing outputs.")


OUTPUT = "The file to write: "
"""How the help of ``--output`` begins in every command."""
OVERWRITE = overwriting()
AS_JSON = click.option(
    "--json",
    "as_json",
    is_flag=True,
    help="Print each take as one line of JSON, under takes as in a report, and nothing else.",
)
QUIET = click.option("-q", "--quiet/--no-quiet", default=None, help="Print only what fails.")
HTML = click.option("--html", type=FILE, help="Also write a page with pictures of all takes, for any browser.")
METHOD = click.option(
    "--method",
    shell_complete=completing.methods,
    help="How to fill: a name from 'mocapclean methods', or auto to choose for each take.",
)
DICTIONARY = click.option("--dictionary", type=FILE, help="The file that 'mocapclean train' wrote, for llc and srmmp.")
SKELETON = click.option(
    "--skeleton", type=FILE, help="Joints and bones: the .asf of .amc files; for C3D an .asf or .bvh."
)
RATE = click.option("--rate", type=float, help="Frames per second, for files without a rate (AMC: 120).")
UNIT = click.option("--unit", help="Unit of length, in place of the file's own: mm, cm, m, in, ft, or mm per unit.")
FORMAT = click.option("--format", metavar="NAME", help="Format of the takes, where name and content do not tell it.")
MARKERS = click.option(
    "--markers",
    multiple=True,
    metavar="NAME",
    shell_complete=completing.markers,
    help="Repair or convert only these markers; repeatable, or with commas; wildcards allowed.",
)
EXCLUDE = click.option(
    "--exclude",
    multiple=True,
    metavar="NAME",
    shell_complete=completing.markers,
    help="Ignore these markers; repeatable, or with commas; wildcards allowed.",
)


def seed(text: str = "files") -> Callable[[Decorated], Decorated]:
    """Return the option ``--seed`` of a command that writes such a thing."""
    return click.option(
        "--seed", type=click.IntRange(min=0), default=0, show_default=True, help=f"The same seed gives the same {text}."
    )


def verbose(prints: str = "") -> Callable[[Decorated], Decorated]:
    """Return a decorator that adds ``-v``, which logs to standard error: steps, or for ``-vv`` their details too.

    prints: what the command also prints then; it is given ``verbose``, True or None, where this is not empty.
    """

    def decorate(command: Decorated) -> Decorated:
        @wraps(command)
        def run(*arguments: Any, verbose: int, **options: Any) -> Any:
            if prints:
                options["verbose"] = True if verbose else None
            if not verbose:
                return command(*arguments, **options)
            from mocapclean import logs  # not needed without the option

            with logs.shown(logs.INFO if verbose == 1 else logs.DEBUG):
                return command(*arguments, **options)

        text = "Log each step to standard error; -vv: in detail." + (f" Also print {prints}." if prints else "")
        return click.option("-v", "--verbose", count=True, help=text)(cast(Decorated, run))

    return decorate


_READING = (
    *(SKELETON, RATE, UNIT, FORMAT),
    click.option("--gaps", type=FILE, help="CSV of spans to distrust: marker,first,last (the file's frame numbers)."),
    MARKERS,
    EXCLUDE,
    click.option(
        "--frames", metavar="FIRST:LAST", help="Judge and repair only these frames of the file; also 100: and :400."
    ),
    click.option(
        "--events",
        metavar="START:END",
        shell_complete=completing.events,
        help="Only the frames from the first event START to the next END, such as 'Left Foot Strike'.",
    ),
    click.option("--detect/--no-detect", default=None, help="Look for untrustworthy samples (default: yes)."),
    click.option("--config", type=FILE, help="YAML file with options of this command and parameters of methods."),
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="KEY=VALUE",
        shell_complete=completing.keys,
        help="Set any key of the configuration, as a.b=value; without a dot, a parameter of the method.",
    ),
)


def added(options: Sequence[Callable[[Any], Any]]) -> Callable[[Decorated], Decorated]:
    """Return a decorator that adds options to a command, in this order."""

    def add(command: Decorated) -> Decorated:
        for option in reversed(options):
            command = option(command)
        return command

    return add


reading = added(_READING)
"""Adds the options that decide what is read, judged and trusted."""


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

batching = added((*_SELECTING, *_WORKING, _CLUSTER))
"""Adds the options that select takes and decide where and how many run at the same time."""
working = added(_WORKING)
"""Adds the options that decide how many takes run at the same time, and what each may use."""
