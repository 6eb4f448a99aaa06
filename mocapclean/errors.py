"""Everything that can go wrong for a user, each as one clear sentence: what, where, what to do."""

from pathlib import Path
from typing import Any


class MocapcleanError(Exception):
    """The base of all errors that a user is told about; a take that fails with one exits 1."""

    exit_code = 1


class UsageError(MocapcleanError):
    """The command or the call asks for something that cannot be done."""

    exit_code = 2


class ConfigError(UsageError):
    """A configuration file has an unknown key, a wrong type or a value out of range."""


class SolverError(MocapcleanError):
    """A method cannot answer for this take."""


class WorkerError(MocapcleanError):
    """The process that worked at a take was lost: it died, took too long or needed too much."""


class FormatError(MocapcleanError):
    """A file is not what its format allows, or cannot hold what it should.

    ``line`` (text, from 1), ``byte`` (binary, from 0), ``frame`` (the file's own number) and ``marker`` say
    where; whichever are given stand in the message.
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
        """Compose the sentence from the path, the place and the message."""
        places = (("line", line), ("byte", byte), ("frame", frame), ("marker", marker))
        where = "".join(f", {name} {value}" for name, value in places if value is not None)
        super().__init__(f"{path}{where}: {message}")
        self.path, self.line, self.byte, self.frame, self.marker = path, line, byte, frame, marker

    def __reduce__(self) -> tuple[Any, ...]:
        """Let it pass between processes: as the sentence that it is, not as what it was composed of."""
        return _as_said, self.args, self.__dict__


def _as_said(sentence: str) -> FormatError:
    return FormatError.__new__(FormatError, sentence)
