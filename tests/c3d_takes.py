"""Small steps that the tests of C3D share."""

import dataclasses
from pathlib import Path

import numpy as np
from c3d_builder import C3D, INTEL, Parameter, shorts

from mocapclean.formats import c3d
from mocapclean.take import ReadOptions, Take


def store(folder: Path, file: C3D | bytes, name: str = "take.c3d") -> Path:
    path = folder / name
    path.write_bytes(file if isinstance(file, bytes) else file.build())
    return path


def load(folder: Path, file: C3D | bytes, **options: object) -> Take:
    return c3d.read(store(folder, file), ReadOptions(**options))  # type: ignore[arg-type]


def fill(take: Take, *samples: tuple[int, int], position: object = (1.0, 2.0, 3.0)) -> Take:
    positions, filled = take.positions.copy(), take.filled.copy()
    for sample in samples:
        positions[sample] = position
        filled[sample] = True
    return dataclasses.replace(take, positions=positions, filled=filled)


def rules(take: Take) -> set[str]:
    return {finding.rule for finding in take.findings}


def differing(old: bytes, new: bytes) -> np.ndarray:
    assert len(old) == len(new)
    return np.flatnonzero(np.frombuffer(old, "u1") != np.frombuffer(new, "u1"))


def trial(start: int, stop: int) -> dict[str, Parameter]:
    ends = {"START": start, "END": stop}
    return {
        end: ("TRIAL", f"ACTUAL_{end}_FIELD", 2, (2,), shorts([value % 65536, value // 65536], INTEL))
        for end, value in ends.items()
    }
