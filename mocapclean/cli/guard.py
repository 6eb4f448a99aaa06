"""Turn what goes wrong into one sentence on standard error and the right exit code."""

import os
import signal
import sys
from collections.abc import Callable
from functools import wraps
from types import FrameType
from typing import NoReturn, ParamSpec

import click

from mocapclean.errors import MocapcleanError

P = ParamSpec("P")


def guarded(command: Callable[P, int]) -> Callable[P, NoReturn]:
    """Run a command that returns its exit code; errors and interruptions end it cleanly, never with a traceback."""

    @wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> NoReturn:
        signal.signal(signal.SIGTERM, _stop)
        try:
            code = command(*args, **kwargs)
            sys.stdout.flush()
        except MocapcleanError as fault:
            complain(str(fault))
            code = fault.exit_code
        except KeyboardInterrupt:
            complain("interrupted; files not finished are not there.")
            code = 130
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            code = 1
        sys.exit(code)

    return run


def complain(message: str) -> None:
    """Say on standard error what is wrong."""
    for line in message.splitlines():
        click.echo(f"mocapclean: {line}", err=True)


def _stop(signum: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt
