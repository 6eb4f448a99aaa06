"""Safe writing of any file: never the input, never over an existing file unasked, complete or not at all."""

import contextlib
import hashlib
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from mocapclean.errors import FormatError, UsageError

STEM_BYTES = 100
"""Bytes of the file's own stem in the name of its temporary file; file systems allow 255 bytes for a whole name."""
DIGEST_DIGITS = 12
"""Hexadecimal digits of the hash of the whole name, which keep two names with the same first bytes apart."""

MOST_CHARACTERS = 259
"""Characters of a path on Windows where long paths are not switched on: its MAX_PATH, less the last NUL."""

_on_windows = sys.platform == "win32"
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9¹²³]|lpt[0-9¹²³]|conin\$|conout\$) *(\..*)?", re.IGNORECASE)
"""Names of devices, with any suffix: Microsoft, Naming Files, Paths, and Namespaces."""


def check_output(path: Path, source: Path | None, overwrite: bool) -> None:
    """Raise UsageError when writing ``path`` would touch the input, a folder, or a file without ``overwrite``.

    On Windows also for the name of a device, which keeps nothing, for a colon, which hides the file in another one, and
    for a dot or a space at the end, which is dropped.
    """
    if _on_windows and (_RESERVED.fullmatch(path.name) or ":" in path.name or path.name.endswith((".", " "))):
        raise UsageError(f"{path}: Windows keeps no file of this name. Choose another name.")
    if source is not None and os.path.exists(path) and os.path.exists(source) and path.samefile(source):
        raise UsageError(f"{path}: the output must not be the input. Choose another name or --out-dir.")
    if os.path.isdir(path):
        raise UsageError(f"{path}: the output must be a file. It is a folder.")
    if os.path.lexists(path) and not overwrite:
        raise UsageError(f"{path}: the output exists already. Use --overwrite to replace it.")


def make_folder(folder: Path) -> None:
    """Make a folder and those above it; raise UsageError if it cannot be made."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: the folder cannot be made: {error.strerror or error}.") from None


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """Yield a temporary file in the folder of ``path``; it is renamed to ``path`` unless the block raises.

    The temporary file keeps the suffix of ``path`` and is removed when the block raises. A FormatError of the block
    about the temporary file becomes one about ``path``. Raises FormatError when the folder does not allow a new file or
    the file cannot be stored.
    """
    part = path.parent / f"{_part_prefix(path)}{os.urandom(8).hex()}.part{path.suffix}"
    try:
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as fault:
        raise _not_written(path, fault, part) from None
    try:
        yield part
        _store(part, path)
    except FormatError as fault:
        if fault.path != part:
            raise
        raise fault.renamed(path) from None
    except OSError as fault:
        raise _not_written(path, fault, part) from None
    finally:
        part.unlink(missing_ok=True)


def _not_written(path: Path, fault: OSError, part: Path) -> FormatError:
    """Return the error of a file that cannot be written, with what is peculiar to Windows."""
    if isinstance(fault, FileNotFoundError) and not path.parent.is_dir():
        return FormatError(path, "cannot be written: its folder does not exist. Make it, or choose another one.")
    advice = ""
    if _on_windows and isinstance(fault, PermissionError):
        advice = " Close the program that has it open."
    if _on_windows and len(os.path.abspath(part)) > MOST_CHARACTERS:
        advice = f" The path of its temporary file has more than {MOST_CHARACTERS} characters; choose a shorter one."
    return FormatError(path, f"cannot be written: {fault.strerror or fault}.{advice}")


def discard_parts(path: Path) -> None:
    """Remove the temporary files of ``path`` that a killed process left; no other process may be writing ``path``."""
    start, end = _part_prefix(path), f".part{path.suffix}"
    for name in os.listdir(path.parent) if path.parent.is_dir() else ():
        if name.startswith(start) and name.endswith(end):
            (path.parent / name).unlink(missing_ok=True)


def _part_prefix(path: Path) -> str:
    """Return how the names of a path's temporary files begin: hidden, short, and different for every path."""
    start = os.fsencode(path.stem)[:STEM_BYTES].decode("utf-8", "ignore")
    return f".{start}.{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:DIGEST_DIGITS]}."


def _store(part: Path, path: Path) -> None:
    """Force a finished file to the disk, then give it its name in one step."""
    with part.open("r+b") as file:  # Windows forces only files to the disk that are open for writing
        os.fsync(file.fileno())
    part.replace(path)
