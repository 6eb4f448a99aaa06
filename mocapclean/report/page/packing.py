"""Arrays as compact text in a page: whole steps, differences over time, deflated, in base64."""

import base64
import json
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats

MILLIMETRE_STEP = 0.01
"""mm, the step of positions and bars in a page; chosen by hand, below the noise of any camera system."""
DEGREE_STEP = 0.001
"""Degrees, the step of joint angles in a page; chosen by hand, for the same reason."""
_LEVEL = 4  # of zlib; chosen by hand: level 6 takes twice the time for 3 % less
_MOST = 2**31 - 1  # the largest 32-bit integer


class Packer:
    """A header of JSON values and blocks of bytes, which become one text."""

    def __init__(self) -> None:
        self._blocks: list[bytes] = []
        self._offset = 0
        self._arrays: dict[str, dict[str, Any]] = {}

    def add_codes(self, name: str, codes: NDArray[np.uint8]) -> None:
        """Add small numbers (F, M) as bytes, marker by marker."""
        self._add(name, np.ascontiguousarray(codes.T).tobytes(), kind="bytes", shape=codes.T.shape)

    def add_series(self, name: str, values: Floats, step: float) -> None:
        """Add series (F, K) in whole steps: series by series, as second differences over time.

        A value that is not finite repeats the one before it; another array must hold which ones are known.
        """
        columns = np.ascontiguousarray(_held(values).T)
        whole = _whole(columns, step)
        # 32-bit differences wrap around, and so do the sums that undo them.
        twice = np.diff(np.diff(whole, axis=1, prepend=np.int32(0)), axis=1, prepend=np.int32(0))
        self._add(name, _planes(twice), kind="series", shape=whole.shape, step=step)

    def add_numbers(self, name: str, values: NDArray[Any], step: float) -> None:
        """Add any finite numbers in whole steps, in their order, as first differences."""
        whole = _whole(np.ravel(values), step)
        self._add(name, _planes(np.diff(whole, prepend=np.int32(0))), kind="numbers", shape=whole.shape, step=step)

    def text(self, header: Mapping[str, Any]) -> str:
        """Return the header and all arrays as base64 of a zlib stream; its alphabet needs no escape in any page."""
        head = json.dumps({**header, "arrays": self._arrays}, allow_nan=False).encode()
        packer = zlib.compressobj(_LEVEL)
        parts = [packer.compress(part) for part in (len(head).to_bytes(4, "little"), head, *self._blocks)]
        return base64.b64encode(b"".join([*parts, packer.flush()])).decode()

    def _add(self, name: str, block: bytes, **description: Any) -> None:
        self._arrays[name] = {"offset": self._offset, **description}
        self._blocks.append(block)
        self._offset += len(block)


def _whole(values: NDArray[Any], step: float) -> NDArray[np.int32]:
    """Return values in whole steps, limited to 32 bits."""
    return np.clip(np.rint(values / step), -_MOST, _MOST).astype(np.int32)


def _planes(whole: NDArray[np.int32]) -> bytes:
    """Return the bytes of integers, all lowest ones first: the others are nearly constant and deflate to nothing.

    Zigzag codes, 0, -1, 1, -2, ... as 0, 1, 2, 3, ..., keep the upper bytes of small negative numbers zero.
    """
    zigzag = (whole << 1) ^ (whole >> 31)
    return np.ascontiguousarray(zigzag.astype("<i4").reshape(-1, 1).view(np.uint8).T).tobytes()


def _held(values: Floats) -> Floats:
    """Return series (F, K) with the last finite value, or the first one, in place of those that are not finite."""
    finite: Bools = np.isfinite(values)
    if finite.all():
        return values
    frames = np.arange(len(values))[:, None]
    last = np.maximum.accumulate(np.where(finite, frames, -1), axis=0)
    first = np.where(finite.any(axis=0), finite.argmax(axis=0), -1)
    place = np.where(last >= 0, last, first)
    held = np.take_along_axis(values, np.maximum(place, 0), axis=0)
    return np.where(place >= 0, held, 0.0)
