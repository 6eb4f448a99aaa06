"""Processor seconds to read, write and repair BVH and AMC takes, and their ratios to a plain parse of the same numbers.

python benchmarks/read_text.py [FILE ...] [--frames N]. Each file, else the figure's walk of the sample data, is
repeated back and forth to N frames, else to 72,000: ten minutes at 120 Hz. The plain parse is NumPy's of the words of
the motion, ``np.array(words.split(), dtype=float)``. Of an AMC the names were taken out before, so that the parse has
numbers alone. Reading is all of ``formats.read``, forward kinematics included. Writing is all of ``formats.write``, the
proof included. The repair has ten gaps of a second in ten joints, filled with their own positions; joint angles are
fitted. Each time is the best of five.
"""

import argparse
import re
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean import formats
from mocapclean.formats.skeleton_files import find_skeleton
from mocapclean.take import Take

SAMPLES = Path(__file__).resolve().parents[1] / "sample_data"
FILES = (SAMPLES / "walk_truth.bvh", SAMPLES / "walk_01_truth.amc")
FRAMES = 72_000
RUNS = 5
GAPS, GAP_FRAMES = 10, 120


def best(work: Callable[[], Any]) -> float:
    seconds = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        seconds.append(time.process_time() - start)
    return min(seconds)


def back_and_forth(rows: list[bytes], n_frames: int) -> list[bytes]:
    return list(islice(cycle([*rows, *rows[::-1]]), n_frames))


def long_bvh(path: Path, n_frames: int, folder: Path) -> tuple[Path, bytes]:
    """Return a BVH of that many frames, and the text of its numbers."""
    head, time_line, motion = re.split(rb"(Frame Time:.*\n)", path.read_bytes(), maxsplit=1)
    rows = b"".join(back_and_forth([row for row in motion.splitlines(keepends=True) if row.strip()], n_frames))
    long = folder / "long.bvh"
    long.write_bytes(re.sub(rb"Frames:\s*\d+", b"Frames: %d" % n_frames, head) + time_line + rows)
    return long, rows


def long_amc(path: Path, n_frames: int, folder: Path) -> tuple[Path, bytes]:
    """Return an AMC of that many frames, its skeleton beside it, and the text of its numbers."""
    head, *blocks = re.split(rb"(?m)^\d+\r?\n", path.read_bytes())
    bodies = back_and_forth(blocks, n_frames)
    long = folder / "long.amc"
    long.write_bytes(head + b"".join(b"%d\n%b" % (number, body) for number, body in enumerate(bodies, start=1)))
    (folder / "long.asf").write_bytes(find_skeleton(path, ".asf").read_bytes())
    return long, re.sub(rb"(?m)^[A-Za-z]\S*", b"", b"".join(bodies))


def repaired(take: Take) -> Take:
    """Return a take with gaps in ten joints, filled with their own positions."""
    filled = np.zeros_like(take.filled)
    for gap, start in enumerate(np.linspace(0, len(filled) - GAP_FRAMES, GAPS).astype(int)):
        filled[start : start + GAP_FRAMES, -1 - gap] = True
    return replace(take, filled=filled)


def main(paths: list[Path], n_frames: int) -> None:
    print(
        f"{'file':36} {'MB':>4} {'plain':>6} {'read':>11} {'write':>11} {'repair':>11} {'read, write':>11} "
        f"{'read, repair':>12}"
    )
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for path in paths:
            long, words = (long_bvh if path.suffix == ".bvh" else long_amc)(path, n_frames, folder)
            out = long.with_name(f"out{long.suffix}")
            take = formats.read(long)
            gaps = repaired(take)
            plain = best(lambda w=words: np.array(w.split(), dtype=float))
            read = best(lambda p=long: formats.read(p))
            write = best(lambda t=take, o=out: formats.write(t, o, overwrite=True))
            repair = best(lambda t=gaps, o=out: formats.write(t, o, overwrite=True))
            times = (read, write, repair, read + write, read + repair)
            ratios = " ".join(f"{seconds:5.2f}{seconds / plain:5.1f}x" for seconds in times)
            print(f"{path.name[:36]:36} {long.stat().st_size / 1e6:4.0f} {plain:6.2f} {ratios}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, default=FILES)
    parser.add_argument("--frames", type=int, default=FRAMES)
    arguments = parser.parse_args()
    main(list(arguments.files), arguments.frames)
