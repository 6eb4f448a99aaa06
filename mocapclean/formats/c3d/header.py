"""The header and the parameter section of a C3D file.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapters on the header and on the
parameter section. No count and no pointer is used before it is checked against the bytes of the file.
"""

import math
import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mocapclean.errors import FormatError
from mocapclean.formats.c3d.words import MACHINES, MIPS, Words

BLOCK = 512
"""Bytes of a block: the unit of the pointers in the header."""
MAGIC = 0x50
"""Byte 1 of every C3D file."""
MOST_COUNT = 65535
"""The largest count that the header's 16 bits hold."""
MOST_HEAD = 512 * BLOCK
"""Bytes that are read for the header and the parameters, twice the 256 blocks to which one byte can point."""
MOST_SECTION_START = 256 * BLOCK
"""The byte before which a parameter section without a valid pointer is searched: one byte points to 255 blocks."""
SEARCHED_SECTION = 32 * BLOCK
"""Bytes of a candidate section in which POINT:USED is searched. Chosen by hand: POINT is among the first groups."""
RELATIVE_TOLERANCE = 1e-5
"""Two stored values agree if they differ by no more: some single-precision roundings (6e-8 each). Chosen by hand."""

# Bytes of the header (C3D user guide, chapter on the header).
COUNTS_BYTE = 2
"""Four 16-bit words: points, analog words per frame, first frame, last frame."""
FRAMES_BYTE = 6
"""The numbers of the first and the last frame, among the counts."""
SCALE_BYTE = 12
DATA_BLOCK_BYTE = 16
RATE_BYTE = 20

# Bytes of the parameter section (C3D user guide, chapter on the parameter section).
BLOCKS_BYTE = 2
"""The number of blocks of the section."""
MACHINE_BYTE = 3
RECORDS_BYTE = 4
"""The first group or parameter."""

TEXT_KIND = -1  # element type of text (C3D user guide, parameter format)
FLOAT_KIND = 4  # element type of 32-bit floats (C3D user guide, parameter format)
NUMBER_KINDS = (1, 2, FLOAT_KIND)
"""Bytes per element of a parameter of numbers: bytes, integers, floats."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """Where a parameter's data are.

    kind: -1 text, 1 byte, 2 integer, 4 float. dims: sizes of the dimensions, the fastest first. start: byte in the
    section.
    """

    kind: int
    dims: bytes
    start: int

    @property
    def stop(self) -> int:
        """The byte after the data."""
        return self.start + abs(self.kind) * math.prod(self.dims)


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The parameters by name, "GROUP:NAME" in upper case; the first of two equal names counts."""

    section: bytes = field(repr=False)
    machine: int
    entries: dict[str, Parameter]

    def strings(self, name: str) -> list[str]:
        """Return the texts of a parameter without their padding; none if it is absent or no text."""
        entry = self.entries.get(name)
        if entry is None or entry.kind != TEXT_KIND or 0 in entry.dims:
            return []
        width = entry.dims[0] if entry.dims else 1
        text = self.section[entry.start : entry.stop]
        return [_decode(text[at : at + width]) for at in range(0, len(text), width)]

    def labels(self, name: str) -> list[str]:
        """Return the texts of POINT:NAME and its continuations POINT:NAME2, POINT:NAME3, ..., which hold 255 each."""
        texts = self.strings(f"POINT:{name}")
        number = 2
        while f"POINT:{name}{number}" in self.entries:
            texts += self.strings(f"POINT:{name}{number}")
            number += 1
        return texts

    def numbers(self, name: str) -> list[float]:
        """Return the numbers of a parameter, integers as unsigned; none if it is absent or a text."""
        entry = self.entries.get(name)
        if entry is None or entry.kind not in NUMBER_KINDS:
            return []
        data = self.section[entry.start : entry.stop]
        data = data[: len(data) // entry.kind * entry.kind]
        if entry.kind == FLOAT_KIND:
            words = Words(machine=self.machine, is_float=True)
            return [float(x) for x in words.decode(np.frombuffer(data, words.raw))]
        order = ">" if self.machine == MIPS else "<"
        return [float(x) for x in np.frombuffer(data, f"{order}u{entry.kind}")]


@dataclass(frozen=True, kw_only=True)
class Header:
    """The values of the header, and where everything is.

    size: bytes of the whole file. head: its first bytes, at most 256 KiB. n_analog: analog words per frame.
    n_subframes: samples of an analog channel per frame. scale: negative for float data, else units per integer step.
    section, section_stop: the bytes from which and up to which the parameters are. data_block: the number of the block
    of the first frame, from 1. Nothing here is checked but the section: ``layout`` compares it with the parameters.
    """

    machine: int
    n_points: int
    n_analog: int
    n_subframes: int
    first_frame: int
    last_frame: int
    scale: float
    section: int
    section_stop: int
    data_block: int
    rate: float
    parameters: Parameters
    size: int
    head: bytes = field(repr=False)

    def has_room_at(self, start: int) -> bool:
        """Whether frames can start at a byte: in the file, not in its header and not where the parameters start."""
        return BLOCK <= start < self.size and start != self.section


def read_header(path: Path) -> Header:
    """Return the header and parameters of a file.

    Raises FormatError, with the byte, when it is no C3D file or when the parameters cannot be found in it.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(MOST_HEAD)
    if len(head) < BLOCK or head[1] != MAGIC:
        got = f"a file of {size} bytes" if len(head) < BLOCK else f"{head[1]:#04x}"
        raise FormatError(path, f"byte 1 of a C3D file's 512-byte header must be {MAGIC:#04x}. Got {got}.", byte=1)
    start = _find_section(path, head)
    machine = head[start + MACHINE_BYTE]
    order = ">" if machine == MIPS else "<"
    n_points, n_analog, first, last = struct.unpack_from(f"{order}4H", head, COUNTS_BYTE)
    data_block, n_subframes = struct.unpack_from(f"{order}2H", head, DATA_BLOCK_BYTE)
    words = Words(machine=machine, is_float=True)
    scale, rate = (float(words.decode(np.frombuffer(head, words.raw, 1, at))[0]) for at in (SCALE_BYTE, RATE_BYTE))
    # The section has two ends, that of its own count of blocks, which is one byte, and where the data start.
    stop = start + max(head[start + BLOCKS_BYTE], 1) * BLOCK
    data_start = (data_block - 1) * BLOCK
    is_longer = stop < data_start < size
    return Header(
        machine=machine,
        n_points=n_points,
        n_analog=n_analog,
        n_subframes=n_subframes,
        first_frame=first,
        last_frame=last,
        scale=scale,
        section=start,
        section_stop=stop,
        data_block=data_block,
        rate=rate,
        parameters=_parse(head[start : data_start if is_longer else stop], machine),
        size=size,
        head=head,
    )


def _find_section(path: Path, head: bytes) -> int:
    """Return the byte where the parameter section starts: the header's pointer or else the first block that fits."""
    claimed = (head[0] - 1) * BLOCK
    if claimed >= BLOCK and _machine(head, claimed) in MACHINES:
        return claimed
    for start in range(BLOCK, min(len(head), MOST_SECTION_START), BLOCK):
        machine = _machine(head, start)
        if machine in MACHINES and "POINT:USED" in _parse(head[start : start + SEARCHED_SECTION], machine).entries:
            return start
    raise FormatError(
        path,
        "the header's pointer to the parameter section must lead to one with processor 84, 85 or 86. "
        f"Got block {head[0]} with {_machine(head, claimed) if claimed >= 0 else 'nothing'}.",
        byte=0,
    )


def _machine(head: bytes, start: int) -> int:
    """Return the processor type of a parameter section at a byte, 0 beyond the end."""
    return head[start + MACHINE_BYTE] if start + MACHINE_BYTE < len(head) else 0


def _parse(section: bytes, machine: int) -> Parameters:
    """Return the parameters of a section: walk the chain of records, always forward, until it ends or leaves it.

    A record is: length of its name (negative if locked), group number (negative for a group itself), name, 16-bit step
    to the next record from there, and for a parameter its kind, its number of dimensions, their sizes and its data. A
    description follows. A parameter may come before its group.
    """
    order = ">" if machine == MIPS else "<"
    groups: dict[int, str] = {}
    listed: list[tuple[int, str, Parameter]] = []
    at = RECORDS_BYTE
    while 0 <= at <= len(section) - 5:
        length, group = struct.unpack_from("bb", section, at)
        pointer = at + 2 + abs(length)
        if length == 0 or pointer + 4 > len(section):
            break
        name = _decode(section[at + 2 : pointer]).upper()
        (step,) = struct.unpack_from(f"{order}h", section, pointer)
        stop = pointer + 2
        if group < 0:
            groups.setdefault(-group, name)
        else:
            kind, n_dims = struct.unpack_from("bB", section, pointer + 2)
            start = pointer + 4 + n_dims
            entry = Parameter(kind=kind, dims=section[pointer + 4 : start], start=start)
            listed.append((group, name, entry))
            stop = start if step > 0 else entry.stop
        at = pointer + step if step > 0 else _unlinked(section, stop)
    entries: dict[str, Parameter] = {}
    for group, name, entry in listed:
        if group in groups:
            entries.setdefault(f"{groups[group]}:{name}", entry)
    return Parameters(section=section, machine=machine, entries=entries)


def _unlinked(section: bytes, stop: int) -> int:
    """Return the byte of a record that follows a description at ``stop`` although no step leads to it, or -1."""
    at = stop + 1 + section[stop] if stop < len(section) else len(section)
    name = section[at + 2 : at + 2 + abs(struct.unpack_from("b", section, at)[0])] if at < len(section) else b""
    return at if name.replace(b"_", b"").isalnum() else -1


def halves(number: int) -> list[int]:
    """Return a count as two 16-bit halves, the low half first, as TRIAL:ACTUAL_START_FIELD holds it."""
    return [number % (MOST_COUNT + 1), number // (MOST_COUNT + 1)]


def _decode(text: bytes) -> str:
    """Return text up to a NUL without padding, in UTF-8 if it is valid there, else in Latin-1."""
    text = text.split(b"\0")[0].strip()
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")
