"""Find the takes of a command: files, folders, lists and patterns, and the shard of them for one machine."""

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import BinaryIO

from mocapclean.errors import UsageError
from mocapclean.formats import is_take, suffixes

SUFFIXES = suffixes()


@dataclass(frozen=True, kw_only=True)
class Input:
    """A capture file, and its path below the output folder, which mirrors the input's tree."""

    path: Path
    relative: Path


def find(
    paths: Iterable[Path], root: Path | None = None, skip: Path | None = None, left_out: list[Path] | None = None
) -> Iterator[Input]:
    """Yield the files among ``paths`` and the captures in the folders among them, folder by folder, sorted by name.

    The relative path of a file is its name; that of a capture in a folder is its path below that folder. With ``root``
    both are the path below ``root``. Links to folders are followed, and no folder is entered twice. Hidden files and
    folders and the folder ``skip`` are left out. So are files in folders whose suffix several formats have and whose
    content is of none; these are added to ``left_out``. Raises UsageError for an unreadable folder or a path outside
    ``root``.
    """
    entered = {_identity(skip)} if skip and os.path.isdir(skip) else set()
    for path in paths:
        if not os.path.isdir(path):
            yield Input(path=path, relative=_below(path, root) if root else Path(path.name))
            continue
        start = _below(path, root) if root else Path()
        for relative in _walk(path, entered):
            if not is_take(path / relative):
                if left_out is not None:
                    left_out.append(path / relative)
                continue
            yield Input(path=path / relative, relative=start / relative)


def read_list(file: BinaryIO, null: bool = False) -> list[Path]:
    """Return the paths in a list: one per line or, with ``null``, each ended by a NUL. Empty names are skipped.

    Raises UsageError for a NUL in a list of lines.
    """
    content = file.read()
    if not null and b"\0" in content:
        raise UsageError("--files-from must have one path per line. Got a NUL; add -0 if each name ends with a NUL.")
    names = content.split(b"\0") if null else [line.removesuffix(b"\r") for line in content.split(b"\n")]
    return [Path(os.fsdecode(name)) for name in names if name]


def matching(inputs: Iterable[Input], include: Sequence[str], exclude: Sequence[str]) -> list[Input]:
    """Return the inputs that match a pattern of ``include``, if there are any, and no pattern of ``exclude``.

    A pattern with a slash is matched with the relative path, any other pattern with the name.
    """
    return [
        each
        for each in inputs
        if (not include or _matches(each.relative, include)) and not _matches(each.relative, exclude)
    ]


def shard(inputs: Iterable[Input], index: int, count: int) -> list[Input]:
    """Return the inputs of shard ``index`` (from 1) of ``count``.

    The shard of a take depends on its relative path alone. So machines that list a folder at different times still
    share its takes without loss or repetition.
    """
    return [each for each in inputs if _hash(each.relative) % count == index - 1]


def _hash(relative: Path) -> int:
    """Return a hash of a path that is the same on every machine."""
    return int.from_bytes(hashlib.sha256(os.fsencode(relative.as_posix())).digest()[:8], "big")


def _matches(relative: Path, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(relative.as_posix() if "/" in pattern else relative.name, pattern) for pattern in patterns)


def _below(path: Path, root: Path) -> Path:
    """Return a path relative to ``root``, links unresolved; raise UsageError for a path outside ``root``."""
    try:
        return Path(os.path.abspath(path)).relative_to(os.path.abspath(root))
    except ValueError:
        message = f"{path}: a take must lie below {root.absolute()} to be mirrored. Give its folder with --relative-to."
        raise UsageError(message) from None


def _walk(top: Path, entered: set[tuple[int, int]]) -> Iterator[Path]:
    """Yield the captures below a folder, relative to it: first the files of each folder, then its folders."""
    to_visit = [Path()]
    while to_visit:
        relative = to_visit.pop()
        folder = top / relative
        try:
            identity = _identity(folder)
            names = sorted(os.listdir(folder), key=os.fsencode) if identity not in entered else []
        except OSError as error:
            raise UsageError(f"{folder}: the folder cannot be read: {error.strerror or error}.") from None
        entered.add(identity)
        visible = [name for name in names if not name.startswith(".")]
        folders = {name for name in visible if os.path.isdir(folder / name)}
        to_visit += [relative / name for name in reversed(visible) if name in folders]
        yield from (relative / name for name in visible if name not in folders and name.lower().endswith(SUFFIXES))


def _identity(folder: Path) -> tuple[int, int]:
    """Return the device and inode of a folder, which are the same through every link to it."""
    status = folder.stat()
    return status.st_dev, status.st_ino
