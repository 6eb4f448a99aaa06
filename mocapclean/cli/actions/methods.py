"""The action of ``mocapclean methods``: every method, its parameters, defaults and reference."""

import inspect
from dataclasses import fields

import click

from mocapclean.cli.guard import complain
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.errors import PackageError, UsageError, printable
from mocapclean.json_values import plain
from mocapclean.parameters import about
from mocapclean.report.text import table
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.method import Method
from mocapclean.solvers.names import require_method


def work(names: tuple[str, ...], check: bool) -> int:
    """Print the methods, or some of them in full, or whether these keep the laws; return the exit code."""
    for name in names:
        require_method(name)
    if check:
        if not names:
            raise UsageError("--check needs the name of a method. Got none.")
        return max([_check(name) for name in names])
    for number, name in enumerate(names or SOLVERS):
        click.echo(("\n" if number else "") + _block(name, full=bool(names)))
    return 0 if names else max(map(_print_foreign, SOLVERS.installed()), default=0)


def _print_foreign(name: str) -> int:
    """Print a method of another package, or why it cannot be used; return the exit code."""
    try:
        click.echo(f"\n{_block(name, full=False)}")
    except PackageError as broken:
        complain(str(broken))
        return broken.exit_code
    return 0


def _check(name: str) -> int:
    """Print whether a method keeps each law, and return the exit code: 1 if it breaks one that must hold."""
    from mocapclean.solvers.contract import Subject, try_laws  # it loads what the methods need

    subject = Subject(name, SOLVERS[name])
    results = try_laws(subject)
    click.echo(f"{name}{_package(name)}")
    for law, reason in results.items():
        verdict = "kept" if not reason else "BROKEN" if law.is_required else "not kept"
        click.echo(f"  {verdict:8}  {law.name:10}  {law.statement}")
        if reason:
            click.echo(f"{'':24}{printable(reason)}")
    broken = [law for law, reason in results.items() if reason and law.is_required]
    n_kept = sum(not reason for reason in results.values())
    click.echo(f"  {n_kept} of {len(results)} laws kept; {len(broken)} broken that every method must keep")
    return int(bool(broken))


def _package(name: str) -> str:
    """Return the package of a method in words, or "" for one of the project's own."""
    origin = SOLVERS.origin(name)
    return f" ({origin})" if origin else ""


def _block(name: str, *, full: bool) -> str:
    """Return the text on a method: its first line or all of it, its source, and its parameters."""
    module = SOLVERS[name]
    with SOLVERS.blamed(name):
        return _described(name, module, full)


def _described(name: str, module: Method, full: bool) -> str:
    """Return the text on the module of a method."""
    text = inspect.cleandoc(module.__doc__ or "It has no description.")
    default = " (default)" if name == DEFAULT_METHOD else ""
    lines = [
        f"{name}{default}{_package(name)}",
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
