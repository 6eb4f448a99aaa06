"""C3D files written byte by byte, in all six encodings and with any fault, without a line of the package under test."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

INTEL, DEC, MIPS = 84, 85, 86
ENCODINGS = [(machine, is_float) for machine in (INTEL, DEC, MIPS) for is_float in (True, False)]
ENCODING_IDS = [f"{name}-{kind}" for name in ("intel", "dec", "mips") for kind in ("float", "int")]

Parameter = tuple[str, str, int, tuple[int, ...], bytes]


def floats(values: Any, machine: int) -> bytes:
    """IEEE singles, big-endian for MIPS; for DEC multiplied by four and with their 16-bit halves swapped."""
    if machine == DEC:
        return (np.asarray(values) * 4).astype("<f4").view("<u2").reshape(-1, 2)[:, ::-1].tobytes()
    return np.asarray(values).astype(">f4" if machine == MIPS else "<f4").tobytes()


def shorts(values: Any, machine: int) -> bytes:
    return np.asarray(values).astype(np.int64).astype(">i2" if machine == MIPS else "<i2").tobytes()


def texts(group: str, name: str, labels: Sequence[str | bytes], width: int = 0) -> Parameter:
    rows = [label.encode() if isinstance(label, str) else label for label in labels]
    width = width or max(map(len, rows), default=0)
    return group, name, -1, (width, len(rows)), b"".join(row.ljust(width) for row in rows)


@dataclass
class C3D:
    """A file to be: ``points`` (F, P, 4) as stored numbers (x, y, z, residual), ``analog`` (F, A) words per frame.

    ``extra`` replaces or adds parameters, None drops one; ``link`` turns a record's length into its next-pointer.
    """

    points: Any
    machine: int = INTEL
    is_float: bool = True
    labels: Sequence[str | bytes] | None = None
    scale: float = 0.1
    units: str | None = "mm"
    rate: float = 100.0
    first_frame: int = 1
    last_frame: int | None = None
    analog: Any = None
    extra: dict[str, Parameter | None] = field(default_factory=dict)
    pointer: int = 2
    link: bool = True
    tail: bytes = b""

    def parameters(self) -> list[Parameter]:
        n_points = self.points.shape[1]
        labels = [f"M{i}" for i in range(1, n_points + 1)] if self.labels is None else list(self.labels)
        signed = -self.scale if self.is_float else self.scale
        found = {
            "USED": ("POINT", "USED", 2, (), shorts([n_points], self.machine)),
            "SCALE": ("POINT", "SCALE", 4, (), floats([signed], self.machine)),
            "RATE": ("POINT", "RATE", 4, (), floats([self.rate], self.machine)),
            "LABELS": texts("POINT", "LABELS", labels[:255]),
        }
        if self.units is not None:
            found["UNITS"] = texts("POINT", "UNITS", [self.units])
        for start in range(255, len(labels), 255):
            name = f"LABELS{start // 255 + 1}"
            found[name] = texts("POINT", name, labels[start : start + 255])
        return [entry for entry in {**found, **self.extra}.values() if entry is not None]

    def section(self) -> bytes:
        entries = self.parameters()
        groups = {group: number for number, group in enumerate(dict.fromkeys(e[0] for e in entries), start=1)}
        order = ">" if self.machine == MIPS else "<"
        records = [(group, -number, b"\0") for group, number in groups.items()]
        for group, name, kind, dims, data in entries:
            body = struct.pack("bB", kind, len(dims)) + bytes(dims) + data + b"\0"
            records.append((name, groups[group], body))
        packed = b""
        for place, (name, number, body) in enumerate(records):
            step = 2 + len(body) if self.link and place < len(records) - 1 else 0
            packed += struct.pack("bb", len(name), number) + name.encode() + struct.pack(f"{order}h", step) + body
        packed = bytes([1, 0x50, (len(packed) + 4 + 511) // 512 % 256, self.machine]) + packed
        return packed.ljust(-(-len(packed) // 512) * 512, b"\0")

    def data_start(self) -> int:
        """The byte of the first frame."""
        return 512 + len(self.section())

    def build(self) -> bytes:
        n_frames, n_points = self.points.shape[:2]
        analog = np.zeros((n_frames, 0)) if self.analog is None else self.analog
        last = self.first_frame + n_frames - 1 if self.last_frame is None else self.last_frame
        section = self.section()
        signed = -self.scale if self.is_float else self.scale
        order = ">" if self.machine == MIPS else "<"
        header = bytes([self.pointer, 0x50])
        header += struct.pack(f"{order}5H", n_points, analog.shape[1], self.first_frame & 0xFFFF, min(last, 65535), 10)
        header += floats([signed], self.machine) + struct.pack(f"{order}HH", 2 + len(section) // 512, 1)
        header += floats([self.rate], self.machine)
        frames = np.concatenate([self.points.reshape(n_frames, 4 * n_points), analog], axis=1)
        data = (floats if self.is_float else shorts)(frames.ravel(), self.machine)
        data = data.ljust(-(-len(data) // 512) * 512, b"\0")
        return header.ljust(512, b"\0") + section + data + self.tail


def walk(n_frames: int = 40, n_points: int = 5, seed: int = 7) -> np.ndarray:
    """Stored numbers (F, P, 4) that every encoding holds exactly: whole numbers below 10000, residual 3."""
    rng = np.random.default_rng(seed)
    points = np.full((n_frames, n_points, 4), 3.0)
    points[..., :3] = rng.integers(1, 9999, (n_frames, n_points, 3)) * rng.choice([-1, 1], (n_frames, n_points, 3))
    return points
