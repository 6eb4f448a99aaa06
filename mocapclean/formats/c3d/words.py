"""How a C3D file stores a number: three machines, 32-bit floats or 16-bit integers.

Sources: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapters on the parameter section and
on 3D data; Digital Equipment Corporation, VAX Architecture Reference Manual (1987) for the F_floating word, which
is an IEEE single with its 16-bit halves swapped, of four times the value.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats

Raw = NDArray[Any]

INTEL = 84
"""Processor type of little-endian IEEE numbers (C3D user guide, chapter on the parameter section)."""
DEC = 85
"""Processor type of little-endian integers and VAX F_floating numbers."""
MIPS = 86
"""Processor type of big-endian IEEE numbers (SGI)."""
MACHINES = (INTEL, DEC, MIPS)

EXPONENT_BITS = np.uint32(0x7F800000)
"""The eight exponent bits of an IEEE 754 single, and of an F_floating word with its halves swapped."""
SIGN_BIT = np.uint32(0x80000000)  # the sign bit of both kinds of word
HALF_WORD = np.uint32(16)
"""Bits of a half of a 32-bit word, which the VAX stores in the other order."""
VAX_FACTOR = 4.0
"""An F_floating word with its halves swapped is an IEEE single of four times the value: its exponent bias is larger by
one, and its fraction is 0.1m instead of 1.m."""
LARGEST_INTEGER = 32767.0
"""The largest magnitude of a 16-bit integer that has a negative of the same size."""


@dataclass(frozen=True, kw_only=True)
class Words:
    """The encoding of the numbers of a file: that of one of three machines, floats or integers."""

    machine: int
    is_float: bool

    @property
    def raw(self) -> np.dtype[Any]:
        """The unsigned integer of a word's width and byte order."""
        return np.dtype((">" if self.machine == MIPS else "<") + ("u4" if self.is_float else "u2"))

    @property
    def limit(self) -> float:
        """The largest magnitude that a word holds."""
        if not self.is_float:
            return LARGEST_INTEGER
        return float(np.finfo(np.float32).max) / (VAX_FACTOR if self.machine == DEC else 1.0)

    def decode(self, raw: Raw) -> NDArray[Any]:
        """Return the native float32 or int16 numbers of raw words.

        A reserved operand of the VAX (exponent 0, sign 1) is NaN, a dirty zero (exponent 0, sign 0) is 0. VAX words of
        the highest exponent (above 8e37) are read as infinite or NaN: converters that only swap halves and add to the
        exponent make them of those IEEE values.
        """
        native = raw.astype(raw.dtype.newbyteorder("="), copy=False)
        if not self.is_float:
            return native.view(np.int16)
        return _from_dec(native) if self.machine == DEC else native.view(np.float32)

    def encode(self, numbers: Floats) -> Raw:
        """Return the raw words of numbers within ``limit``, rounded to the nearest that a word can hold."""
        if not self.is_float:
            return np.rint(numbers).astype(np.int16).view(np.uint16).astype(self.raw)
        if self.machine == DEC:
            return _to_dec(numbers).astype(self.raw)
        return numbers.astype(np.float32).view(np.uint32).astype(self.raw)


def _from_dec(words: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Return the numbers of F_floating words: halves swapped, read as IEEE, divided by four."""
    swapped = (words << HALF_WORD) | (words >> HALF_WORD)
    with np.errstate(invalid="ignore"):
        values = swapped.view(np.float32) * np.float32(1.0 / VAX_FACTOR)
    # Exponent 0 is no subnormal number on a VAX: with sign a reserved operand, without it zero whatever the fraction.
    special = ((swapped & EXPONENT_BITS) == 0) & (swapped != 0)
    if special.any():
        values[special] = np.where(swapped[special] & SIGN_BIT, np.float32(np.nan), np.float32(0.0))
    return values


def _to_dec(numbers: Floats) -> NDArray[np.uint32]:
    """Return the F_floating words of numbers; those too small for a normal IEEE single become zero."""
    words = (numbers * VAX_FACTOR).astype(np.float32).view(np.uint32)
    words = np.where((words & EXPONENT_BITS) == 0, np.uint32(0), words)
    return (words << HALF_WORD) | (words >> HALF_WORD)


def present(samples: NDArray[Any]) -> Bools:
    """Return which samples (..., 4) of x, y, z and residual word hold a position.

    Three marks of a missing sample are in use: a negative residual word, exactly 0, 0, 0, and a coordinate that is
    not finite.
    """
    return located(samples) & ~(samples[..., 3] < 0)


def located(samples: NDArray[Any]) -> Bools:
    """Return which samples (..., 4) have coordinates, whatever the residual is: finite and not 0, 0, 0."""
    x, y, z = (samples[..., i] for i in range(3))
    holds: Bools = (x != 0) | (y != 0) | (z != 0)
    if samples.dtype.kind == "f":
        for coordinate in (x, y, z):
            holds &= np.isfinite(coordinate)
    return holds
