"""The quick reading of an AMC text in which all frames look like the first: the same words in the same lines.

Nothing here reports a fault. A text that is not proven to be alike is left to the reading line by line, which does.
"""

import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mocapclean.arrays import Ints
from mocapclean.formats.text import is_plain

FRAME_LINE = re.compile(rb"(?:\A|[\r\n])[ \t\x0b\x0c]*(\d+)[ \t\x0b\x0c]*(?=[\r\n]|\Z)")
"""A line that holds a whole number alone: a frame begins."""
LINE_ENDS_TO_SPACES = bytes.maketrans(b"\r\n", b"  ")
SPACE, LINE_FEED, RETURN = b" \n\r"
CHUNK_BYTES = 1 << 20
"""Bytes of one search for words, so that its masks stay in a processor's cache. Chosen by hand; a quarter of it takes
the same time."""
CHUNK_FRAMES = 1024
"""Frames of one comparison of names, for the same reason."""
MOST_DIGITS = 9
"""Digits of a frame number that is read; Python refuses to convert very long ones, and no take has more frames."""


@dataclass(frozen=True, kw_only=True)
class Alike:
    """Frames that are alike.

    names: the first words of a frame's lines after its number. widths: the numbers after each. starts: (F,) bytes at
    which the frames begin. first_frame: the number of the first. rows: the frames' texts, each in one line, all of as
    many words.
    """

    names: list[bytes]
    widths: list[int]
    starts: Ints
    first_frame: int
    rows: list[bytes]


def frames_alike(text: bytes) -> Alike | None:
    """Return the frames of a text without comments, or None where any two differ in more than their numbers."""
    first = FRAME_LINE.search(text)
    if not first or text[: first.start(1)][-1:] not in (b"", b"\r", b"\n"):
        return None
    begin, second = first.start(1), FRAME_LINE.search(text, first.end())
    block = text[begin : _end(text)]
    lines = [line.split() for line in text[begin : second.start() if second else None].splitlines() if line.strip()]
    names, widths = [words[0] for words in lines[1:]], [len(words) - 1 for words in lines[1:]]
    n_words = sum(map(len, lines))
    words = _word_starts(block)
    if not names or 0 in widths or len(words) % n_words or not is_plain(block):
        return None
    words = words.reshape(-1, n_words)
    # The columns of the first words of lines: the frame's number, and the names. All others are numbers.
    leads = np.cumsum([0, 1, *(width + 1 for width in widths)])[:-1]
    if not (_begin_all_lines(block, words[:, leads]) and _spell(block, words[:, leads[1:]], names)):
        return None
    first_frame = _consecutive(block, words[:, :2])
    if first_frame is None:
        return None
    flat, bounds = block.translate(LINE_ENDS_TO_SPACES), [*words[:, 0].tolist(), len(block)]
    rows = [flat[start:stop] for start, stop in pairwise(bounds)]
    return Alike(names=names, widths=widths, starts=words[:, 0] + begin, first_frame=first_frame, rows=rows)


def _end(text: bytes) -> int:
    """Return the number of bytes of a text without white space at its end; the text has a word."""
    end = len(text)
    while text[end - 1 : end].isspace():
        end -= 1
    return end


def _word_starts(block: bytes) -> Ints:
    """Return the bytes at which the words of a text begin; its first byte begins one."""
    codes = np.frombuffer(block, np.uint8)
    starts = [np.zeros(1, dtype=np.intp)]
    for at in range(0, len(codes) - 1, CHUNK_BYTES):
        inside = codes[at : at + CHUNK_BYTES + 1] > SPACE
        starts.append(np.flatnonzero(inside[1:] > inside[:-1]) + at + 1)
    return np.concatenate(starts)


def _begin_all_lines(block: bytes, leads: Ints) -> bool:
    """Whether the words at these bytes (F, n) begin the lines, and no other line is there, not even a blank one."""
    codes = np.frombuffer(block, np.uint8)
    before = codes[leads.reshape(-1)[1:] - 1]
    if not (before == LINE_FEED).all():
        return False
    n_lines, returns = 1, b"\r" in block
    for at in range(0, len(codes), CHUNK_BYTES):
        feeds = codes[at : at + CHUNK_BYTES + 1] == LINE_FEED
        n_lines += int(np.count_nonzero(feeds[:CHUNK_BYTES]))
        # A carriage return counts as a line of its own unless a line feed follows.
        if returns and ((codes[at : at + CHUNK_BYTES + 1][:-1] == RETURN) & ~feeds[1:]).any():
            return False
    return n_lines == leads.size


def _spell(block: bytes, starts: Ints, names: list[bytes]) -> bool:
    """Whether the words at these bytes (F, n) are the names, each followed by white space."""
    codes = np.frombuffer(block, np.uint8)
    letters = np.frombuffer(b" ".join([*names, b""]), np.uint8)
    within = np.concatenate([np.arange(len(name) + 1) for name in names])
    owner = np.repeat(np.arange(len(names)), [len(name) + 1 for name in names])
    for at in range(0, len(starts), CHUNK_FRAMES):
        found = codes[starts[at : at + CHUNK_FRAMES, owner] + within]
        if not ((found == letters) | ((letters == SPACE) & (found < SPACE))).all():
            return False
    return True


def _consecutive(block: bytes, bounds: Ints) -> int | None:
    """Return the first of the frame numbers between these bytes (F, 2), or None unless they are consecutive."""
    words = [block[start:stop].strip() for start, stop in bounds.tolist()]
    if not all(word.isdigit() and len(word) <= MOST_DIGITS for word in words):
        return None
    first = int(words[0])
    return first if list(map(int, words)) == list(range(first, first + len(words))) else None
