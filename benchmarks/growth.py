"""Growth of the time of every method with the frames: 600 to 4800 frames of 13_17, defaults, one thread.

10 of 31 joints are hidden in every block of 60 frames. Writes one line per method and length to growth.csv beside this
file. Seconds are processor time, the best of two for runs under ten seconds. ``growth`` is the ratio of times to the
shortest take, divided by the ratio of frames; it is at most 1 if the time grows no faster than the frames.
``growth_per_iteration`` is the same for one iteration. llc and srmmp learn from 13_18 and 13_29.

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
from mocapclean.dictionaries.training import train
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

FRAMES = (600, 1200, 2400, 4800)
REPEATED_BELOW = 10.0  # seconds; shorter runs are timed twice
COLUMNS = ("method", "frames", "iterations", "seconds", "growth", "ms_per_iteration", "growth_per_iteration")


def measure(method, take, library):
    """Return the iterations and the seconds of a method."""
    params, seconds = SOLVERS[method].Params(), np.inf
    for _ in range(2):
        begin = process_time()
        solution = run_method(method, take, params, dictionary=library)
        seconds = min(seconds, process_time() - begin)
        if seconds > REPEATED_BELOW:
            break
    return solution.iterations, seconds


def main() -> None:
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES) / "amc"
    others = [read_take(folder / f"{name}.amc") for name in ("13_18", "13_29")]
    library = train(others, known_parts(others[0].markers), Params())
    take_13_17 = read_take(folder / "13_17.amc")
    takes = [hide(take_13_17.crop(0, n), "60", seed=0)[0] for n in FRAMES]
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
