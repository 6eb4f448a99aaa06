"""Turn every error into one sentence on standard error, and into an exit code."""

import os
import signal
import sys
from collections.abc import Callable
from functools import wraps
from types import FrameType
from typing import NoReturn, ParamSpec

import click

from mocapclean.errors import ConfigError, MocapcleanError, printable

P = ParamSpec("P")

INTERRUPTED = "Interrupted. Unfinished files were removed."


def guarded(command: Callable[P, int]) -> Callable[P, NoReturn]:
    """Return a command that exits with the code that ``command`` returns.

    Expected errors, signals and a closed pipe end the process with a message and an exit code, without a traceback.
    """

    @wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> NoReturn:
        signal.signal(signal.SIGTERM, _interrupt)
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()
        except MocapcleanError as error:
            complain(*_sentences(error))
            code = error.exit_code
        except KeyboardInterrupt as interrupt:
            complain(INTERRUPTED)
            code = 128 + (interrupt.args[0] if interrupt.args else signal.SIGINT)
        except BrokenPipeError:
            # Python flushes standard output once more at exit; the null device takes what the pipe no longer does.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        sys.exit(code)

    return run


def complain(*sentences: str) -> None:
    """Print each sentence on a line of its own on standard error."""
    for sentence in sentences:
        click.echo(f"mocapclean: {printable(sentence)}", err=True)


def _sentences(error: MocapcleanError) -> list[str]:
    """Return the sentences of an error: a ConfigError has one per line, any other error has one."""
    return str(error).split("\n") if isinstance(error, ConfigError) else [str(error)]


def _interrupt(signum: int, frame: FrameType | None) -> NoReturn:
    """Handle SIGTERM as Python handles Ctrl-C."""
    raise KeyboardInterrupt(signum)
