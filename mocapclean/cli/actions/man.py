"""The action of ``mocapclean man``: the help of every command as a manual page (troff with the macros of man(7))."""

import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from mocapclean import __version__
from mocapclean.cli import cli
from mocapclean.cli.options import Command
from mocapclean.files import check_output, make_folder, new_file

_PROGRAM = "mocapclean"
_EXIT_CODES = {
    "0": "All went well.",
    "1": "A take failed, or exceeds a limit.",
    "2": "The command or the configuration is wrong.",
    "130, 143": "The command was interrupted.",
}


def work(out_dir: Path, overwrite: bool) -> int:
    """Write the pages; return the exit code."""
    found = pages()
    for name in found:
        check_output(out_dir / name, None, overwrite)
    make_folder(out_dir)
    for name, text in found.items():
        with new_file(out_dir / name) as part:
            part.write_text(text, encoding="utf-8", newline="\n")
    click.echo(f"{len(found)} pages in {out_dir}")
    return 0


def pages() -> dict[str, str]:
    """Return the text of the page of the program, and of each of its commands, by file name."""
    parent = click.Context(cli, info_name=_PROGRAM)
    found = {f"{_PROGRAM}.1": _page(_PROGRAM, _first_sentence(cli), _overview(parent))}
    for name, summary in cli.summaries.items():
        command = cli.get_command(parent, name)
        assert isinstance(command, Command)
        context = click.Context(command, info_name=name, parent=parent)
        found[f"{_PROGRAM}-{name}.1"] = _page(f"{_PROGRAM}-{name}", summary, _details(command, context))
    return found


def _page(title: str, summary: str, body: Iterable[str]) -> str:
    """Return a page with its title, its summary and the lines of its sections."""
    name = _escaped(title)
    head = [f'.TH "{name.upper()}" "1" "" "{_PROGRAM} {_escaped(__version__)}" "{_PROGRAM} manual"', ".SH NAME"]
    return "\n".join([*head, f"{name} \\- {_escaped(summary.rstrip('.'))}", *body]) + "\n"


def _overview(context: click.Context) -> Iterator[str]:
    """Yield the sections of the page of the program."""
    yield from _synopsis(context)
    yield ".SH DESCRIPTION"
    yield from _paragraphs(cli.help or "")
    yield ".SH COMMANDS"
    for name, summary in cli.summaries.items():
        yield from (".TP", f"\\fB{_escaped(f'{_PROGRAM}-{name}')}\\fR(1)", _escaped(summary))
    yield from _exit_status()


def _details(command: Command, context: click.Context) -> Iterator[str]:
    """Yield the sections of the page of a command."""
    yield from _synopsis(context)
    yield ".SH DESCRIPTION"
    yield from _paragraphs(command.help or "")
    for heading, params in command.by_purpose(context).items():
        yield f".SH {heading.upper()}"
        for names, text in filter(None, (param.get_help_record(context) for param in params)):
            yield from (".TP", f"\\fB{_escaped(names)}\\fR", _escaped(text))
    yield ".SH EXAMPLES"
    yield ".nf"
    yield from (_escaped(line.strip()) for line in (command.epilog or "").splitlines()[3:])
    yield ".fi"
    yield from _exit_status()
    yield from (".SH SEE ALSO", f"\\fB{_PROGRAM}\\fR(1)")


def _synopsis(context: click.Context) -> Iterator[str]:
    pieces = " ".join(context.command.collect_usage_pieces(context))
    yield from (".SH SYNOPSIS", f"\\fB{_escaped(context.command_path)}\\fR {_escaped(pieces)}")


def _exit_status() -> Iterator[str]:
    yield ".SH EXIT STATUS"
    for code, meaning in _EXIT_CODES.items():
        yield from (".TP", f"\\fB{code}\\fR", meaning)


def _paragraphs(text: str) -> Iterator[str]:
    """Yield the paragraphs of a help text."""
    for number, paragraph in enumerate(inspect.cleandoc(text).split("\n\n")):
        if number:
            yield ".PP"
        yield _escaped(" ".join(paragraph.split()))


def _first_sentence(command: click.Command) -> str:
    return inspect.cleandoc(command.help or "").split("\n\n")[0]


def _escaped(text: str) -> str:
    """Return a text that troff prints as it is: no escape, no request, and hyphens that can be copied."""
    ascii_text = "".join(c if c.isascii() else f"\0[u{ord(c):04X}]" for c in text)
    escaped = ascii_text.replace("\\", "\\e").replace("-", "\\-").replace("\0", "\\")
    return f"\\&{escaped}" if escaped[:1] in (".", "'") else escaped
