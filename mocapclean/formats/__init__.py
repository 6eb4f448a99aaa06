"""Capture files: one module per format, one literal registry, one way to read and to write.

A format module has

- ``SUFFIXES``: lower-case file name endings;
- ``sniff(head)``: whether the first 512 bytes of a file look like this format;
- ``read(path, options)``: the Take, with the document kept in ``take.origin`` so that nothing is lost;
- ``write(take, path, *, invalidate=False)``: copies the kept document to ``path`` (a temporary name, never the
  input) with the ``filled`` samples replaced, and returns the Take as the new file holds it: positions as stored,
  ``filled`` reduced to what the format could express, findings that tell the difference. With ``invalidate``
  samples neither trusted nor filled are marked missing, where the format has such a mark;
- ``prove(take, path)``: reads ``path`` back and raises FormatError unless it holds just what ``take`` (the return
  of ``write``) says and is identical to the kept document everywhere else;
- ``create(take, path)``: a brand-new file from a take that was never in one.
"""

import contextlib
import glob
import hashlib
import os
import secrets
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

from mocapclean.errors import FormatError, UsageError
from mocapclean.formats import amc, bvh, c3d
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import ReadOptions, Take

FORMATS: dict[str, ModuleType] = {"c3d": c3d, "bvh": bvh, "amc": amc}


def format_of(path: Path) -> str:
    """The name of the format that a path's suffix stands for; raises FormatError for any other suffix."""
    for name, module in FORMATS.items():
        if path.suffix.lower() in module.SUFFIXES:
            return name
    if path.suffix.lower() == ".asf":
        raise FormatError(path, "an .asf file is a skeleton, not a take. Give the .amc file that goes with it.")
    known = ", ".join(suffix for module in FORMATS.values() for suffix in module.SUFFIXES)
    raise FormatError(path, f"the file name must end in one of {known}. Got {path.suffix or 'no suffix'!r}.")


def read(
    path: Path | str,
    *,
    skeleton: Path | str | None = None,
    rate: float | None = None,
    unit: float | None = None,
    points: Sequence[str] = (),
) -> Take:
    """Read a capture file as a Take.

    skeleton: the .asf of an .amc, where it does not lie beside it. rate: frames per second, for files that do not
    say. unit: millimetres per unit of length, for BVH. points: C3D points that are not markers, to be read as such.
    Raises FormatError with the place of the fault; UsageError for points that the file does not have.
    """
    path = Path(path)
    module = FORMATS[format_of(path)]
    options = ReadOptions(skeleton=Path(skeleton) if skeleton else None, rate=rate, unit=unit, points=tuple(points))
    try:
        with path.open("rb") as file:
            head = file.read(512)
        if not head:
            raise FormatError(path, "the file is empty.")
        if not module.sniff(head):
            raise FormatError(path, f"the content is not {path.suffix.lower()[1:].upper()}.", byte=0)
        take: Take = module.read(path, options)
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None
    return take


def companion(path: Path) -> Path | None:
    """The other file that reading ``path`` reads too: the .asf beside an .amc; FormatError where it is not there."""
    return amc.find_asf(path) if format_of(path) == "amc" else None


def read_skeleton(path: Path, unit: float | None = None) -> Skeleton:
    """Read the joints and bones of an .asf or a .bvh file; unit: millimetres per unit of length, for BVH."""
    readers: dict[str, Callable[[], Skeleton]] = {
        ".asf": lambda: amc.read_skeleton(path),
        ".bvh": lambda: bvh.read_skeleton(path, unit),
    }
    if path.suffix.lower() not in readers:
        raise UsageError(f"{path}: a skeleton must be an .asf or a .bvh file.")
    try:
        return readers[path.suffix.lower()]()
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None


def write(take: Take, path: Path | str, *, invalidate: bool = False, overwrite: bool = False) -> Take:
    """Write a take to a new file, complete and proven, or not at all; returns it as the file now holds it.

    A take that was read is patched into a copy of its own file: only filled samples change. One that never was in a
    file, or was in one of another format, becomes a brand-new C3D. invalidate: mark samples missing (C3D) that are
    neither trusted nor filled. Raises UsageError when ``path`` is the take's own file, or exists and ``overwrite`` is
    false, or asks for a format that marker positions alone cannot fill; FormatError when it cannot be written.
    """
    path = Path(path)
    name = format_of(path)
    check_output(path, take.origin.path if take.origin else None, overwrite)
    module = FORMATS[name]
    with new_file(path) as part:
        if take.origin and take.origin.format == name:
            written: Take = module.write(take, part, invalidate=invalidate)
            module.prove(written, part)
            return written
        if name != "c3d":
            raise UsageError(f"{path}: positions alone are not a pose. Write this take as .c3d.")
        c3d.create(take, part)
        return take


def check_output(path: Path, source: Path | None, overwrite: bool) -> None:
    """Raise UsageError when writing ``path`` would touch the input or an existing file without ``overwrite``."""
    if source is not None and os.path.exists(path) and os.path.exists(source) and path.samefile(source):
        raise UsageError(f"{path}: the output must not be the input. Choose another name or --out-dir.")
    if os.path.lexists(path) and not overwrite:
        raise UsageError(f"{path}: the output exists already. Use --overwrite to replace it.")


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """A temporary file in the same folder that takes ``path``'s place when all went well, and else leaves no trace."""
    part = path.parent / f"{_part_prefix(path)}{secrets.token_hex(8)}.part{path.suffix}"
    try:
        os.close(os.open(part, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as fault:
        raise FormatError(path, f"cannot be written: {fault.strerror or fault}.") from None
    try:
        yield part
        _settle(part, path)
    except OSError as fault:
        raise FormatError(path, f"cannot be written: {fault.strerror or fault}.") from None
    finally:
        part.unlink(missing_ok=True)


def discard_parts(path: Path) -> None:
    """Remove the temporary files that a killed process has left of ``path``; nobody else may be writing it."""
    for part in path.parent.glob(f"{glob.escape(_part_prefix(path))}*.part{glob.escape(path.suffix)}"):
        part.unlink(missing_ok=True)


def _part_prefix(path: Path) -> str:
    """How the names of temporary files begin: short enough for any file system, and this path's alone."""
    start = os.fsencode(path.stem)[:100].decode("utf-8", "ignore")
    return f".{start}.{hashlib.sha256(os.fsencode(path.name)).hexdigest()[:12]}."


def _settle(part: Path, path: Path) -> None:
    """Force a finished file to the disk and rename it."""
    with part.open("rb") as file:
        os.fsync(file.fileno())
    part.replace(path)
