"""How the time of every method grows with the frames: 600, 1200, 2400 and 4800 frames of 13_17, defaults, one thread.

10 of 31 joints are out in every block of 60 frames. Processor time, the best of two where a run takes less than ten
seconds. Writes one line per method and length to growth.csv beside this file. ``growth`` is the time relative to that
of the shortest piece, divided by that of the frames: at most 1 where the time grows no faster than the frames; then the
same for one iteration. llc and srmmp learn from 13_18 and 13_29.

    python benchmarks/growth.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import sys
from pathlib import Path
from time import process_time

import numpy as np
from trnn2_sweep import CAPTURES, hide, read_take

from mocapclean.dictionaries.body_parts import known_parts
from mocapclean.dictionaries.training import Params, train
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

FRAMES = (600, 1200, 2400, 4800)
SHORT = 10.0
COLUMNS = ("method", "frames", "iterations", "seconds", "growth", "ms_per_iteration", "growth_per_iteration")


def measure(method, take, library):
    """Iterations and seconds."""
    params, seconds = SOLVERS[method].Params(), np.inf
    for _ in range(2):
        begin = process_time()
        solution = run_method(method, take, params, dictionary=library)
        seconds = min(seconds, process_time() - begin)
        if seconds > SHORT:
            break
    return solution.iterations, seconds


def main() -> None:
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES) / "amc"
    others = [read_take(folder / f"{name}.amc") for name in ("13_18", "13_29")]
    library = train(others, known_parts(others[0].markers), Params())
    whole = read_take(folder / "13_17.amc")
    takes = [hide(whole.crop(0, n), "60", seed=0)[0] for n in FRAMES]
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for method in SOLVERS:
            first = None
            for take in takes:
                n_frames = len(take.trusted)
                iterations, seconds = measure(method, take, library)
                each = seconds / max(iterations, 1)
                first = first or (seconds, each)
                growth = [now / then * FRAMES[0] / n_frames for now, then in zip((seconds, each), first, strict=True)]
                per_iteration = [f"{1e3 * each:.2f}", f"{growth[1]:.2f}"] if iterations else ["", ""]
                row = [method, n_frames, iterations, f"{seconds:.3f}", f"{growth[0]:.2f}", *per_iteration]
                writer.writerow(row)
                print(*row, flush=True)
            file.flush()


if __name__ == "__main__":
    main()
