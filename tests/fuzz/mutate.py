"""Capture files made wrong, each by its seed alone."""

import random
import re
import struct
from collections.abc import Callable, Sequence

NUMBERS = (b"nan", b"inf", b"-inf", b"1e999", b"-1e308", b"1e-320", b"0", b"-0", b"99999999999999999999", b"-1", b"")
NUMBERS += (b"0x10", b"1_0", b"1,5", b"--1", b"2147483648", b"-2147483649", b"65536", b"1e20", b".", b"+", b"\xd9\xa1")
NAMES = (b"", b"\xff", "走".encode(), b"x" * 300, b"ROOT", b"end")
MARKS = (b"", b"{", b"}", b"{" * 2000, b"\r", b"\n\n", b"#", b":", b"\0", b"(")
WORDS = (0, 1, 2, 3, 127, 128, 255, 256, 32767, 32768, 65534, 65535)
DOUBLES = (float("nan"), float("inf"), -float("inf"), 1e38, -1e38, 1e-45, 0.0, -0.0, 1e20, 3e38)

Mutator = Callable[[random.Random, bytearray, Sequence[bytes]], None]


def mutate(rng: random.Random, content: bytes, others: Sequence[bytes], text: bool) -> bytes:
    """One to eight faults in a file; others: files that pieces are taken from."""
    found = bytearray(content)
    mutators = TEXT if text else BINARY
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        rng.choice(mutators)(rng, found, others)
    return bytes(found)


def _place(rng: random.Random, found: bytearray) -> int:
    """A place, most often near the front, where a file says what it holds."""
    most = rng.choice((64, 512, 2048, len(found), len(found)))
    return rng.randrange(max(1, min(most, len(found))))


def _bit(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found)
    found[at : at + 1] = bytes([(found[at] if found else 0) ^ 1 << rng.randrange(8)])


def _byte(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found)
    found[at : at + 1] = bytes([rng.choice((0, 1, 2, 80, 84, 127, 128, 254, 255, rng.randrange(256)))])


def _word(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found) & ~1
    found[at : at + 2] = struct.pack(rng.choice("<>") + "H", rng.choice((*WORDS, rng.randrange(65536))))


def _float(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found) & ~3
    found[at : at + 4] = struct.pack(rng.choice("<>") + "f", rng.choice(DOUBLES))


def _cut(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    del found[rng.choice((_place(rng, found), rng.randrange(len(found) + 1))) :]


def _remove(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found)
    del found[at : at + rng.choice((1, 2, 4, 16, 512, 4096))]


def _repeat(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found)
    piece = found[at : at + rng.choice((1, 2, 4, 64, 512))]
    found[at:at] = piece * rng.choice((1, 2, 50))


def _splice(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    other = rng.choice(others)
    size = rng.choice((16, 512, 4096))
    at, start = _place(rng, found), rng.randrange(max(1, len(other)))
    found[at : at + size] = other[start : start + size]


def _noise(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    at = _place(rng, found)
    size = rng.choice((1, 8, 64, 1024))
    found[at : at + size] = rng.randbytes(size)


def _number(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    _token(rng, found, rb"[-+0-9.eE]+", rng.choice(NUMBERS))


def _name(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    words = re.findall(rb"[A-Za-z:_]\w*", bytes(found[:4096])) or [b"x"]
    _token(rng, found, rb"[A-Za-z:_]\w*", rng.choice((*words, *NAMES)))


def _mark(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    _token(rng, found, rb"[{}()#:]|\r?\n", rng.choice(MARKS))


def _line(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    lines = bytes(found).splitlines(keepends=True) or [b""]
    at = rng.randrange(min(len(lines), rng.choice((10, 100, len(lines)))))
    other = bytes(rng.choice((*others, bytes(found)))).splitlines(keepends=True) or [b""]
    lines[at : at + rng.choice((0, 1, 1, 5))] = [[], [lines[at]] * 2, [rng.choice(other)]][rng.randrange(3)]
    found[:] = b"".join(lines)


def _encode(rng: random.Random, found: bytearray, others: Sequence[bytes]) -> None:
    content = bytes(found)
    kinds = (
        lambda: b"\xef\xbb\xbf" + content,
        lambda: content.replace(b"\n", b"\r\n"),
        lambda: content.replace(b"\n", b"\r"),
        lambda: content.decode("latin-1").encode("utf-16"),
        lambda: content.replace(b" ", b"\t"),
        lambda: content.upper(),
        lambda: content.replace(b".", b","),
    )
    found[:] = rng.choice(kinds)()


def _token(rng: random.Random, found: bytearray, pattern: bytes, new: bytes) -> None:
    start = _place(rng, found)
    match = re.compile(pattern).search(bytes(found), start)
    if match:
        found[match.start() : match.end()] = new


BINARY: tuple[Mutator, ...] = (_bit, _byte, _word, _word, _float, _cut, _remove, _repeat, _splice, _noise)
TEXT: tuple[Mutator, ...] = (_number, _number, _name, _mark, _line, _line, _encode, _cut, _remove, _repeat, _splice)
