"""What the shell is offered for a value: methods, keys of the configuration, and names that stand in the given take.

The shell asks at every press of the tab key. So nothing is imported before that, and faults offer nothing.
"""

from collections.abc import Iterable, Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import click


def methods(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Return the methods that begin like this, and auto where one method is chosen."""
    from mocapclean.solvers import SOLVERS

    return _beginning(incomplete, [*SOLVERS, *SOLVERS.installed(), *(["auto"] if param.name == "method" else [])])


def keys(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Return the keys for ``--set`` that begin like this; one that ends in a dot is a section."""
    from mocapclean.config.settings import DEFAULT_METHOD, Settings

    *sections, _ = incomplete.split(".")
    if sections:
        return _beginning(incomplete, _below(Settings, sections))
    method = ctx.params.get("method") or DEFAULT_METHOD
    own = [] if method == "auto" else _below(Settings, ["methods", method])
    named = [key for key in _below(Settings, []) if key.endswith(".")]
    return _beginning(incomplete, [*(key.rpartition(".")[2] for key in own), *named])


def markers(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Return the markers or joints of the takes before the cursor that begin like this, without their subjects.

    Names with their subjects are returned where a colon is typed.
    """
    from mocapclean.take.names import bare_name

    names = _of_takes(ctx, _columns)
    return _beginning(incomplete, names if ":" in incomplete else map(bare_name, names))


def events(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Return the names of the events of the takes before the cursor, as the start or as the end of a range."""
    start, colon, _ = incomplete.rpartition(":")
    return _beginning(incomplete, [f"{start}{colon}{name}{'' if colon else ':'}" for name in _of_takes(ctx, _events)])


def _beginning(incomplete: str, words: Iterable[str]) -> list[str]:
    """Return the distinct words that begin like this."""
    return [word for word in dict.fromkeys(words) if word.startswith(incomplete)]


def _below(section: Any, path: list[str]) -> list[str]:
    """Return the keys under a path of sections, with the path: "trust.drift.least=", or "trust.drift." for a section.

    Only the module of a method or rule on the path is imported.
    """
    from mocapclean.config.loading import names_of, section_of

    for name in path:
        if name not in (names_of(section) or ()):
            return []
        section = section_of(section, name)
    before = "".join(f"{name}." for name in path)
    return [f"{before}{name}{'.' if _is_section(section, name) else '='}" for name in names_of(section) or ()]


def _is_section(section: Any, name: str) -> bool:
    """Whether a key of a section has keys of its own."""
    from mocapclean.config.loading import section_of
    from mocapclean.config.sections import Sections

    if issubclass(section, Sections):
        return True
    kind = section_of(section, name)
    return isinstance(kind, type) and (issubclass(kind, Sections) or is_dataclass(kind))


def _of_takes(ctx: click.Context, names: Any) -> list[str]:
    """Return what a function gives for each take on the command line that can be read."""
    from mocapclean.errors import MocapcleanError

    found: list[str] = []
    # An option without its value ends click's parser, which then leaves the files among the other words.
    for path in (*(ctx.params.get("files") or ()), *ctx.args):
        try:
            if Path(path).is_file():
                found += names(Path(path))
        except MocapcleanError:
            continue
    return list(dict.fromkeys(found))


def _columns(path: Path) -> Iterator[str]:
    """Yield the names of the markers or joints of a take; of a skeleton only its header is read."""
    from mocapclean import formats

    if formats.declaration(path).stores == "poses":
        yield from formats.read_skeleton(formats.companion(path) or path).names
    else:
        yield from formats.read(path).markers


def _events(path: Path) -> Iterator[str]:
    """Yield the names of the events that a take's file states."""
    from mocapclean import formats
    from mocapclean.pipeline.frame_range import event_name

    yield from map(event_name, formats.events(formats.read(path)))
