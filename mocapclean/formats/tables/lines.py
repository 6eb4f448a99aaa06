"""The lines of a table of text and the cells in a line, by their bytes."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import accumulate
from pathlib import Path

from mocapclean.errors import FormatError
from mocapclean.formats.text import BYTE_ORDER_MARK, TOKEN, load

WIDE_CODECS = {b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
"""Codecs of two bytes a character, by the byte order mark with which their texts begin (Unicode, chapter 23.8)."""
DELIMITERS = (b"\t", b";", b",")
"""Delimiters in the order in which they are looked for: a comma can also be a decimal mark."""
JAPANESE_LEADS = bytes(range(0x81, 0xA0))
"""First bytes of kana and common kanji in Shift-JIS (JIS X 0208); in Latin-1 they are control characters."""


@dataclass(frozen=True, kw_only=True)
class Lines:
    """A text as lines.

    lines: with their ends. first: bytes of the byte order mark before line 0. codec: of a text of two bytes a
    character, whose lines are here in UTF-8; None for any other text, whose lines are as in the file.
    """

    lines: Sequence[bytes] = field(repr=False)
    first: int = 0
    codec: str | None = None

    def encoded(self, text: bytes) -> bytes:
        """Return the bytes of a file for a text of lines."""
        return text if self.codec is None else text.decode("utf-8").encode(self.codec)


def load_lines(path: Path) -> Lines:
    """Return the lines of a file; raise FormatError if it is blank or no text."""
    raw = load(path)
    codec = WIDE_CODECS.get(raw[:2])
    text = raw
    if codec:
        try:
            text = raw.decode(codec).encode("utf-8")
        except UnicodeError:
            raise FormatError(path, "the text must be UTF-16, as its first two bytes state. Got other bytes.") from None
    if b"\0" in text:
        raise FormatError(path, "the file must be text. Got a NUL.", byte=raw.index(b"\0"))
    first = len(BYTE_ORDER_MARK) if text.startswith(BYTE_ORDER_MARK) else 0
    return Lines(lines=text[first:].splitlines(keepends=True), first=first, codec=codec)


def first_lines(head: bytes) -> list[bytes]:
    """Return the lines in the first bytes of a file, without blank ones; none where they are no text."""
    codec = WIDE_CODECS.get(head[:2])
    if codec:
        head = head.decode(codec, errors="ignore").encode("utf-8")
    if b"\0" in head:
        return []
    return [line for line in head.removeprefix(BYTE_ORDER_MARK).splitlines() if not is_blank(line)]


def is_blank(line: bytes) -> bool:
    """Whether a line has no characters but delimiters, quotation marks and white space."""
    return not line.strip(b' \t\r\n,;"')


def delimiter_of(line: bytes) -> bytes | None:
    """Return the delimiter of a line's cells; None where white space separates them."""
    return next((mark for mark in DELIMITERS if mark in line), None)


def cells(line: bytes, delimiter: bytes | None) -> list[bytes]:
    """Return the cells of a line, without the space and the quotation marks around them."""
    body = line.rstrip(b"\r\n")
    if delimiter is None:
        return body.split()
    if b'"' not in body:
        return [cell.strip(b" ") for cell in body.split(delimiter)]
    spans = (_content(body, start, stop) for start, stop in _quoted_cells(body, delimiter))
    return [body[start:stop] for start, stop in spans]


def raw_cells(line: bytes, delimiter: bytes | None) -> list[bytes]:
    """Return the cells of a line, quickly: with the space around them, where no cell is in quotation marks."""
    if b'"' in line:
        return cells(line, delimiter)
    return line.split() if delimiter is None else line.rstrip(b"\r\n").split(delimiter)


def spans_at(line: bytes, delimiter: bytes | None, places: Sequence[int]) -> list[tuple[int, int]]:
    """Return where the cells of a line at some places begin and end, without the space and quotation marks around."""
    body = line.rstrip(b"\r\n")
    if delimiter is None:
        words = [match.span() for match in TOKEN.finditer(body)]
        return [words[place] for place in places]
    if b'"' in body:
        whole = list(_quoted_cells(body, delimiter))
        return [_content(body, *whole[place]) for place in places]
    stops = list(accumulate(len(cell) + 1 for cell in body.split(delimiter)))
    return [_content(body, stops[place - 1] if place else 0, stops[place] - 1) for place in places]


def names_of(texts: Sequence[bytes]) -> list[str]:
    """Return texts as names, in the encoding that all of them show: UTF-8, Shift-JIS or Latin-1."""
    together = b"\n".join(texts)
    for codec in ("utf-8", "cp932" if any(byte in together for byte in JAPANESE_LEADS) else "latin-1"):
        try:
            together.decode(codec)
        except UnicodeDecodeError:
            continue
        return [text.decode(codec) for text in texts]
    return [text.decode("latin-1") for text in texts]


@lru_cache
def _quoted_cell(delimiter: bytes) -> re.Pattern[bytes]:
    """Return the pattern of a cell in which quotation marks may hide the delimiter."""
    return re.compile(rb'(?:"[^"]*"|[^%b])*' % re.escape(delimiter))


def _quoted_cells(body: bytes, delimiter: bytes) -> Iterator[tuple[int, int]]:
    """Yield where each cell of a line begins and ends, of which some are in quotation marks."""
    pattern, at = _quoted_cell(delimiter), 0
    while at <= len(body):
        match = pattern.match(body, at)
        assert match is not None  # it also matches an empty cell
        yield match.span()
        at = match.end() + 1


def _content(body: bytes, start: int, stop: int) -> tuple[int, int]:
    """Return where the content of a cell is, without space and quotation marks; the whole cell where it is blank."""
    cell = body[start:stop]
    left, right = len(cell) - len(cell.lstrip(b' "')), len(cell) - len(cell.rstrip(b' "'))
    if left == len(cell):
        inside = cell.find(b'"') + 1  # between the quotation marks of an empty cell
        return (start + inside, start + inside) if inside else (start, stop)
    return start + left, stop - right
