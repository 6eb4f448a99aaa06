"""Seconds to read BVH and AMC captures, to write them unchanged, and to repair them: the best of three, per file.

python benchmarks/read_text.py [FOLDER], where FOLDER has sub-folders bvh and amc. For the repair, 5 % of
one joint is filled with its own positions.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.formats import amc, bvh
from mocapclean.formats.fitting import fit_poses
from mocapclean.take import ReadOptions, Take

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data"


def best(work: Callable[[], Any]) -> float:
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def damaged(take: Take) -> Take:
    """Return a take whose last joint has 5 % filled samples in a row, with their own positions."""
    filled = np.zeros_like(take.filled)
    n_frames = len(filled)
    filled[n_frames // 2 : n_frames // 2 + max(1, n_frames // 20), -1] = True
    return replace(take, filled=filled)


def repaired(module: Any, take: Take, out: Path) -> Take:
    return module.write(fit_poses(take, take.origin.document.spelled), out)


def main(folder: Path) -> None:
    print(f"{'file':45} {'frames':>6} {'joints':>6} {'read':>7} {'copy':>7} {'repair':>7} {'prove':>7}  (s)")
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "out"
        for name, module in (("bvh", bvh), ("amc", amc)):
            for path in sorted((folder / name).glob(f"*.{name}")):
                take = module.read(path, ReadOptions())
                gap = damaged(take)
                times = [
                    best(lambda p=path, m=module: m.read(p, ReadOptions())),
                    best(lambda t=take, m=module: m.write(t, out)),
                    best(lambda t=gap, m=module: repaired(m, t, out)),
                ]
                written = repaired(module, gap, out)
                times.append(best(lambda w=written, m=module: m.prove(w, out)))
                shape = f"{len(take.positions):6} {len(take.markers):6}"
                print(f"{path.name:45} {shape} " + " ".join(f"{seconds:7.3f}" for seconds in times))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
