"""The work of ``mocapclean methods``: every method, its parameters, defaults and reference."""

import inspect
from dataclasses import fields

import click

from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.errors import UsageError
from mocapclean.json_values import plain
from mocapclean.parameters import about
from mocapclean.report.text import table
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.method import Method


def work(names: tuple[str, ...]) -> int:
    """Print the methods, or some of them in full; return the exit code."""
    for name in names:
        if name not in SOLVERS:
            raise UsageError(f"a method must be one of {', '.join(SOLVERS)}. Got {name!r}.")
    blocks = [_block(name, SOLVERS[name], full=bool(names)) for name in names or SOLVERS]
    click.echo("\n\n".join(blocks))
    return 0


def _block(name: str, module: Method, *, full: bool) -> str:
    """Return the text on a method: its first line or all of it, its source, and its parameters."""
    text = inspect.cleandoc(module.__doc__ or "")
    default = " (default)" if name == DEFAULT_METHOD else ""
    lines = [
        f"{name}{default}",
        *(f"  {line}".rstrip() for line in (text if full else text.splitlines()[0]).splitlines()),
    ]
    turns = module.TRAITS.turns_joints
    works_on = "the rotations of joints" if turns else "the positions of joints, then poses fitted to them"
    lines += [f"  Source: {module.REFERENCE}", f"  Skeletons: {works_on}"]
    rows = [
        [field.name, str(plain(field.default)), str(about(module.Params, field.name))]
        for field in fields(module.Params)
    ]
    return "\n".join([*lines, *(f"  {line}" for line in table(rows, ["parameter", "default", "meaning"]) if rows)])
