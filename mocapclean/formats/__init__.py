"""Capture files: one module per format, one literal registry, one function to read and one to write.

A module of ``FORMATS`` keeps the contract of ``formats.contract``: a declaration of facts, and the functions ``sniff``,
``read``, ``write``, ``prove`` and ``create``. Whoever needs a fact about a format asks its declaration.
"""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from mocapclean.errors import FormatError, UsageError
from mocapclean.files import check_output, new_file
from mocapclean.formats import amc, asf, bvh, c3d
from mocapclean.formats.contract import Declaration, Format
from mocapclean.formats.fitting import fit_poses
from mocapclean.formats.skeleton_files import find_skeleton, new_skeleton_path
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Event, ReadOptions, Take

FORMATS: dict[str, Format] = {"c3d": c3d, "bvh": bvh, "amc": amc}

SNIFFED_BYTES = 512
"""Bytes of a file that ``sniff`` is given: one block of a C3D file."""


def suffixes() -> tuple[str, ...]:
    """Return the lower-case suffixes of all formats."""
    return tuple(suffix for module in FORMATS.values() for suffix in module.DECLARATION.suffixes)


def format_of(path: Path) -> str:
    """Return the name of the format that a path's suffix stands for; raise FormatError for any other suffix."""
    suffix = path.suffix.lower()
    for name, module in FORMATS.items():
        if suffix in module.DECLARATION.suffixes:
            return name
        if suffix == module.DECLARATION.skeleton_suffix:
            take = module.DECLARATION.suffixes[0]
            raise FormatError(
                path, f"an {suffix} file is a skeleton, not a take. Give the {take} file that goes with it."
            )
    known = ", ".join(suffixes())
    raise FormatError(path, f"the file name must end in one of {known}. Got {path.suffix or 'no suffix'!r}.")


def declaration(path: Path) -> Declaration:
    """Return the declaration of the format of a path; raise FormatError for a suffix of no format."""
    return FORMATS[format_of(path)].DECLARATION


def needs_skeleton(path: Path) -> bool:
    """Whether the skeleton of a take is in a file of its own, which reading the take needs."""
    return declaration(path).skeleton_suffix is not None


def lists_points(path: Path) -> bool:
    """Whether a file may hold points that are no markers, which ``read`` takes as such when they are named."""
    return declaration(path).lists_points


def companion(path: Path) -> Path | None:
    """Return the skeleton file beside ``path`` that reading ``path`` reads too; raise FormatError if it is missing."""
    suffix = declaration(path).skeleton_suffix
    return find_skeleton(path, suffix) if suffix else None


def read(
    path: Path | str,
    *,
    skeleton: Path | str | None = None,
    rate: float | None = None,
    unit: float | None = None,
    points: Sequence[str] = (),
) -> Take:
    """Return the take of a capture file.

    skeleton: the .asf of an .amc, where it is not in its folder. rate: frames per second, for files that do not
    state it. unit: millimetres per unit of length, for BVH, and for C3D in place of the unit that the file states.
    points: C3D points that are not markers, to be read as such. Raises FormatError with the place of the fault;
    UsageError for points that the file does not have.
    """
    path = Path(path)
    module = FORMATS[format_of(path)]
    options = ReadOptions(skeleton=Path(skeleton) if skeleton else None, rate=rate, unit=unit, points=tuple(points))
    try:
        with path.open("rb") as file:
            head = file.read(SNIFFED_BYTES)
        if not head:
            raise FormatError(path, "the file is empty.")
        if not module.sniff(head):
            raise FormatError(path, f"the content is not {path.suffix.lower()[1:].upper()}.", byte=0)
        return module.read(path, options)
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None


def carried(take: Take) -> tuple[str, ...]:
    """Return the names of the points of a take's file that are no markers of it and are carried along untouched."""
    document = take.origin.document if take.origin else None
    return document.carried if isinstance(document, c3d.C3dDocument) else ()


def events(take: Take) -> tuple[Event, ...]:
    """Return the events that a take's file states, such as foot strikes."""
    return c3d.events(take)


def outdated(take: Take) -> tuple[str, ...]:
    """Return those of the carried points that may have been computed from a marker that is changed in the take."""
    return c3d.outdated(take)


def read_skeleton(path: Path, unit: float | None = None) -> Skeleton:
    """Return the joints and bones of an .asf or a .bvh file; unit: millimetres per unit of length, for BVH."""
    readers: dict[str, Callable[[], Skeleton]] = {
        asf.SUFFIX: lambda: asf.read_skeleton(path),
        **dict.fromkeys(bvh.DECLARATION.suffixes, lambda: bvh.read_skeleton(path, unit)),
    }
    if path.suffix.lower() not in readers:
        raise UsageError(f"{path}: a skeleton must be an .asf or a .bvh file.")
    try:
        return readers[path.suffix.lower()]()
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None


def write(take: Take, path: Path | str, *, invalidate: bool = False, overwrite: bool = False) -> Take:
    """Write a take to a new file, complete and proven, or not at all; return the take as the file holds it.

    A take that was read from this format becomes a copy of its own file in which only the changed samples differ. Any
    other take becomes a new file: from its positions (C3D), or from its poses (BVH; AMC with an .asf beside it, named
    by what comes before the first ``_``). For formats of poses, joint angles are first fitted to the changed joints.
    invalidate: mark samples missing, where the format has a mark, that are neither trusted nor filled. Raises
    UsageError when ``path`` is the take's own file, when it exists and ``overwrite`` is false, and when the format
    cannot express the take; FormatError when the file cannot be written.
    """
    path = Path(path)
    name = format_of(path)
    check_output(path, take.origin.path if take.origin else None, overwrite)
    module = FORMATS[name]
    if take.origin and take.origin.format == name:
        return _write_copy(module, take, path, invalidate)
    return _write_new(module, take, path, overwrite)


def _write_copy(module: Format, take: Take, path: Path, invalidate: bool) -> Take:
    """Fit, write and prove a copy of the take's own file."""
    assert take.origin is not None
    with new_file(path) as part:
        if module.DECLARATION.stores == "poses":
            take = fit_poses(take, take.origin.document.spelled)
        written = module.write(take, part, invalidate=invalidate)
        module.prove(written, part)
        return written


def _write_new(module: Format, take: Take, path: Path, overwrite: bool) -> Take:
    """Fit, and create a new file, with a new skeleton file where the format needs one."""
    with ExitStack() as stack:
        part = stack.enter_context(new_file(path))
        try:
            if module.DECLARATION.stores == "poses":
                take = fit_poses(take)
            module.create(take, part)
        except UsageError as unfit:
            raise UsageError(f"{path}: {unfit}") from None
        if module.DECLARATION.skeleton_suffix:
            _create_skeleton(take, new_skeleton_path(path, module.DECLARATION.skeleton_suffix), overwrite, stack)
        return take


def _create_skeleton(take: Take, path: Path, overwrite: bool, stack: ExitStack) -> None:
    """Write the skeleton file of a new take, unless it is there with the same content.

    ``stack`` gives it its name just before the take gets its own. Raises UsageError if another content is there.
    """
    assert take.skeleton is not None
    content = asf.text(take.skeleton).encode()
    if path.is_file() and path.read_bytes() == content:
        return
    check_output(path, None, overwrite)
    stack.enter_context(new_file(path)).write_bytes(content)
