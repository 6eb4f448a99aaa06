"""The errors that users see. Every message is one sentence: what is wrong, where, and what to do."""

from pathlib import Path
from typing import Any


class MocapcleanError(Exception):
    """The base of all errors that users see. ``exit_code``: of the command."""

    exit_code = 1


class UsageError(MocapcleanError):
    """The command or the call is wrong or impossible."""

    exit_code = 2


class ConfigError(UsageError):
    """A configuration has unknown keys, wrong types, values out of range or contradictions; one message per line."""


class SolverError(MocapcleanError):
    """A method cannot fill this take."""


class PackageError(MocapcleanError):
    """A method or a rule of another package cannot be used."""


class UnknownNameError(PackageError, KeyError):
    """A name is none of a registry, and no installed package adds it."""

    __str__ = Exception.__str__  # that of KeyError puts the message in quotation marks


class WorkerError(MocapcleanError):
    """The process of a take was lost: it crashed, or exceeded a limit of time or memory."""


class FormatError(MocapcleanError):
    """A file violates its format, or its format cannot store the take.

    The message holds the place of the fault: ``line`` (of text, from 1), ``byte`` (from 0), ``frame`` (the file's own
    number) and ``marker``, as far as they are known.
    """

    def __init__(
        self,
        path: Path | str,
        message: str,
        *,
        line: int | None = None,
        byte: int | None = None,
        frame: int | None = None,
        marker: str | None = None,
    ) -> None:
        """Compose the message from the path, the place and the fault."""
        places = (("line", line), ("byte", byte), ("frame", frame), ("marker", marker))
        where = "".join(f", {name} {value}" for name, value in places if value is not None)
        super().__init__(f"{path}{where}: {message}")
        self.path, self.line, self.byte, self.frame, self.marker = path, line, byte, frame, marker

    def renamed(self, path: Path) -> "FormatError":
        """Return the error of a temporary file as that of the file that it was to become."""
        own = _from_message(f"{path}{self.args[0].removeprefix(str(self.path))}")
        own.__dict__ |= {**self.__dict__, "path": path}
        return own

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what pickle needs to make the same error, with its composed message, in another process."""
        return _from_message, self.args, self.__dict__


def _from_message(message: str) -> FormatError:
    """Return an error with a message that is already composed."""
    return FormatError.__new__(FormatError, message)


def printable(text: str) -> str:
    """Return a line with escapes for characters that cannot be printed or would control the terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
