"""A journal of the takes that a run has started and finished; it survives a crash and a power cut.

Each line is JSON. ``{"begin": output}`` is written before a take starts, and ``{"output": ..., "key": ..., "take": {its
row of the report}}`` when it has finished. Lines are only appended. A last line torn by a power cut is cut off.
"""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from mocapclean.errors import UsageError

FOLDER = ".mocapclean"
"""The folder of the journals, inside the output folder."""

_BLOCK = 65536
"""Bytes read at a time while the last newline is searched."""

LinePosition = tuple[Path, int]
"""A journal, and the byte at which a line of it starts."""


@dataclass(frozen=True)
class EarlierOutput:
    """An output that an earlier run started.

    key: the hash of everything it was made of; sha256: its content's hash; position: its line in a journal. They are
    empty unless the take was finished without an error.
    """

    key: str = ""
    sha256: str = ""
    position: LinePosition | None = None


def earlier_outputs(folder: Path) -> dict[str, EarlierOutput]:
    """Return the outputs in all journals of an output folder, by path below it.

    Raises UsageError for a journal that cannot be read.
    """
    outputs: dict[str, EarlierOutput] = {}
    for path in sorted((folder / FOLDER).glob("*.jsonl")):
        try:
            with path.open("rb") as file:
                for offset, line in _lines(file):
                    _record(outputs, line, (path, offset))
        except OSError as error:
            raise UsageError(f"{path}: the journal cannot be read: {error.strerror or error}.") from None
    return outputs


def _record(outputs: dict[str, EarlierOutput], line: Mapping[str, Any], position: LinePosition) -> None:
    """Enter the output of a journal's line."""
    if isinstance(line.get("begin"), str):
        outputs.setdefault(line["begin"], EarlierOutput())
    if line.get("key"):
        outputs[line["output"]] = EarlierOutput(line["key"], line["take"]["sha256"]["output"], position)


def _lines(file: BinaryIO) -> Iterator[tuple[int, dict[str, Any]]]:
    """Yield the offset and the content of each complete line of a journal; lines that are not JSON are skipped."""
    offset = 0
    for line in file:
        try:
            content = json.loads(line) if line.endswith(b"\n") else None
        except ValueError:
            content = None
        if isinstance(content, dict):
            yield offset, content
        offset += len(line)


class Journal:
    """The journal of one run, on the disk in its output folder; memory holds only the positions of the rows.

    A context manager. Raises UsageError if another run is writing into the folder or if the folder cannot be written.
    If the disk is full later, rows are kept in memory and ``fault`` is the message for the user. Without a folder all
    rows are kept in memory.
    """

    def __init__(self, folder: Path | None, name: str = "journal") -> None:
        self.path = (folder or Path()) / FOLDER / f"{name}.jsonl"
        self.fault = ""
        self._positions: dict[str, LinePosition] = {}
        self._in_memory: dict[str, Mapping[str, Any]] = {}
        self._open = ExitStack()
        self._file: FileIO | None = None
        if folder is not None:
            self._open_in(folder)

    def _open_in(self, folder: Path) -> None:
        """Lock the folder, and open the journal behind its last complete line."""
        from filelock import FileLock, Timeout  # not needed for a single take without an output folder

        try:
            self.path.parent.mkdir(exist_ok=True)
            self._open.enter_context(FileLock(self.path.with_suffix(".lock")).acquire(timeout=0))
            self._file = self._open.enter_context(self.path.open("ab", buffering=0))
            self._reader = self._open.enter_context(self.path.open("rb"))
            self._end = _end_of_complete_lines(self._reader)
            self._file.truncate(self._end)
        except Timeout:
            message = f"{folder}: another run is writing there. Wait for it, use another folder, or --shard."
            raise UsageError(message) from None
        except OSError as error:
            raise UsageError(f"{self.path}: the journal cannot be written: {error.strerror or error}.") from None

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, fault: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def begin(self, output: str) -> None:
        """Record that this run may write an output from now on; a later run may then replace it."""
        self._append({"begin": output})

    def add(self, output: str, key: str, row: Mapping[str, Any]) -> None:
        """Record a finished take's row of the report.

        key: the hash of everything the output was made of; empty if the take failed.
        """
        position = self._append({"output": output, "key": key, "take": row})
        if position is not None:
            self._positions[output] = position
        else:
            self._in_memory[output] = row

    def adopt(self, output: str, earlier: EarlierOutput) -> None:
        """Use an earlier run's row for an output that this run did not make anew."""
        assert earlier.position is not None
        self._positions[output] = earlier.position

    def row(self, output: str) -> Mapping[str, Any] | None:
        """Return the report row of an output; None if its take is not finished."""
        if output in self._in_memory:
            return self._in_memory[output]
        if output not in self._positions:
            return None
        path, offset = self._positions[output]
        if path == self.path:
            return _row(self._reader, offset)
        with path.open("rb") as file:
            return _row(file, offset)

    def _append(self, line: Mapping[str, Any]) -> LinePosition | None:
        """Write a line and force it to the disk; return its position. A failed write is cut off again, and is None."""
        if self._file is None:
            return None
        content = json.dumps(line, separators=(",", ":"), allow_nan=False).encode() + b"\n"
        try:
            written = 0
            while written < len(content):
                written += self._file.write(content[written:]) or 0
            os.fsync(self._file.fileno())
        except OSError as error:
            self.fault = f"{self.path}: the journal cannot be written: {error.strerror or error}."
            with suppress(OSError):
                self._file.truncate(self._end)
            return None
        position = self.path, self._end
        self._end += len(content)
        return position


def _row(file: BinaryIO, offset: int) -> Mapping[str, Any]:
    """Return the report row of the line at an offset."""
    file.seek(offset)
    row: Mapping[str, Any] = json.loads(file.readline())["take"]
    return row


def _end_of_complete_lines(file: BinaryIO) -> int:
    """Return the byte after the last newline of a file; 0 if there is none."""
    end = file.seek(0, os.SEEK_END)
    while end:
        start = max(0, end - _BLOCK)
        file.seek(start)
        newline = file.read(end - start).rfind(b"\n")
        if newline >= 0:
            return start + newline + 1
        end = start
    return 0
