"""How a C3D file stores a number: three machines, 32-bit floats or 16-bit integers.

Sources: the C3D file format user guide (Motion Lab Systems, 2008, c3d.org), chapters on the parameter section and
on 3D data; Digital Equipment Corporation, VAX Architecture Reference Manual (1987) for the F_floating word, which
is an IEEE single with its 16-bit halves swapped and an exponent bias larger by two.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats

Raw = NDArray[Any]

INTEL, DEC, MIPS = 84, 85, 86
MACHINES = (INTEL, DEC, MIPS)
EXPONENT = np.uint32(0x7F800000)
SIGN = np.uint32(0x80000000)
HALF = np.uint32(16)


@dataclass(frozen=True, kw_only=True)
class Words:
    """One of the six encodings of a number, between the raw words of a file and native numbers."""

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
            return 32767.0
        return float(np.finfo(np.float32).max) / (4.0 if self.machine == DEC else 1.0)

    def decode(self, raw: Raw) -> NDArray[Any]:
        """Native float32 or int16 numbers of raw words; a reserved DEC operand is NaN, a dirty DEC zero is 0.

        DEC words of the highest exponent (above 8e37) are read as infinite or NaN, which is what careless
        converters meant by them.
        """
        native = raw.astype(raw.dtype.newbyteorder("="), copy=False)
        if not self.is_float:
            return native.view(np.int16)
        return _from_dec(native) if self.machine == DEC else native.view(np.float32)

    def encode(self, numbers: Floats) -> Raw:
        """Raw words of numbers within ``limit``, rounded to the nearest that the word can hold."""
        if not self.is_float:
            return np.rint(numbers).astype(np.int16).view(np.uint16).astype(self.raw)
        if self.machine == DEC:
            return _to_dec(numbers).astype(self.raw)
        return numbers.astype(np.float32).view(np.uint32).astype(self.raw)


def _from_dec(words: NDArray[np.uint32]) -> NDArray[np.float32]:
    swapped = (words << HALF) | (words >> HALF)
    with np.errstate(invalid="ignore"):
        values = swapped.view(np.float32) * np.float32(0.25)
    odd = ((swapped & EXPONENT) == 0) & (swapped != 0)
    if odd.any():
        values[odd] = np.where(swapped[odd] & SIGN, np.float32(np.nan), np.float32(0.0))
    return values


def _to_dec(numbers: Floats) -> NDArray[np.uint32]:
    words = (numbers * 4.0).astype(np.float32).view(np.uint32)
    words = np.where((words & EXPONENT) == 0, np.uint32(0), words)
    return (words << HALF) | (words >> HALF)


def present(samples: NDArray[Any]) -> Bools:
    """Which samples (..., 4) of x, y, z and residual word hold a position.

    Makers write "missing" in three ways: a negative residual word, exactly 0, 0, 0, or a coordinate that is
    not finite.
    """
    x, y, z, residual = (samples[..., i] for i in range(4))
    found: Bools = (x != 0) | (y != 0) | (z != 0)
    found &= ~(residual < 0)
    if samples.dtype.kind == "f":
        for coordinate in (x, y, z):
            found &= np.isfinite(coordinate)
    return found
