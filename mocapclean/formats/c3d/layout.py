"""The layout of the point data of a C3D file: of all places that state it, those with which the frames fill the file.

The number of points, the analog words of a frame, the kind of number and the place of the data are each stated in the
header and again in the parameters; the number of frames is stated in up to four places. Every combination of these
claims is a candidate. A candidate is believed if a claimed number of frames fills the file to its last block of 512
bytes.

Source: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapters on the header, on the parameters
POINT, ANALOG and TRIAL, and on 3D data.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.errors import FormatError
from mocapclean.formats.c3d.document import RESIDUAL, WORDS_PER_POINT
from mocapclean.formats.c3d.header import (
    BLOCK,
    COUNTS_BYTE,
    DATA_BLOCK_BYTE,
    FRAMES_BYTE,
    MOST_COUNT,
    SCALE_BYTE,
    Header,
)
from mocapclean.formats.c3d.words import Words
from mocapclean.numerics.robust import median
from mocapclean.take import Finding

HEADER = "the header"
"""The name of the header as a place that states something."""
SECTION = "the parameter section"
"""The name of the parameter section as a place whose end follows from its number of blocks."""
WHOLE_RATIO = 0.05
"""The largest difference of ANALOG:RATE / POINT:RATE from a whole number: rates are rounded. Chosen by hand."""
TRIED_FRAMES = 64
"""Frames from which the roughness of a candidate is computed. Chosen by hand: enough for a median."""
ROUGHER = 3.0
"""A candidate with so many times the least roughness is not believed. Chosen by hand: frames that are read shifted
are some hundred times as rough."""
WRAP = MOST_COUNT + 1
"""Counts of 16 bits that overflowed are known up to a multiple of it."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A value that a place in the file states.

    is_guess: whether it only follows from something else that is there. is_possible: whether the file has room for it.
    """

    place: str
    value: int
    is_guess: bool = False
    is_possible: bool = True


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Where the point data are, and how many.

    n_points: points of a frame. n_analog: analog words of a frame. words: the encoding. data_start: byte of the first
    frame. n_frames: of the file. first_frame: its number. stop: the byte where the frames have to end, that of the file
    or of its rotations.
    """

    n_points: int
    n_analog: int
    words: Words
    data_start: int
    stop: int
    n_frames: int = 0
    first_frame: int = 1

    @property
    def n_words(self) -> int:
        """Words of a frame."""
        return WORDS_PER_POINT * self.n_points + self.n_analog

    @property
    def stride(self) -> int:
        """Bytes of a frame."""
        return self.n_words * self.words.raw.itemsize

    @property
    def room(self) -> tuple[int, int]:
        """The whole frames for which there are bytes, and the bytes that are left over."""
        return divmod(self.stop - self.data_start, self.stride)

    def covers(self, byte: int) -> bool:
        """Whether a byte is among those of the frames."""
        return self.data_start <= byte < self.data_start + self.n_frames * self.stride

    def is_filled_by(self, count: int) -> bool:
        """Whether so many frames fill the bytes to the last block."""
        return 0 <= self.stop - self.data_start - count * self.stride <= BLOCK


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """One property of a layout.

    name: what it is. claims: the values that places state. byte: where the header states it. spelled: a value as text.
    """

    name: str
    claims: Sequence[Claim]
    byte: int
    spelled: Callable[[int], str] = str

    @property
    def stated(self) -> list[Claim]:
        """The claims that places state."""
        return [claim for claim in self.claims if not claim.is_guess]

    @property
    def is_open(self) -> bool:
        """Whether places state different values that are possible."""
        return len({claim.value for claim in self.stated if claim.is_possible}) > 1

    @property
    def values(self) -> list[int]:
        """The distinct values that are possible, those of the header first."""
        return list(dict.fromkeys(claim.value for claim in self.claims if claim.is_possible))

    def cost(self, value: int) -> tuple[bool, int]:
        """Return what speaks against a value: whether it is a guess, and minus the number of places that state it."""
        claims = [claim for claim in self.claims if claim.value == value]
        return all(claim.is_guess for claim in claims), -len(claims)

    def sentence(self, chosen: int | None = None) -> str:
        """Return who states what, and what was chosen."""
        said = " and ".join(f"{claim.place} has {self.spelled(claim.value)}" for claim in self.stated)
        return f"{self.name}: {said}" + ("" if chosen is None else f"; {self.spelled(chosen)} was used")


@dataclass(frozen=True, kw_only=True)
class Frames:
    """The numbers of frames that places state, by place, and the numbers of the first frame.

    counts: claims above 0. is_at_limit: whether all counts are the largest that 16 bits hold. wrapped: the counts
    modulo 65536.
    """

    counts: dict[str, int]
    is_at_limit: bool
    header_first: int
    trial_first: int
    wrapped: Sequence[int]

    @property
    def stated(self) -> str:
        """The claims as text."""
        return ", ".join(f"{place} has {count}" for place, count in self.counts.items())

    def first_of(self, count: int) -> int:
        """Return the number of the first frame for a number of frames."""
        is_trial = self.counts.get("TRIAL:ACTUAL_END_FIELD") == count
        return self.trial_first if is_trial else self.header_first


def find_layout(path: Path, header: Header) -> tuple[Layout, list[Finding]]:
    """Return the layout with which the frames fill the file, and a finding where the places do not agree.

    Where all places agree and the frames do not fill the file, what is there is read and told. Raises FormatError when
    the places do not agree and no combination fills the file, when there are no points or no frames, and for a file
    that ends inside a frame before any claimed number of frames is reached.
    """
    quantities = _quantities(path, header)
    frames = _frames(header)
    candidates = list(_candidates(path, header, quantities, frames))
    if not frames.counts:
        raise FormatError(path, "a take must have frames. Got none: no place names any.", byte=FRAMES_BYTE)
    filled = [layout for layout in candidates if layout.n_frames]
    if not filled:
        unsettled = [quantity for quantity in quantities if quantity.is_open]
        if unsettled:
            _refuse(path, header, unsettled)
        if not any(claim.is_possible for claim in quantities[-1].stated):
            _refuse_start(path, header)
        layout, finding = _partly_filled(path, candidates[0], frames)
        if layout.covers(header.section):
            _refuse_over_section(path, header, layout.data_start)
        return layout, [finding]
    layout = _best(path, filled, quantities)
    return layout, _disagreement(layout, quantities, frames)


def _quantities(path: Path, header: Header) -> list[Quantity]:
    """Return the claims about the points, the analog words, the kind of number and the place of the data."""
    return [
        Quantity(name="number of points", claims=_point_claims(path, header), byte=COUNTS_BYTE),
        Quantity(name="analog words of a frame", claims=_analog_claims(header), byte=COUNTS_BYTE),
        Quantity(name="sign of the scale", claims=_kind_claims(path, header), byte=SCALE_BYTE, spelled=_spelled_sign),
        Quantity(
            name="block of the point data", claims=_start_claims(path, header), byte=DATA_BLOCK_BYTE, spelled=_block
        ),
    ]


def _point_claims(path: Path, header: Header) -> list[Claim]:
    """Return the claims about the number of points; the number of labels is a guess."""
    claims = [Claim(place=HEADER, value=header.n_points)]
    claims += [Claim(place="POINT:USED", value=value) for value in _whole(header.parameters.numbers("POINT:USED"))]
    if not any(claim.value for claim in claims):
        _refuse_without_points(path, header)
    claims.append(Claim(place="POINT:LABELS", value=len(header.parameters.labels("LABELS")), is_guess=True))
    return claims


def _refuse_without_points(path: Path, header: Header) -> NoReturn:
    """Raise FormatError that names what a file without points holds."""
    n_rotations = _whole(header.parameters.numbers("ROTATION:USED"))
    if n_rotations and n_rotations[0]:
        holds = f"rotations of {n_rotations[0]} segments and no points. Export the positions too."
    elif header.n_analog:
        holds = "only analog channels."
    else:
        holds = "none."
    raise FormatError(path, f"a take must have points. The file has {holds}", byte=COUNTS_BYTE)


def _analog_claims(header: Header) -> list[Claim]:
    """Return the claims about the analog words of a frame: channels times samples of each in a frame."""
    numbers = header.parameters.numbers
    claims = [Claim(place=HEADER, value=header.n_analog)]
    used = _whole(numbers("ANALOG:USED"))
    if not used:
        return [*claims, Claim(place="the lack of ANALOG:USED", value=0, is_guess=True)]
    rates = [*numbers("ANALOG:RATE")[:1], *(numbers("POINT:RATE")[:1] or [header.rate])]
    if used[0] == 0:
        claims.append(Claim(place="ANALOG:USED", value=0))
    elif len(rates) == 2 and all(math.isfinite(rate) and rate > 0 for rate in rates):
        ratio = rates[0] / rates[1]
        if 0 < round(ratio) <= MOST_COUNT and abs(ratio - round(ratio)) <= WHOLE_RATIO:
            claims.append(Claim(place="ANALOG:USED", value=used[0] * round(ratio)))
    return [*claims, Claim(place="ANALOG:USED", value=used[0] * max(header.n_subframes, 1), is_guess=True)]


def _spelled_sign(is_float: int) -> str:
    """Return what the sign of the scale stands for."""
    return "minus (floats)" if is_float else "plus (integers)"


def _block(start: int) -> str:
    """Return the number of the block of a byte, from 1."""
    return f"block {start // BLOCK + 1}"


def _kind_claims(path: Path, header: Header) -> list[Claim]:
    """Return the claims about the kind of number, 1 for floats: the scale is negative."""
    listed = header.parameters.numbers("POINT:SCALE")
    scales = {HEADER: header.scale, **({"POINT:SCALE": listed[0]} if listed else {})}
    usable = {place: scale for place, scale in scales.items() if math.isfinite(scale) and scale != 0}
    if not usable:
        message = f"the scale factor must be finite and not 0. Got {header.scale:g}."
        raise FormatError(path, message, byte=SCALE_BYTE)
    return [Claim(place=place, value=int(scale < 0)) for place, scale in usable.items()]


def _start_claims(path: Path, header: Header) -> list[Claim]:
    """Return the claims about the byte of the first frame; the section's end is a guess.

    Raises FormatError if none leads into the file, or if all lead into the parameters: a repair would change them.
    """
    blocks = {HEADER: [header.data_block], "POINT:DATA_START": _whole(header.parameters.numbers("POINT:DATA_START"))}
    starts = {place: (found[0] - 1) * BLOCK for place, found in blocks.items() if found}
    claims = [
        Claim(place=place, value=start, is_guess=place == SECTION, is_possible=header.has_room_at(start))
        for place, start in (starts | {SECTION: header.section_stop}).items()
    ]
    if not any(claim.is_possible for claim in claims):
        _refuse_start(path, header)
    return claims


def _refuse_start(path: Path, header: Header) -> NoReturn:
    """Raise FormatError where no place leads to the point data."""
    if header.data_block == header.section // BLOCK + 1:
        _refuse_over_section(path, header, header.section)
    raise FormatError(
        path,
        f"the header's pointer to the point data must be a block of the file ({header.size} bytes). "
        f"Got block {header.data_block}; the file may be cut off: get it again from its source.",
        byte=DATA_BLOCK_BYTE,
    )


def _refuse_over_section(path: Path, header: Header, start: int) -> NoReturn:
    """Raise FormatError for point data over the parameters."""
    message = f"the point data must not lie over the parameter section. It starts at byte {start}."
    raise FormatError(path, message, byte=header.section)


def _frames(header: Header) -> Frames:
    """Return the claims about the number of frames."""
    numbers = header.parameters.numbers
    trial_first, trial_last = (_long(numbers(f"TRIAL:ACTUAL_{end}_FIELD")) for end in ("START", "END"))
    of_header = header.last_frame - header.first_frame + 1
    counts = {
        "TRIAL:ACTUAL_END_FIELD": trial_last - trial_first + 1 if trial_last and trial_first else 0,
        "POINT:LONG_FRAMES": _long(numbers("POINT:LONG_FRAMES")),
        HEADER: of_header,
        "POINT:FRAMES": _long(numbers("POINT:FRAMES")[:1]),
    }
    counts = {place: count for place, count in counts.items() if count > 0}
    limits = {MOST_COUNT, MOST_COUNT - header.first_frame + 1}
    return Frames(
        counts=counts,
        is_at_limit=bool(counts) and set(counts.values()) <= limits,
        header_first=header.first_frame,
        trial_first=trial_first,
        wrapped=[count % WRAP for count in (of_header, *counts.values())],
    )


def _candidates(path: Path, header: Header, quantities: Sequence[Quantity], frames: Frames) -> Iterator[Layout]:
    """Yield a layout for every combination of claims, that of the header first; without frames if it is not filled."""
    rotations = _whole(header.parameters.numbers("ROTATION:DATA_START"))
    stops = [(block - 1) * BLOCK for block in rotations if 0 < (block - 1) * BLOCK < header.size]
    for n_points, n_analog, is_float, start in itertools.product(*(quantity.values for quantity in quantities)):
        if not n_points:
            continue
        words = Words(machine=header.machine, is_float=bool(is_float))
        for stop in (*(stop for stop in stops if stop > start), header.size):
            layout = Layout(n_points=n_points, n_analog=n_analog, words=words, data_start=start, stop=stop)
            count = _count(path, layout, frames)
            layout = _with_frames(layout, count, frames)
            if layout.covers(header.section):
                layout = _with_frames(layout, 0, frames)
            yield layout
            if layout.n_frames:
                break


def _with_frames(layout: Layout, count: int, frames: Frames) -> Layout:
    """Return a layout with a number of frames."""
    return replace(layout, n_frames=count, first_frame=frames.first_of(count))


def _count(path: Path, layout: Layout, frames: Frames) -> int:
    """Return the number of frames that fills a layout, 0 if there is none.

    A stated count comes first. Then 16-bit counts may have overflowed: a multiple of 65536 is added to one, or, where
    all places have the largest number of 16 bits, all bytes up to the padding with zeros are frames.
    """
    n_whole, rest = layout.room
    stated = next((count for count in frames.counts.values() if layout.is_filled_by(count)), 0)
    if n_whole <= MOST_COUNT or (stated and not frames.is_at_limit):
        return stated
    for low in frames.wrapped:
        count = low + (n_whole - low) // WRAP * WRAP
        if count > MOST_COUNT and layout.is_filled_by(count):
            return count
    return max(stated, _before_padding(path, layout)) if frames.is_at_limit and rest <= BLOCK else 0


def _before_padding(path: Path, layout: Layout) -> int:
    """Return the least number of frames after which the last block has zeros only."""
    size = layout.stop - layout.data_start
    least = -(-max(size - BLOCK, 0) // layout.stride)
    with path.open("rb") as file:
        file.seek(layout.data_start + least * layout.stride)
        end = file.read(size - least * layout.stride)
    used = len(end.rstrip(b"\0"))
    return min(least - (-used // layout.stride), layout.room[0])


def _best(path: Path, filled: Sequence[Layout], quantities: Sequence[Quantity]) -> Layout:
    """Return the layout to believe of those that the frames fill.

    In a short take several do. Frames read with a wrong stride are shifted against each other: their coordinates
    change by far more from frame to frame. What is equally smooth is decided by the number of places that state it.
    """
    if len(filled) == 1:
        return filled[0]
    roughness = [_roughness(path, layout) for layout in filled]
    limit = ROUGHER * min(roughness)

    def cost(number: int) -> tuple[int, bool, int, bool]:
        layout = filled[number]
        values = layout.n_points, layout.n_analog, int(layout.words.is_float), layout.data_start
        costs = [quantity.cost(value) for quantity, value in zip(quantities, values, strict=True)]
        slack = layout.stop - layout.data_start - layout.n_frames * layout.stride
        return sum(c[0] for c in costs), roughness[number] > limit, sum(c[1] for c in costs), slack == BLOCK

    return filled[min(range(len(filled)), key=cost)]


def _roughness(path: Path, layout: Layout) -> float:
    """Return the median change of a coordinate from one frame to the next, in stored units; 0 if nothing is known."""
    n_frames = min(layout.n_frames, TRIED_FRAMES)
    with path.open("rb") as file:
        file.seek(layout.data_start)
        data = np.frombuffer(file.read(n_frames * layout.stride), layout.words.raw)
    raw = data.reshape(n_frames, layout.n_words)[:, : WORDS_PER_POINT * layout.n_points]
    samples = layout.words.decode(np.ascontiguousarray(raw)).reshape(n_frames, layout.n_points, WORDS_PER_POINT)
    # The residuals are not asked: in frames that are read shifted they are coordinates.
    coordinates = samples[..., :RESIDUAL].astype(np.float64)
    known: Bools = np.isfinite(coordinates).all(axis=2) & (coordinates != 0).any(axis=2)
    with np.errstate(invalid="ignore"):
        changes = np.abs(np.diff(coordinates, axis=0))[known[1:] & known[:-1]]
    return median(changes) if changes.size else 0.0


def _refuse(path: Path, header: Header, unsettled: Sequence[Quantity]) -> NoReturn:
    """Raise FormatError that names the places that do not agree although no combination fills the file."""
    disagreements = "; ".join(quantity.sentence() for quantity in unsettled)
    raise FormatError(
        path,
        f"the header and the parameters must agree, or one of them must fit the {header.size} bytes of the file. "
        f"Got {disagreements}; the frames fill the file with none of them: get it again from its source.",
        byte=unsettled[0].byte,
    )


def _partly_filled(path: Path, layout: Layout, frames: Frames) -> tuple[Layout, Finding]:
    """Return the layout with the frames that are there, and what is wrong, where no stated number fills the file.

    A count beyond 16 bits makes counts within 16 bits worthless: they overflowed.
    """
    (n_whole, rest), counts = layout.room, frames.counts
    least = MOST_COUNT + 1 if max(counts.values()) > MOST_COUNT else 1
    fitting = [count for count in counts.values() if least <= count <= n_whole]
    if not fitting and n_whole == 0:
        raise FormatError(path, f"a take must have frames. Got none: {frames.stated}.", byte=FRAMES_BYTE)
    if not fitting and rest:
        raise FormatError(
            path,
            f"the file must hold all its frames. Got {n_whole} and a part of one more, while {frames.stated}; it was "
            "cut off: get it again from its source.",
            byte=layout.data_start + n_whole * layout.stride,
        )
    count = fitting[0] if fitting else n_whole
    if fitting:
        message = f"{_frame_word(count)} read; the file holds bytes for {n_whole}, and {frames.stated}"
    else:
        message = f"the file ends after frame {count} although {frames.stated}; the frames that are there were read"
    return _with_frames(layout, count, frames), Finding(rule="layout", level="warning", message=message)


def _disagreement(layout: Layout, quantities: Sequence[Quantity], frames: Frames) -> list[Finding]:
    """Return a finding that names what was chosen where the places do not agree on a layout that fills the file."""
    chosen = layout.n_points, layout.n_analog, int(layout.words.is_float), layout.data_start
    parts, level = [], "info"
    for quantity, value in zip(quantities, chosen, strict=True):
        if {claim.value for claim in quantity.stated} != {value}:
            parts.append(quantity.sentence(value))
            level = level if value == quantity.claims[0].value else "warning"
    if set(frames.counts.values()) != {layout.n_frames}:
        parts.append(f"number of frames: {frames.stated}; {layout.n_frames} was used")
    if not parts:
        return []
    message = f"header and parameters do not agree, and what fills the file was used ({', and '.join(parts)})"
    return [Finding(rule="layout", level=level, message=message)]


def _frame_word(count: int) -> str:
    """Return a number of frames with its verb."""
    return "1 frame was" if count == 1 else f"{count} frames were"


def _whole(numbers: Sequence[float]) -> list[int]:
    """Return the first number as a whole one, in a list; nothing if it is none."""
    return [int(number) for number in numbers[:1] if math.isfinite(number) and number >= 0]


def _long(numbers: list[float]) -> int:
    """Return a count that is stored as one number or as two 16-bit halves, the low half first; 0 if there is none."""
    if not numbers or not all(math.isfinite(x) and x >= 0 for x in numbers[:2]):
        return 0
    return int(numbers[0]) + ((MOST_COUNT + 1) * int(numbers[1]) if len(numbers) > 1 else 0)
