"""Which takes: files, folders, lists and patterns, and the part of them that one of several machines does."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import BinaryIO

from mocapclean.errors import UsageError
from mocapclean.formats import suffixes

SUFFIXES = suffixes()


@dataclass(frozen=True, kw_only=True)
class Input:
    """A capture file, and its place in the tree that is mirrored under the output folder."""

    path: Path
    relative: Path


def named(paths: Iterable[Path], root: Path | None = None, skip: Path | None = None) -> Iterator[Input]:
    """The files that are named and the captures in the folders that are named, folder by folder, sorted by name.

    A file keeps its name alone and a file in a folder its path below that folder; with ``root`` either keeps its path
    below ``root``. Links to folders are followed, and no folder is entered twice. What is hidden is left out, and so
    is the folder ``skip``. Raises UsageError for a folder that cannot be read, and for what is not below ``root``.
    """
    seen = {_identity(skip)} if skip and os.path.isdir(skip) else set()
    for path in paths:
        if not os.path.isdir(path):
            yield Input(path=path, relative=_below(path, root) if root else Path(path.name))
            continue
        start = _below(path, root) if root else Path()
        for relative in _walk(path, seen):
            yield Input(path=path / relative, relative=start / relative)


def listed(file: BinaryIO, null: bool = False) -> list[Path]:
    """The paths that a list names, one a line or, with ``null``, each ended by a NUL; empty ones do not count.

    Raises UsageError for a NUL in a line.
    """
    content = file.read()
    if not null and b"\0" in content:
        raise UsageError("--files-from must hold one path a line. Got a NUL; give -0 if each is ended by one.")
    names = content.split(b"\0") if null else [line.removesuffix(b"\r") for line in content.split(b"\n")]
    return [Path(os.fsdecode(name)) for name in names if name]


def chosen(inputs: Iterable[Input], include: Sequence[str], exclude: Sequence[str]) -> list[Input]:
    """The inputs that match one of ``include``, if there are any, and none of ``exclude``.

    A pattern with a slash is held against the relative path, any other against the name.
    """
    return [
        found
        for found in inputs
        if (not include or _matches(found.relative, include)) and not _matches(found.relative, exclude)
    ]


def shard(inputs: Iterable[Input], index: int, count: int) -> list[Input]:
    """The inputs that are part ``index`` (from 1) of ``count``.

    Where a take belongs is decided by its relative path alone, so that machines that list a folder at different times
    still share it out without loss or repetition.
    """
    return [found for found in inputs if _number(found.relative) % count == index - 1]


def _number(relative: Path) -> int:
    return int.from_bytes(hashlib.sha256(os.fsencode(relative.as_posix())).digest()[:8], "big")


def _matches(relative: Path, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(relative.as_posix() if "/" in pattern else relative.name, pattern) for pattern in patterns)


def _below(path: Path, root: Path) -> Path:
    """A path as seen from ``root``; neither is resolved, so that a link stays what the user sees."""
    try:
        return Path(os.path.abspath(path)).relative_to(os.path.abspath(root))
    except ValueError:
        message = (
            f"{path}: a take must lie below {root.absolute()}, to be mirrored. Give its folder with --relative-to."
        )
        raise UsageError(message) from None


def _walk(top: Path, seen: set[tuple[int, int]]) -> Iterator[Path]:
    """The captures below a folder, as seen from it: the files of a folder, then its folders."""
    waiting = [Path()]
    while waiting:
        relative = waiting.pop()
        folder = top / relative
        try:
            identity = _identity(folder)
            names = sorted(os.listdir(folder), key=os.fsencode) if identity not in seen else []
        except OSError as fault:
            raise UsageError(f"{folder}: the folder cannot be read: {fault.strerror or fault}.") from None
        seen.add(identity)
        visible = [name for name in names if not name.startswith(".")]
        folders = {name for name in visible if os.path.isdir(folder / name)}
        waiting += [relative / name for name in reversed(visible) if name in folders]
        yield from (relative / name for name in visible if name not in folders and name.lower().endswith(SUFFIXES))


def _identity(folder: Path) -> tuple[int, int]:
    found = folder.stat()
    return found.st_dev, found.st_ino
