"""The numbers in the cells of a table: read, and spelled in the style of the file."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.errors import FormatError
from mocapclean.formats.text import LARGEST_NUMBER, NUMBER, is_missing, quote

MISSING_CELLS = frozenset({b"", b"null", b"none", b"na", b"n/a", b"-", b"--"})
"""What stands in a cell, in lower case, for a missing number, beside the words for NaN and infinity. Programs of makers
leave it empty or let the user choose such a word (manual of Qualisys Track Manager, TSV export)."""
MOST_DECIMALS = 12
"""Decimals beyond which the file's own spelling is not followed: float64 millimetres hold no more. Chosen by hand."""
SIGNIFICANT = range(5, 8)
"""Significant digits to which numbers without trailing zeros may be rounded: C's %g has 6, float32 7."""
EXPONENT = re.compile(rb"e", re.IGNORECASE)


@dataclass(frozen=True)
class NumberStyle:
    """How a file spells numbers.

    kind: "fixed" decimals; "trimmed", the same without trailing zeros; so many "significant" digits; or with an
    "exponent". digits: decimals or significant digits. comma: whether the decimal mark is a comma.
    """

    kind: Literal["fixed", "trimmed", "significant", "exponent"]
    digits: int
    comma: bool = False

    def spell(self, value: float) -> bytes:
        """Return a number as the file would have it."""
        if self.kind == "significant":
            text = f"{value:.{self.digits}g}"
            text = text if "e" not in text else f"{value:.{self.digits}f}"
        elif self.kind == "exponent":
            text = f"{value:.{self.digits}e}"
        else:
            text = f"{value:.{self.digits}f}"
        if self.kind == "trimmed" and "." in text:
            text = text.rstrip("0").rstrip(".")
        if float(text) == 0:
            text = text.removeprefix("-")
        return (text.replace(".", ",") if self.comma else text).encode()

    def value(self, spelled: bytes) -> float:
        """Return the number that a spelling stands for."""
        return float(spelled.replace(b",", b".") if self.comma else spelled)


def style_of(tokens: Iterable[bytes], comma: bool) -> NumberStyle:
    """Return the style of the numbers among some cells, with a point as decimal mark; six decimals where none is."""
    found = [token for token in (cell.strip(b' "') for cell in tokens) if NUMBER.fullmatch(token)]
    if not found:
        return NumberStyle("fixed", 6, comma)
    with_exponent = [token for token in found if EXPONENT.search(token)]
    if len(with_exponent) == len(found):
        mantissas = (EXPONENT.split(token)[0] for token in with_exponent)
        return NumberStyle("exponent", max(_decimals(token) for token in mantissas), comma)
    plain = [token for token in found if not EXPONENT.search(token)]
    decimals = [_decimals(token) for token in plain]
    most = min(max(decimals), MOST_DECIMALS)
    if min(decimals) == max(decimals):
        return NumberStyle("fixed", most, comma)
    significant = max(len(token.lstrip(b"+-0.").replace(b".", b"")) for token in plain)
    # Rounded to significant digits, larger numbers have fewer decimals.
    if significant in SIGNIFICANT and _grow_shorter(plain, decimals):
        return NumberStyle("significant", significant, comma)
    return NumberStyle("trimmed", most, comma)


def numbers(path: Path, rows: Sequence[Sequence[bytes]], lines: Sequence[int]) -> Floats:
    """Return the numbers of rows of cells (F, C), NaN for a missing one.

    lines: the rows' line numbers. Raises FormatError with the line of a cell that is neither a number nor missing, or
    is too large.
    """
    table = np.empty((len(rows), len(rows[0]) if rows else 0))
    for index, row in enumerate(rows):
        try:
            table[index] = [float(cell or b"nan") for cell in row]
        except ValueError:
            table[index] = [_value(path, cell, lines[index]) for cell in row]
    # float() also reads an infinity, and the underscore that Python allows. Such rows are read cell by cell.
    is_larger: list[bool] = np.any(np.abs(table) > LARGEST_NUMBER, axis=1).tolist()
    for index, row in enumerate(rows):
        if is_larger[index] or b"_" in b" ".join(row):
            table[index] = [_value(path, cell, lines[index]) for cell in row]
    return table


def is_number(cell: bytes) -> bool:
    """Whether a cell holds a decimal number, with a point or a comma."""
    return NUMBER.fullmatch(cell.strip(b' "').replace(b",", b".", 1)) is not None


def is_missing_cell(cell: bytes) -> bool:
    """Whether a cell stands for a missing number."""
    token = cell.strip(b' "\t')
    return token.lower() in MISSING_CELLS or is_missing(token)


def _value(path: Path, cell: bytes, line: int) -> float:
    """Return the number of a cell, NaN for a missing one; raise FormatError for another text."""
    token = cell.strip(b' "\t')
    if is_missing_cell(token):
        return np.nan
    if not NUMBER.fullmatch(token) or abs(float(token)) > LARGEST_NUMBER:
        message = f"a cell must be a decimal number of at most {LARGEST_NUMBER:g}, or missing. Got {quote(token)}."
        raise FormatError(path, message, line=line)
    return float(token)


def _decimals(token: bytes) -> int:
    """Return the number of digits after the point."""
    return len(token.partition(b".")[2])


def _grow_shorter(tokens: Sequence[bytes], decimals: Sequence[int]) -> bool:
    """Whether the most decimals of a number become fewer with every digit before the point, by about one each."""
    most: dict[int, int] = {}
    for token, count in zip(tokens, decimals, strict=True):
        whole = token.lstrip(b"+-").partition(b".")[0].lstrip(b"0")
        most[len(whole)] = max(most.get(len(whole), 0), count)
    lengths = sorted(length for length in most if length)
    return len(lengths) > 1 and len({length + most[length] for length in lengths}) == 1
