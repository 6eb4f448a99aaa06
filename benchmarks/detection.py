"""The cost of detection: the time of all trust rules over that of the default fill, on takes with gaps.

    python benchmarks/detection.py TAKE [TAKE ...] [--frames 600]

Each take loses 5 % of its samples in 200 gaps. It is examined by the rules and filled by the default method, with the
parameters that ``mocapclean fill`` chooses. The first half of it is examined as well: if the cost grows like the
frames, the whole takes twice as long. Prints ratios of processor times.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from pathlib import Path
from time import process_time

import numpy as np

import mocapclean
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.detection import detect
from mocapclean.simulate import hide
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

GAPS, SHARE = 200, 0.05


def gaps(trusted, rng):
    """Return the samples (F, M) to hide: 5 % of them in 200 gaps of the same length, which may touch."""
    n_frames, n_markers = trusted.shape
    length = max(1, round(SHARE * trusted.size / GAPS))
    missing = np.zeros_like(trusted)
    for _ in range(GAPS):
        start = rng.integers(n_frames - length + 1)
        missing[start : start + length, rng.integers(n_markers)] = True
    return missing & trusted


def timed(work, *given):
    """Return the processor time of a call, s, the least of three."""
    spent = []
    for _ in range(3):
        started = process_time()
        work(*given)
        spent.append(process_time() - started)
    return min(spent)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("takes", nargs="+", type=Path)
    parser.add_argument("--frames", type=int, help="only so many frames of each take")
    given = parser.parse_args()
    params = SOLVERS[DEFAULT_METHOD].Params()

    def solve(take, wanted):
        return run_method(DEFAULT_METHOD, take, params, wanted=wanted)

    for path in given.takes:
        take = mocapclean.read(path)
        take = take.crop(0, min(given.frames or len(take.trusted), len(take.trusted)))
        missing = gaps(take.trusted, np.random.default_rng(0))
        broken = hide(take, missing)
        detection, filling = timed(detect, broken), timed(solve, broken, ~broken.trusted)
        half = timed(detect, broken.crop(0, len(broken.trusted) // 2))
        print(
            f"{path.name} {take.trusted.shape}: detection / fill {detection / filling:.2f}, "
            f"detection of the whole / of half {detection / half:.2f}"
        )


if __name__ == "__main__":
    main()
