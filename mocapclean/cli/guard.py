"""Turn what goes wrong into one sentence on standard error and the right exit code."""

import os
import signal
import sys
from collections.abc import Callable
from functools import wraps
from types import FrameType
from typing import NoReturn, ParamSpec

import click

from mocapclean.errors import ConfigError, MocapcleanError
from mocapclean.report.text import printable

P = ParamSpec("P")

INTERRUPTED = "interrupted; files not finished are not there."


def guarded(command: Callable[P, int]) -> Callable[P, NoReturn]:
    """Run a command that returns its exit code; errors and interruptions end it cleanly, never with a traceback."""

    @wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> NoReturn:
        signal.signal(signal.SIGTERM, _stop)
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()
        except MocapcleanError as fault:
            complain(*_sentences(fault))
            code = fault.exit_code
        except KeyboardInterrupt as stop:
            complain(INTERRUPTED)
            code = 128 + (stop.args[0] if stop.args else signal.SIGINT)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        sys.exit(code)

    return run


def complain(*sentences: str) -> None:
    """Say on standard error what is wrong, each in a line of its own."""
    for sentence in sentences:
        click.echo(f"mocapclean: {printable(sentence)}", err=True)


def _sentences(fault: MocapcleanError) -> list[str]:
    """What an error says; only that of a configuration has several things to say."""
    return str(fault).split("\n") if isinstance(fault, ConfigError) else [str(fault)]


def _stop(signum: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt(signum)
