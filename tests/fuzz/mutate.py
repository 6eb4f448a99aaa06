"""Faults in capture files; a fault depends on the random generator alone."""

import random
import re
import struct
from collections.abc import Callable, Sequence

NUMBERS = (b"nan", b"inf", b"-inf", b"1e999", b"-1e308", b"1e-320", b"0", b"-0", b"99999999999999999999", b"-1", b"")
NUMBERS += (b"0x10", b"1_0", b"1,5", b"--1", b"2147483648", b"-2147483649", b"65536", b"1e20", b".", b"+", b"\xd9\xa1")
NAMES = (b"", b"\xff", "走".encode(), b"x" * 300, b"ROOT", b"end")
MARKS = (b"", b",", b";", b"\t", b",,,,", b'"', b"{", b"}", b"{" * 2000, b"\r", b"\n\n", b"#", b":", b"\0", b"(")
WORDS = (0, 1, 2, 3, 127, 128, 255, 256, 32767, 32768, 65534, 65535)
DOUBLES = (float("nan"), float("inf"), -float("inf"), 1e38, -1e38, 1e-45, 0.0, -0.0, 1e20, 3e38)

Mutator = Callable[[random.Random, bytearray, Sequence[bytes]], None]


def mutate(rng: random.Random, content: bytes, others: Sequence[bytes], text: bool) -> bytes:
    """Return a file with one to eight faults; others: files from which bytes and lines are spliced in."""
    mutated = bytearray(content)
    mutators = TEXT if text else BINARY
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        rng.choice(mutators)(rng, mutated, others)
    return bytes(mutated)


def _place(rng: random.Random, content: bytearray) -> int:
    """Return a byte, most often near the front, where a file declares its content."""
    most = rng.choice((64, 512, 2048, len(content), len(content)))
    return rng.randrange(max(1, min(most, len(content))))


def _bit(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content)
    content[at : at + 1] = bytes([(content[at] if content else 0) ^ 1 << rng.randrange(8)])


def _byte(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content)
    content[at : at + 1] = bytes([rng.choice((0, 1, 2, 80, 84, 127, 128, 254, 255, rng.randrange(256)))])


def _word(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content) & ~1
    content[at : at + 2] = struct.pack(rng.choice("<>") + "H", rng.choice((*WORDS, rng.randrange(65536))))


def _float(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content) & ~3
    content[at : at + 4] = struct.pack(rng.choice("<>") + "f", rng.choice(DOUBLES))


def _cut(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    del content[rng.choice((_place(rng, content), rng.randrange(len(content) + 1))) :]


def _remove(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content)
    del content[at : at + rng.choice((1, 2, 4, 16, 512, 4096))]


def _repeat(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content)
    piece = content[at : at + rng.choice((1, 2, 4, 64, 512))]
    content[at:at] = piece * rng.choice((1, 2, 50))


def _splice(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    other = rng.choice(others)
    size = rng.choice((16, 512, 4096))
    at, start = _place(rng, content), rng.randrange(max(1, len(other)))
    content[at : at + size] = other[start : start + size]


def _noise(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, content)
    size = rng.choice((1, 8, 64, 1024))
    content[at : at + size] = rng.randbytes(size)


def _number(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    _token(rng, content, rb"[-+0-9.eE]+", rng.choice(NUMBERS))


def _name(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    words = re.findall(rb"[A-Za-z:_]\w*", bytes(content[:4096])) or [b"x"]
    _token(rng, content, rb"[A-Za-z:_]\w*", rng.choice((*words, *NAMES)))


def _mark(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    _token(rng, content, rb"[{}()#:,;\t\"]|\r?\n", rng.choice(MARKS))


def _line(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    lines = bytes(content).splitlines(keepends=True) or [b""]
    at = rng.randrange(min(len(lines), rng.choice((10, 100, len(lines)))))
    other = bytes(rng.choice((*others, bytes(content)))).splitlines(keepends=True) or [b""]
    lines[at : at + rng.choice((0, 1, 1, 5))] = [[], [lines[at]] * 2, [rng.choice(other)]][rng.randrange(3)]
    content[:] = b"".join(lines)


def _encode(rng: random.Random, content: bytearray, others: Sequence[bytes]) -> None:
    text = bytes(content)
    encodings = (
        lambda: b"\xef\xbb\xbf" + text,
        lambda: text.replace(b"\n", b"\r\n"),
        lambda: text.replace(b"\n", b"\r"),
        lambda: text.decode("latin-1").encode("utf-16"),
        lambda: text.replace(b" ", b"\t"),
        lambda: text.upper(),
        lambda: text.replace(b".", b","),
        lambda: text.replace(b",", b";"),
        lambda: text.replace(b"\t", b","),
    )
    content[:] = rng.choice(encodings)()


def _token(rng: random.Random, content: bytearray, pattern: bytes, new: bytes) -> None:
    start = _place(rng, content)
    match = re.compile(pattern).search(bytes(content), start)
    if match:
        content[match.start() : match.end()] = new


BINARY: tuple[Mutator, ...] = (_bit, _byte, _word, _word, _float, _cut, _remove, _repeat, _splice, _noise)
TEXT: tuple[Mutator, ...] = (_number, _number, _name, _mark, _line, _line, _encode, _cut, _remove, _repeat, _splice)
