"""What a run has begun and done, line by line on the disk, so that neither memory nor a power cut can lose it.

A line is JSON: ``{"begin": output}`` before a take is begun, and when it is finished ``{"output": ..., "key": ...,
"take": {its row of the report}}``. A journal is only ever added to. A last line that a power cut has torn is cut off.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from filelock import FileLock, Timeout

from mocapclean.errors import UsageError

FOLDER = ".mocapclean"

Place = tuple[Path, int]


@dataclass(frozen=True)
class Before:
    """What earlier runs say of an output: begun at least; if it was ever finished well, with which key and hash."""

    key: str = ""
    sha256: str = ""
    place: Place | None = None


def earlier(folder: Path) -> dict[str, Before]:
    """What the journals of an output folder know of its outputs, by path below it; UsageError for an unreadable one."""
    known: dict[str, Before] = {}
    for path in sorted((folder / FOLDER).glob("*.jsonl")):
        try:
            with path.open("rb") as file:
                for offset, line in _lines(file):
                    _learn(known, line, (path, offset))
        except OSError as fault:
            raise UsageError(f"{path}: the journal cannot be read: {fault.strerror or fault}.") from None
    return known


def _learn(known: dict[str, Before], line: Mapping[str, Any], place: Place) -> None:
    if isinstance(line.get("begin"), str):
        known.setdefault(line["begin"], Before())
    if line.get("key"):
        known[line["output"]] = Before(line["key"], line["take"]["sha256"]["output"], place)


def _lines(file: BinaryIO) -> Iterator[tuple[int, dict[str, Any]]]:
    """The whole lines of a journal with where they begin; what is no JSON is passed over."""
    offset = 0
    for line in file:
        try:
            found = json.loads(line) if line.endswith(b"\n") else None
        except ValueError:
            found = None
        if isinstance(found, dict):
            yield offset, found
        offset += len(line)


class Journal:
    """The rows of one run, in its output folder (or in a temporary one), where memory does not count.

    Raises UsageError when another run is writing there, or when nobody can. A context manager. When the disk is full
    later on, rows are kept in memory and ``fault`` says so.
    """

    def __init__(self, folder: Path, name: str = "journal") -> None:
        self.path = folder / FOLDER / f"{name}.jsonl"
        self.fault = ""
        self._places: dict[str, Place] = {}
        self._kept: dict[str, Mapping[str, Any]] = {}
        try:
            self.path.parent.mkdir(exist_ok=True)
            self._lock = FileLock(self.path.with_suffix(".lock"))
            self._lock.acquire(timeout=0)
            self._file = self.path.open("ab", buffering=0)
            self._reader = self.path.open("rb")
            self._end = _whole(self._reader)
            self._file.truncate(self._end)
        except Timeout:
            message = f"{folder}: another run is writing there. Wait for it, use another folder, or --shard."
            raise UsageError(message) from None
        except OSError as fault:
            raise UsageError(f"{self.path}: the journal cannot be written: {fault.strerror or fault}.") from None

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._reader.close()
        self._lock.release()

    def begin(self, output: str) -> None:
        """Say that an output may be written from now on: what is found there later is this run's own."""
        self._append({"begin": output})

    def add(self, output: str, key: str, take: Mapping[str, Any]) -> None:
        """Keep a finished take's row; key: what the output was made of, empty unless all went well."""
        place = self.path, self._end
        if self._append({"output": output, "key": key, "take": take}):
            self._places[output] = place
        else:
            self._kept[output] = take

    def take_over(self, output: str, before: Before) -> None:
        """Let an earlier run's row stand for an output."""
        assert before.place is not None
        self._places[output] = before.place

    def row(self, output: str) -> Mapping[str, Any] | None:
        """The row of an output; None while there is none."""
        if output in self._kept:
            return self._kept[output]
        if output not in self._places:
            return None
        path, offset = self._places[output]
        if path == self.path:
            return _row(self._reader, offset)
        with path.open("rb") as file:
            return _row(file, offset)

    def _append(self, line: Mapping[str, Any]) -> bool:
        """Add a line and force it to the disk; whether that went well. What did not leaves no trace."""
        content = json.dumps(line, separators=(",", ":"), allow_nan=False).encode() + b"\n"
        try:
            written = 0
            while written < len(content):
                written += self._file.write(content[written:]) or 0
            os.fsync(self._file.fileno())
        except OSError as fault:
            self.fault = f"{self.path}: the journal cannot be written: {fault.strerror or fault}."
            with suppress(OSError):
                self._file.truncate(self._end)
            return False
        self._end += len(content)
        return True


def _row(file: BinaryIO, offset: int) -> Mapping[str, Any]:
    file.seek(offset)
    found: Mapping[str, Any] = json.loads(file.readline())["take"]
    return found


def _whole(file: BinaryIO) -> int:
    """Where the last whole line of a file ends."""
    end = file.seek(0, os.SEEK_END)
    while end:
        start = max(0, end - 65536)
        file.seek(start)
        newline = file.read(end - start).rfind(b"\n")
        if newline >= 0:
            return start + newline + 1
        end = start
    return 0
