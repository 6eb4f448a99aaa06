"""Table I of C.-H. Tan, J. Hou, L.-P. Chau (2015), rows BSVT and SCSVT, for the takes that are at hand.

Their protocol: every second frame of a CMU take (60 Hz), cut to a multiple of l, n of 31 joints out in each interval of
l frames; root mean square error of the raw iterate over all entries, in units of 56.444 mm. Positions are taken as they
are in the file. Writes one line per take, method and cell to tan2015_table1.csv beside this file, the mean over the
seeds beside the printed figure, and prints the geometric mean of ours / printed over each row.

    python benchmarks/tan2015_table1.py [seeds] [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

import mocapclean
from mocapclean.simulate import block_loss, hide
from mocapclean.solvers import scsvt, svt

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
UNIT = 25.4 / 0.45
LENGTHS = (15, 30, 60, 90, 120)
PRINTED = {
    ("49_02", "svt"): (0.046, 0.065, 0.111, 0.091, 0.238, 0.128, 0.182, 0.239, 0.255, 0.423),
    ("49_02", "scsvt"): (0.039, 0.053, 0.086, 0.068, 0.093, 0.119, 0.140, 0.132, 0.146, 0.153),
    ("135_11", "svt"): (0.057, 0.071, 0.144, 0.261, 0.288, 0.132, 0.180, 0.326, 0.500, 0.608),
    ("135_11", "scsvt"): (0.052, 0.065, 0.095, 0.095, 0.104, 0.125, 0.150, 0.184, 0.160, 0.157),
}
METHODS = {"svt": (svt, svt.Params(origin="file")), "scsvt": (scsvt, scsvt.Params(origin="file"))}


def shortened(take, length):
    """Every second frame, cut to a multiple of length."""
    positions = take.positions[::2]
    n_frames = len(positions) // length * length
    return replace(
        take,
        positions=positions[:n_frames],
        trusted=take.trusted[::2][:n_frames],
        filled=None,
        moved=None,
        rate=60.0,
        origin=None,
    )


def cell(take, length, n_out, n_seeds):
    """Mean error and seconds of each method: {method: (error, seconds)}."""
    truth = shortened(take, length)
    found = {name: [] for name in METHODS}
    for seed in range(n_seeds):
        missing = block_loss(*truth.trusted.shape, length, n_out, np.random.default_rng(seed))
        for name, (module, params) in METHODS.items():
            begin = perf_counter()
            solution = module.solve(hide(truth, missing), params)
            seconds = perf_counter() - begin
            error = np.sqrt(np.mean((solution.positions - truth.positions) ** 2)) / UNIT
            found[name].append((error, seconds, solution.iterations))
    return {name: np.mean(values, axis=0) for name, values in found.items()}


def main() -> None:
    n_seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else CAPTURES
    columns = ["take", "method", "n_out", "length", "printed", "ours", "ratio", "iterations", "seconds"]
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for name in ("49_02", "135_11"):
            take = mocapclean.read(folder / "amc" / f"{name}.amc", rate=120.0)
            ratios = {method: [] for method in METHODS}
            for place, (n_out, length) in enumerate((n, length) for n in (3, 6) for length in LENGTHS):
                for method, (error, seconds, iterations) in cell(take, length, n_out, n_seeds).items():
                    printed = PRINTED[name, method][place]
                    ratios[method].append(error / printed)
                    line = [f"{error:.3f}", f"{error / printed:.2f}", f"{iterations:.0f}", f"{seconds:.1f}"]
                    writer.writerow([name, method, n_out, length, printed, *line])
                file.flush()
            for method, values in ratios.items():
                print(f"{name} {method}: ours / printed {np.exp(np.mean(np.log(values))):.2f} in the geometric mean")


if __name__ == "__main__":
    main()
