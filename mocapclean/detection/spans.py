"""Spans that the user distrusts, from a CSV file of marker,first,last: frame numbers of the take's file, inclusive.

The channels of a skeleton are named by joint, by channel (``LeftFoot.Zrotation``) or with all below (``LeftArm/*``).
"""

import csv
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.detection.rule import duration
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Finding, Take
from mocapclean.take.names import SUBTREE, matching_channels, matching_joints, similar_names
from mocapclean.take.posed import known_poses

SEPARATORS = ",;\t"
"""Characters that separate the cells of a CSV, as programs export it."""
STATED_SEPARATOR = re.compile(r'\s*"?sep=([,;\t])', re.IGNORECASE)
"""The line by which spreadsheets state the separator."""
HEADER = (
    ("marker", "joint", "name", "bone", "channel"),
    ("first", "start", "from", "begin"),
    ("last", "end", "to"),
)
"""Words of a header, in any case and with or without ``frame``: the name, the first and the last frame."""
FRAME_WORD = re.compile(r"[ _-]*frame[ _-]*")


@dataclass(frozen=True, kw_only=True)
class Span:
    """Frames first to last of one marker, inclusive, in the file's own numbers. ``place``: file and line of the CSV.

    marker: of a skeleton it is a pattern of joints or channels.
    """

    marker: str
    first: int
    last: int
    place: str


def read_spans(path: Path) -> tuple[Span, ...]:
    """Return the spans of a CSV of marker,first,last, or with semicolons or tabs in the place of commas.

    A first line with a word of ``HEADER`` in each cell is a header, and gives the order of the columns. Raises
    UsageError with the line of the first fault.
    """
    spans, order = [], (0, 1, 2)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = file.read().splitlines()
        separator = _separator(lines)
        # The line sep=; that spreadsheets write is no row.
        lines = ["" if STATED_SEPARATOR.match(line) else line for line in lines]
        first = next((number for number, line in enumerate(lines) if line.strip()), 0)
        for number, row in enumerate(csv.reader(lines, delimiter=separator)):
            cells = [cell.strip() for cell in row]
            if number == first and (named := _header(cells)):
                order = named
            elif any(cells):
                spans.append(_span(cells, order, f"{path}, line {number + 1}"))
    except OSError as fault:
        raise UsageError(f"{path}: cannot be read: {fault.strerror}.") from None
    except (UnicodeDecodeError, csv.Error) as fault:
        raise UsageError(f"{path}: spans must be CSV text in UTF-8: {fault}.") from None
    return tuple(spans)


def _separator(lines: list[str]) -> str:
    """Return the separator that lines state, else the first that divides their first line in three, else a comma."""
    line = next((line for line in lines if line.strip()), "")
    if stated := STATED_SEPARATOR.match(line):
        return stated[1]
    return next((mark for mark in SEPARATORS if len(next(csv.reader([line], delimiter=mark))) == len(HEADER)), ",")


def _header(cells: list[str]) -> tuple[int, int, int] | None:
    """Return the columns of the name, the first and the last frame in a header, or None if the cells are none."""
    words = [FRAME_WORD.sub("", cell.lower()) or cell.lower() for cell in cells]
    found = [[column for column, word in enumerate(words) if word in known] for known in HEADER]
    if len(cells) != len(HEADER) or not all(found):
        return None
    name, first, last = (columns[0] for columns in found)
    return name, first, last


def _span(cells: list[str], order: tuple[int, int, int], place: str) -> Span:
    """Return the span of a line whose cells have this order. Raises UsageError if it is not one."""
    try:
        if len(cells) != len(order):
            raise ValueError
        marker, first, last = (cells[column] for column in order)
        span = Span(marker=marker, first=int(first), last=int(last), place=place)
    except ValueError:
        raise UsageError(f"{place}: a span must be marker,first,last. Got {','.join(cells)!r}.") from None
    if span.first > span.last:
        raise UsageError(f"{place}: a span's first frame must not come after its last. Got {first}, {last}.")
    return span


def spanned_channels(spans: tuple[Span, ...], skeleton: Skeleton, n_frames: int, first_frame: int) -> Bools:
    """Return the channels (F, C) that spans name; a joint is all its channels (``names.matching_channels``).

    Raises UsageError for a name or a channel that the skeleton does not have, for joints without channels, and for
    frames outside of the take.
    """
    mask = np.zeros((n_frames, len(skeleton.channels)), dtype=bool)
    for span in spans:
        _check_frames(span, first_frame, first_frame + n_frames - 1)
        channels = matching_channels(span.marker, skeleton)
        if not channels:
            raise UsageError(f"{span.place}: {_no_channels(span.marker, skeleton)}")
        mask[span.first - first_frame : span.last - first_frame + 1, channels] = True
    return mask


def _no_channels(name: str, skeleton: Skeleton) -> str:
    """Return why a name gives no channel of a skeleton, and what would."""
    if matching_joints(name, skeleton):
        return f"joint {name!r} has no channels of its own. Name its parent, whose channels move it."
    joint, _, word = name.rpartition(".")
    if joints := matching_joints(joint, skeleton):
        owned = [channel.name for channel in skeleton.channels if channel.joint in joints]
        has = ", ".join(dict.fromkeys(owned)) or "none"
        return f"joint {joint!r} has no channel {word!r}. Its channels: {has}."
    sought = name.removesuffix(SUBTREE)
    near = similar_names(sought, skeleton.names) or similar_names(joint.removesuffix(SUBTREE), skeleton.names)
    return f"the take has no joint {name!r}. {_hint(near, skeleton.names)}"


def _hint(near: list[str], names: tuple[str, ...]) -> str:
    """Return the near names as text, or the first of all names."""
    return f"Near: {', '.join(near)}." if near else f"It has {', '.join(names[:5])}, ..."


def _check_frames(span: Span, first: int, last: int) -> None:
    """Raise UsageError unless a span lies in the take's frames, which have these numbers."""
    if span.first < first or span.last > last:
        raise UsageError(
            f"{span.place}: frames must lie in the take's {first} to {last}. Got {span.first} to {span.last}."
        )


def distrust(take: Take, spans: tuple[Span, ...]) -> Take:
    """Return a take in which these spans are not trusted, with a finding for each.

    Of a take with poses a span names channels, or joints with all their channels. Raises UsageError for a marker, a
    joint or a frame that the take does not have.
    """
    if take.poses is not None:
        return _distrust_channels(take, spans)
    columns = {name: column for column, name in enumerate(take.markers)}
    first, last = take.numbers(0, len(take.trusted))
    trusted, findings = take.trusted.copy(), []
    for span in spans:
        if span.marker not in columns:
            near = similar_names(span.marker, take.markers)
            raise UsageError(f"{span.place}: the take has no marker {span.marker!r}. {_hint(near, take.markers)}")
        _check_frames(span, first, last)
        start, stop = span.first - first, span.last - first + 1
        trusted[start:stop, columns[span.marker]] = False
        message = f"distrusted {duration(start, stop)} by {span.place}"
        findings.append(Finding(rule="user", marker=span.marker, frames=(start, stop), message=message))
    return replace(take, trusted=trusted, findings=(*take.findings, *findings))


def _distrust_channels(take: Take, spans: tuple[Span, ...]) -> Take:
    """Return a take with poses in which the channels of these spans are not trusted, a finding for each joint."""
    skeleton, poses, known = known_poses(take)
    known, findings = known.copy(), []
    for span in spans:
        mask = spanned_channels((span,), skeleton, len(poses), take.first_frame)
        known &= ~mask
        start, stop = span.first - take.first_frame, span.last - take.first_frame + 1
        channels = np.flatnonzero(mask.any(axis=0))
        findings += [
            Finding(
                rule="user",
                marker=take.markers[joint],
                frames=(start, stop),
                message=f"distrusted {duration(start, stop)} by {span.place}",
                channels=tuple(channels[take.owners[channels] == joint].tolist()),
            )
            for joint in dict.fromkeys(take.owners[channels].tolist())
        ]
    return take.with_known(known, findings=(*take.findings, *findings))
