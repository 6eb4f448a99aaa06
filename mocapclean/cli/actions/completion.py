"""The action of ``mocapclean completion``: click's script, with a few lines in another form."""

import click
from click.shell_completion import BashComplete, FishComplete, ShellComplete, ZshComplete

from mocapclean.cli import cli

PROGRAM = "mocapclean"
VARIABLE = "_MOCAPCLEAN_COMPLETE"
"""The variable by which the script asks the command, as click derives it from the name of the program."""
_UNFINISHED = "    [[ ${#COMPREPLY[@]} == 1 && $COMPREPLY == *[.=:] ]] && compopt -o nospace\n    return 0\n"


class _Bash(BashComplete):
    """The script of bash, which escapes spaces in names, and adds none after a section, a key or the start of a range.

    A word that begins with a quotation mark needs no escapes.
    """

    source_template = BashComplete.source_template.replace(
        "COMPREPLY+=($value)",
        """[[ ${COMP_WORDS[COMP_CWORD]} == [\\"\\']* ]] || printf -v value %%q "$value"
            COMPREPLY+=("$value")""",
    ).replace("    return 0\n", _UNFINISHED)


class _Fish(FishComplete):
    """The script of fish, which shows descriptions with commas whole."""

    source_template = FishComplete.source_template.replace('string split ","', 'string split -m 1 ","')


SHELLS: dict[str, type[ShellComplete]] = {"bash": _Bash, "zsh": ZshComplete, "fish": _Fish}


def work(shell: str) -> int:
    """Print the completion script of a shell; return the exit code."""
    click.echo(SHELLS[shell](cli, {}, PROGRAM, VARIABLE).source())
    return 0
