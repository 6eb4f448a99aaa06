"""Capture files: one module per format, one literal registry, one function to read and one to write.

A format is a module here and an entry in ``DECLARATIONS``, its facts. The module keeps the contract of
``formats.contract``: the functions ``sniff``, ``read``, ``write``, ``prove`` and ``create``. It is imported when a file
of the format comes up.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import cast

from mocapclean import logs
from mocapclean.errors import FormatError, UsageError
from mocapclean.files import check_output, new_file
from mocapclean.formats.contract import Declaration, EventFormat, Format, PointFormat
from mocapclean.formats.declarations import ASF_SUFFIX, DECLARATIONS
from mocapclean.formats.skeleton_files import find_skeleton, new_skeleton_path
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.registry import Modules
from mocapclean.take import Event, ReadOptions, Take, require_take

FORMATS: Modules[Format] = Modules(__name__, DECLARATIONS)

SNIFFED_BYTES = 1 << 16
"""Bytes of a file that ``sniff`` is given: enough for a line of some thousand names and the titles below it."""


def suffixes() -> tuple[str, ...]:
    """Return the lower-case suffixes of all formats."""
    return tuple(dict.fromkeys(suffix for facts in DECLARATIONS.values() for suffix in facts.suffixes))


def formats_with(path: Path) -> list[str]:
    """Return the names of the formats that a path's suffix stands for; raise FormatError for any other suffix."""
    suffix = path.suffix.lower()
    found = [name for name, facts in DECLARATIONS.items() if suffix in facts.suffixes]
    if found:
        return found
    for facts in DECLARATIONS.values():
        if suffix == facts.skeleton_suffix:
            take = facts.suffixes[0]
            raise FormatError(
                path, f"an {suffix} file is a skeleton, not a take. Give the {take} file that goes with it."
            )
    known = ", ".join(suffixes())
    raise FormatError(path, f"the file name must end in one of {known}. Got {path.suffix or 'no suffix'!r}.")


def format_of(path: Path, given: str | None = None) -> str:
    """Return the name of the format of a file: the given one, else by its suffix and, of several, by its content.

    Raises FormatError for a suffix of no format, and for a content of none; UsageError for a given name of none.
    """
    if given is not None:
        return _known(given)
    names = formats_with(path)
    if len(names) == 1:
        return names[0]
    head = _head(path)
    found = [name for name in names if FORMATS[name].sniff(head)]
    if not found:
        kinds = ", ".join(names)
        raise FormatError(path, f"the content must be a take of one of the formats {kinds}; name one with --format.")
    return found[0]


def _known(name: str) -> str:
    """Return the name of a format; raise UsageError if there is none of this name."""
    if name not in DECLARATIONS:
        raise UsageError(f"the format must be one of {', '.join(DECLARATIONS)}. Got {name!r}.")
    return name


def is_take(path: Path) -> bool:
    """Whether a file can be a take, by its suffix and, where this has several formats, by its content."""
    try:
        format_of(path)
    except FormatError:
        return False
    return True


def declaration(path: Path, given: str | None = None) -> Declaration:
    """Return the declaration of the format of a file; raise FormatError for a file of no format."""
    return DECLARATIONS[format_of(path, given)]


def needs_skeleton(path: Path, given: str | None = None) -> bool:
    """Whether the skeleton of a take is in a file of its own, which reading the take needs."""
    return declaration(path, given).skeleton_suffix is not None


def lists_points(path: Path, given: str | None = None) -> bool:
    """Whether a file may hold points that are no markers, which ``read`` takes as such when they are named."""
    return declaration(path, given).lists_points


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
    format: str | None = None,
) -> Take:
    """Return the take of a capture file.

    format: the name of its format, where suffix and content do not tell it.
    skeleton: the .asf of an .amc, where it is not in its folder. rate: frames per second, for files that do not
    state it. unit: millimetres per unit of length, for BVH, and for markers in place of the unit that the file states.
    points: points that are not markers, to be read as such. Raises FormatError with the place of the fault;
    UsageError for points that the file does not have.
    """
    path = Path(path)
    name = format_of(path, format)
    module = FORMATS[name]
    options = ReadOptions(skeleton=Path(skeleton) if skeleton else None, rate=rate, unit=unit, points=tuple(points))
    if not module.sniff(_head(path)):
        raise FormatError(path, f"the content is not {name.upper()}.", byte=0)
    try:
        with logs.timed("read", file=path, format=name) as values:
            take = module.read(path, options)
            values |= {"frames": len(take), "markers": len(take.markers), "rate": take.rate}
            values["missing"] = int((~take.trusted).sum())
            return take
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None


def _head(path: Path) -> bytes:
    """Return the first bytes of a file; raise FormatError if it is empty or cannot be read."""
    try:
        with path.open("rb") as file:
            head = file.read(SNIFFED_BYTES)
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None
    if not head:
        raise FormatError(path, "the file is empty.")
    return head


def carried(take: Take) -> tuple[str, ...]:
    """Return the names of the points of a take's file that are no markers of it and are carried along untouched."""
    if take.origin is None or not DECLARATIONS[take.origin.format].lists_points:
        return ()
    names: tuple[str, ...] = take.origin.document.carried
    return names


def events(take: Take) -> tuple[Event, ...]:
    """Return the events that a take's file states, such as foot strikes."""
    if take.origin is None or not DECLARATIONS[take.origin.format].states_events:
        return ()
    return cast(EventFormat, FORMATS[take.origin.format]).events(take)


def not_carried(take: Take, name: str) -> tuple[str, ...]:
    """Return what a new file of a format does not have of a take and of the file that it was read from, in words."""
    facts = DECLARATIONS[name]
    origin = take.origin
    if origin is None or origin.format == name:
        return ()
    lost = []
    if facts.stores == "positions" and DECLARATIONS[origin.format].stores == "poses":
        lost.append("joint angles and the tree of joints")
    if names := carried(take):
        lost.append(f"points that are no markers: {len(names)} (--markers NAME converts one)")
    if not facts.states_events and (happened := events(take)):
        lost.append(f"events: {len(happened)}")
    lost += origin.document.others
    if facts.lowest_frame is not None and take.first_frame < facts.lowest_frame:
        lost.append(f"frame numbers from {take.first_frame} on: the first frame is {facts.lowest_frame}")
    if facts.precision and facts.precision != DECLARATIONS[origin.format].precision:
        lost.append(f"digits of coordinates beyond {facts.precision}")
    return tuple(lost)


def outdated(take: Take) -> tuple[str, ...]:
    """Return those of the carried points that may have been computed from a marker that is changed in the take."""
    if not carried(take) or take.origin is None:
        return ()
    return cast(PointFormat, FORMATS[take.origin.format]).outdated(take)


def read_skeleton(path: Path, unit: float | None = None) -> Skeleton:
    """Return the joints and bones of an .asf or a .bvh file; unit: millimetres per unit of length, for BVH."""
    suffix = path.suffix.lower()
    try:
        # Imported where they are read: few takes come with a skeleton of another format.
        if suffix == ASF_SUFFIX:
            from mocapclean.formats import asf

            return asf.read_skeleton(path)
        if suffix in DECLARATIONS["bvh"].suffixes:
            from mocapclean.formats import bvh

            return bvh.read_skeleton(path, unit)
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None
    raise UsageError(f"{path}: a skeleton must be an .asf or a .bvh file.")


def write(
    take: Take, path: Path | str, *, format: str | None = None, invalidate: bool = False, overwrite: bool = False
) -> Take:
    """Write a take to a new file, complete and proven, or not at all; return the take as the file holds it.

    A take that was read from this format becomes a copy of its own file in which only the changed samples differ. Any
    other take becomes a new file: from its positions (C3D, tables), or from its poses (BVH; AMC with an .asf beside it,
    named by what comes before the first ``_``).
    format: the name of the format of the file; else that of the take's own file where the suffixes are the same, else
    the first that the suffix stands for.
    invalidate: mark samples missing, where the format has a mark, that are neither trusted nor filled. Raises
    UsageError when ``path`` is the take's own file, when it exists and ``overwrite`` is false, and when the format
    cannot express the take; FormatError when the file cannot be written.
    """
    require_take(take, "write")
    path = Path(path)
    name = _known(format) if format else _format_to_write(take, path)
    check_output(path, take.origin.path if take.origin else None, overwrite)
    with logs.timed("written", file=path, format=name, changed=int(take.changed.sum())):
        if take.origin and take.origin.format == name:
            return _write_copy(name, take, path, invalidate)
        return _write_new(name, take, path, overwrite)


def _format_to_write(take: Take, path: Path) -> str:
    """Return the name of the format in which a take is written to a path."""
    origin = take.origin
    if origin and (path.suffix.lower() in (origin.path.suffix.lower(), *DECLARATIONS[origin.format].suffixes)):
        return origin.format
    return formats_with(path)[0]


def _write_copy(name: str, take: Take, path: Path, invalidate: bool) -> Take:
    """Write and prove a copy of the take's own file."""
    module = FORMATS[name]
    assert take.origin is not None
    with new_file(path) as part:
        written = module.write(take, part, invalidate=invalidate)
        module.prove(written, part)
        return written


def _write_new(name: str, take: Take, path: Path, overwrite: bool) -> Take:
    """Create a new file, with a new skeleton file where the format needs one."""
    facts = DECLARATIONS[name]
    with ExitStack() as stack:
        part = stack.enter_context(new_file(path))
        try:
            if facts.states_events:
                cast(EventFormat, FORMATS[name]).create(take, part, events(take))
            else:
                FORMATS[name].create(take, part)
        except UsageError as unfit:
            raise UsageError(f"{path}: {unfit}") from None
        if facts.skeleton_suffix:
            _create_skeleton(take, new_skeleton_path(path, facts.skeleton_suffix), overwrite, stack)
        return take


def _create_skeleton(take: Take, path: Path, overwrite: bool, stack: ExitStack) -> None:
    """Write the skeleton file of a new take, unless it is there with the same content.

    ``stack`` gives it its name just before the take gets its own. Raises UsageError if another content is there.
    """
    from mocapclean.formats import asf  # only new AMC files come with a skeleton file

    assert take.skeleton is not None
    content = asf.text(take.skeleton).encode()
    if path.is_file() and path.read_bytes() == content:
        return
    check_output(path, None, overwrite)
    stack.enter_context(new_file(path)).write_bytes(content)
