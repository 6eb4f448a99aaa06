"""What BVH, ASF and AMC share as texts: tokens, numbers, and the errors that name a line."""

import re
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import FormatError, UsageError

LARGEST_NUMBER = 1e9
"""The largest magnitude of a number. Chosen by hand: float64 positions beyond it lose the last digits of a millimetre
in forward kinematics, and no capture comes near."""
QUOTED_CHARACTERS = 40
"""Characters of a token that an error quotes."""
BYTE_ORDER_MARK = b"\xef\xbb\xbf"

TOKEN = re.compile(rb"\S+")
NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?", re.IGNORECASE)
MISSING_SPELLINGS = (
    # C, C++, Python and JavaScript: nan, nan(ind), nan(0x8000000000000), inf, infinity; AIX adds NaNQ and NaNS.
    rb"nan(?:[qs]|\(\w*\))?|inf(?:inity)?"
    # Microsoft C before 2015: 1.#QNAN and the like, with zeros up to the digits asked for.
    rb"|1\.\#(?:[qs]nan|ind|inf)0*"
    # The same rounded as if its letters were digits, to three, two and one of them: 1.#QO, 1.#IO, 1.#R, 1.#J, 1.$.
    rb"|1\.(?:\#(?:[qs]nb|[qs]o|io|[rtj])|\$)"
)
"""Words that programs print for what is no number, without their signs."""
MISSING = re.compile(rb"[+-]?(?:%s)" % MISSING_SPELLINGS, re.IGNORECASE)
MISSING_WORD = re.compile(rb"(?<![^\s,()#])[+-]?(?:%s)(?![^\s,()#])" % MISSING_SPELLINGS, re.IGNORECASE)
"""Such a word in a text that is not blanked."""
WORD = re.compile(rb"%s|[^\s,()#]+" % MISSING_WORD.pattern, re.IGNORECASE)
"""A token of a text that is not blanked."""
COMMENT = re.compile(rb"#[^\r\n]*")
PLAIN = bytes([*range(ord("!"), ord("~") + 1), *b" \t\n\r\x0b\x0c"])
"""Characters of ASCII that print, and white space as ``bytes.split`` knows it."""
SEPARATORS_TO_SPACES = bytes.maketrans(b",()", b"   ")


def load(path: Path) -> bytes:
    """Return the bytes of a file; raise FormatError if it cannot be read or is blank."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise FormatError(path, f"the file must be readable. Got {error.strerror}.") from error
    if not raw or raw.isspace():
        raise FormatError(path, "the file must not be empty. Got no text in it.")
    return raw


def blank(raw: bytes) -> bytes:
    """Return a text of the same length with spaces for a byte order mark and for what Acclaim files ignore.

    Ignored are comments from ``#`` to the end of the line, commas and round brackets (limits of a bone stand in them).
    Brackets and ``#`` that belong to a missing number, as in ``-nan(ind)`` and ``1.#QNAN``, stay.
    """
    if not any(mark in raw for mark in (b"n(", b"N(", b".#")):
        return _blank(raw)
    # The missing numbers are hidden behind letters, and put back where no comment covers them.
    spans = [match.span() for match in MISSING_WORD.finditer(raw)]
    hidden = bytearray(raw)
    for first, stop in spans:
        hidden[first:stop] = b"x" * (stop - first)
    text = bytearray(_blank(bytes(hidden)))
    for first, stop in spans:
        if text[first : first + 1] == b"x":
            text[first:stop] = raw[first:stop]
    return bytes(text)


def _blank(raw: bytes) -> bytes:
    """Return what ``blank`` does for a text in which no missing number has a bracket or ``#``."""
    text = raw.translate(SEPARATORS_TO_SPACES) if any(mark in raw for mark in (b",", b"(", b")")) else raw
    text = b"   " + text[3:] if text.startswith(BYTE_ORDER_MARK) else text
    # Comments end at the line of the last mark; in most files that is the header.
    end = text.rfind(b"#") + 1
    rest = COMMENT.match(text, end - 1)
    end = rest.end() if rest else 0
    return COMMENT.sub(lambda match: b" " * len(match[0]), text[:end]) + text[end:] if end else text


def line_at(raw: bytes, byte: int) -> int:
    """Return the number, from 1, of the line that holds a byte."""
    return len((raw[:byte] + b".").splitlines())


def decode(text: bytes) -> str:
    """Return text in UTF-8 if it is valid there, else in Latin-1; these formats do not name their encoding."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def quote(token: bytes) -> str:
    """Return a token as errors show it."""
    text = decode(token)
    return repr(text if len(text) <= QUOTED_CHARACTERS else text[:QUOTED_CHARACTERS] + "...")


def number(path: Path, token: bytes, line: int) -> float:
    """Return the value of a number, NaN for a missing one; raise FormatError if the token is no number or too large."""
    if not is_number(token):
        message = f"a number must be decimal and at most {LARGEST_NUMBER:g}. Got {quote(token)}."
        raise FormatError(path, message, line=line)
    return value_of(token)


def is_number(token: bytes) -> bool:
    """Whether a token is a decimal number that is not too large, or a missing one."""
    if NUMBER.fullmatch(token):
        return abs(float(token)) <= LARGEST_NUMBER
    return is_missing(token)


def is_missing(token: bytes) -> bool:
    """Whether a token stands for a missing number: NaN or an infinity, in the spelling of any program."""
    return MISSING.fullmatch(token) is not None


def value_of(token: bytes) -> float:
    """Return the value of a token that is a number; NaN for a missing one."""
    return np.nan if is_missing(token) else float(token)


def numbers(path: Path, rows: Sequence[Sequence[bytes]], lines: Sequence[int]) -> Floats:
    """Return all values of rows of tokens, in one dimension; ``lines`` are the rows' line numbers.

    Raises FormatError with the line of the first token that is no number or too large.
    """
    try:
        values = np.fromiter(map(float, chain.from_iterable(rows)), dtype=np.float64)
    except ValueError:
        values = np.array([np.inf])
    # float() alone is fast and accepts almost the same tokens. Only where it met another word, an infinity, or the
    # underscore that Python allows in numbers (1_0 is ten), are the tokens checked one by one.
    if (np.abs(values) > LARGEST_NUMBER).any() or any(b"_" in token for row in rows for token in row):
        values = np.array([number(path, t, line) for row, line in zip(rows, lines, strict=True) for t in row])
    return values


def is_plain(text: bytes) -> bool:
    """Whether a text has printing characters of ASCII and white space alone, so that all readers split it alike."""
    return not text.translate(None, PLAIN)


def quick_table(rows: Sequence[bytes], columns: Sequence[int] | None = None) -> Floats | None:
    """Return the numbers of rows of plain text as a table, or None where ``numbers`` must look for a fault.

    columns: of the words that are numbers, if not all are; the rows must then have equally many words. NumPy's reader
    takes a third of the time of ``float``, gives the same values, and accepts no other spelling than ``numbers`` but
    infinities, which may be numbers that are too large.
    """
    table = _loaded(rows, columns)
    # Only a text that NumPy cannot read alone is searched for other spellings of missing numbers.
    return _loaded([MISSING_WORD.sub(b"nan", row) for row in rows], columns) if table is None else table


def _loaded(rows: Sequence[bytes], columns: Sequence[int] | None) -> Floats | None:
    """Return the numbers of rows as NumPy reads them, or None if a word is no number or a number is too large."""
    try:
        table: Floats = np.loadtxt(rows, comments=None, ndmin=2, usecols=columns)
    except ValueError:
        return None
    # NaN compares as false; only where there is one are all numbers compared one by one.
    small = table.min() >= -LARGEST_NUMBER and table.max() <= LARGEST_NUMBER
    return table if small or not (np.abs(table) > LARGEST_NUMBER).any() else None


def finite(path: Path, tokens: Sequence[bytes], count: int, what: str, line: int) -> list[float]:
    """Return exactly ``count`` finite numbers of a header; raise FormatError if there are others or more or fewer."""
    values = [number(path, token, line) for token in tokens]
    if len(values) != count or not np.isfinite(values).all():
        got = quote(b" ".join(tokens)) if tokens else "none"
        raise FormatError(path, f"{what} must be {count} finite number(s). Got {got}.", line=line)
    return values


def positive(value: float, what: str) -> float:
    """Return a value that a user gave; raise UsageError unless it is positive and finite."""
    if not 0 < value < np.inf:
        raise UsageError(f"{what} must be positive and finite. Got {value:g}.")
    return value
