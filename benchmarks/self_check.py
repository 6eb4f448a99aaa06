"""Accuracy of the self-check: its reported error compared with the true error, on captures with hidden samples.

    python benchmarks/self_check.py TAKE [TAKE ...] [--methods linear spline] [--shares 0.01 0.05 0.2] [--seeds 3]

A share of the samples of each take is hidden in gaps of natural lengths (``simulate.occlude``), filled, and checked.
Writes self_check.csv beside this file: one row for each take, method, share and seed, with 3D errors in mm over filled
samples. Prints for each method and share the quartiles of reported / true, and the time of a check relative to a fill.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
from pathlib import Path
from time import process_time

import numpy as np

import mocapclean
from mocapclean.errors import MocapcleanError
from mocapclean.evaluation import metrics, self_check
from mocapclean.simulate import hide, occlude
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

HEADER = ("take", "method", "share", "seed", "reported", "true", "reported_samples", "true_samples", "relative_time")


def compare(take, method, share, seed):
    """The errors and their samples, and the time of the check in units of that of the fill."""
    missing = occlude(take, np.random.default_rng(seed), share) & take.trusted
    broken = hide(take, missing)
    params = SOLVERS[method].Params()

    started = process_time()
    solution = run_method(method, broken, params, wanted=missing)
    filled = process_time()

    def solve(take, wanted):
        return run_method(method, take, params, wanted=wanted, begun=solution)

    found = self_check.check(broken, np.ones_like(missing), solve, self_check.Params()).total.error
    checked = process_time()
    true = metrics.error(take.positions, solution.positions, missing & solution.filled)
    if found is None or true is None:
        return None
    return (found.rmse_3d, true.rmse_3d, found.samples, true.samples, (checked - filled) / (filled - started))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("takes", nargs="+", type=Path)
    parser.add_argument("--methods", nargs="+", default=["linear", "spline"])
    parser.add_argument("--shares", nargs="+", type=float, default=[0.01, 0.05, 0.2])
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    rows = []
    for path in given.takes:
        take = mocapclean.read(path)
        for method in given.methods:
            for share in given.shares:
                for seed in range(given.seeds):
                    try:
                        found = compare(take, method, share, seed)
                    except MocapcleanError as fault:
                        print(f"{path.name}: {fault}")
                        continue
                    if found:
                        numbers = (f"{number:.4g}" for number in found)
                        rows.append((path.name, method, share, seed, *numbers))
    with Path(__file__).with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([HEADER, *rows])
    for method in given.methods:
        for share in given.shares:
            mine = [row for row in rows if row[1:3] == (method, share)]
            ratios = [float(row[4]) / float(row[5]) for row in mine]
            times = [float(row[8]) for row in mine]
            low, middle, high = np.quantile(ratios, [0.25, 0.5, 0.75])
            print(
                f"{method} {share:g}: reported / true {middle:.2f} ({low:.2f} to {high:.2f}) in {len(mine)} cases, "
                f"a check takes {np.median(times):.2f} fills"
            )


if __name__ == "__main__":
    main()
