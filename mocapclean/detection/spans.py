"""Spans that the user distrusts, from a CSV file of marker,first,last: frame numbers of the take's file, inclusive."""

import csv
from dataclasses import dataclass, replace
from pathlib import Path

from mocapclean.detection.rule import duration
from mocapclean.errors import UsageError
from mocapclean.take import Finding, Take
from mocapclean.take.names import similar_names


@dataclass(frozen=True, kw_only=True)
class Span:
    """Frames first to last of one marker, inclusive, in the file's own numbers. ``place``: file and line of the CSV."""

    marker: str
    first: int
    last: int
    place: str


def read_spans(path: Path) -> tuple[Span, ...]:
    """Return the spans of a CSV of marker,first,last; a first line with just these words is a header.

    Raises UsageError with the line of the first fault.
    """
    spans = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            for number, row in enumerate(csv.reader(file), start=1):
                cells = [cell.strip() for cell in row]
                header = number == 1 and [cell.lower() for cell in cells] == ["marker", "first", "last"]
                if any(cells) and not header:
                    spans.append(_span(cells, f"{path}, line {number}"))
    except OSError as fault:
        raise UsageError(f"{path}: cannot be read: {fault.strerror}.") from None
    except (UnicodeDecodeError, csv.Error) as fault:
        raise UsageError(f"{path}: spans must be CSV text in UTF-8: {fault}.") from None
    return tuple(spans)


def _span(cells: list[str], place: str) -> Span:
    """Return the span of a line. Raises UsageError if it is not one."""
    try:
        marker, first, last = cells
        span = Span(marker=marker, first=int(first), last=int(last), place=place)
    except ValueError:
        raise UsageError(f"{place}: a span must be marker,first,last. Got {','.join(cells)!r}.") from None
    if span.first > span.last:
        raise UsageError(f"{place}: a span's first frame must not come after its last. Got {first}, {last}.")
    return span


def distrust(take: Take, spans: tuple[Span, ...]) -> Take:
    """Return a take in which these spans are not trusted, with a finding for each.

    Raises UsageError for a marker or a frame that the take does not have.
    """
    columns = {name: column for column, name in enumerate(take.markers)}
    first, last = take.numbers(0, len(take.trusted))
    trusted, findings = take.trusted.copy(), []
    for span in spans:
        if span.marker not in columns:
            near = similar_names(span.marker, take.markers)
            hint = f"Near: {', '.join(near)}." if near else f"It has {', '.join(take.markers[:5])}, ..."
            raise UsageError(f"{span.place}: the take has no marker {span.marker!r}. {hint}")
        if span.first < first or span.last > last:
            raise UsageError(
                f"{span.place}: frames must lie in the take's {first} to {last}. Got {span.first} to {span.last}."
            )
        start, stop = span.first - first, span.last - first + 1
        trusted[start:stop, columns[span.marker]] = False
        message = f"distrusted {duration(start, stop)} by {span.place}"
        findings.append(Finding(rule="user", marker=span.marker, frames=(start, stop), message=message))
    return replace(take, trusted=trusted, findings=(*take.findings, *findings))
