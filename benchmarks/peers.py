"""Methods compared with their authors' own programs, on the same hidden samples of two real takes.

The authors' errors come from a CSV with the columns take, markers_out, frames_out, seed, method, rmse_mm, whose first
lines (#) describe how samples are hidden: markers are drawn without replacement, then one start for each gap, at least
10 frames from the ends; points whose label starts with * are dropped. Prints for each case the RMS error per coordinate
over the hidden samples, ours and theirs, in mm, with their ratio; then for each method the median of the ratios.

    python benchmarks/peers.py [--methods pca,...] [--published FOLDER] [--captures FOLDER] [--set METHOD.KEY=VALUE]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
from functools import cache
from pathlib import Path
from time import process_time

import numpy as np

import mocapclean
from mocapclean.config.loading import resolve
from mocapclean.evaluation.metrics import error
from mocapclean.simulate import hide, single_gaps
from mocapclean.solvers.running import run_method

SHARED = Path(__file__).resolve().parents[2] / "shared"
NAMES = {"pca": "pca", "pma": "pma", "kalman": "kalman_as_published_code"}
TAKES = {"85_12": "MocapRecovery__data_85_12.c3d", "HDM_mm": "MocapRecovery__data_HDM_mm_01-02_03_120.c3d"}


def published(folder):
    """Return the rows of the authors' programs."""
    with (folder / "peers_on_shared_takes.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


@cache
def labelled(path):
    """Return a take without its unlabelled points."""
    take = mocapclean.read(path)
    return take.select(np.array([k for k, name in enumerate(take.markers) if not name.startswith("*")]))


def ours(method, params, row, captures):
    """Return the RMS error of a method on the hidden samples of a row, mm, and its seconds of processor time."""
    take = labelled(captures / "c3d" / TAKES[row["take"]])
    n_out, length, seed = (int(row[key]) for key in ("markers_out", "frames_out", "seed"))
    missing = single_gaps(*take.trusted.shape, n_out, length, np.random.default_rng(seed))
    broken = hide(take, missing)
    begin = process_time()
    solution = run_method(method, broken, params)
    seconds = process_time() - begin
    assert solution.filled[missing].all()
    return error(take.positions, solution.positions, missing).rmse, seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", default=",".join(NAMES))
    parser.add_argument("--published", type=Path, default=SHARED / "design")
    parser.add_argument("--captures", type=Path, default=SHARED / "data")
    parser.add_argument("--set", dest="assignments", action="append", default=[], metavar="METHOD.KEY=VALUE")
    given = parser.parse_args()
    methods = given.methods.split(",")
    settings = resolve(None, {}, [f"methods.{assignment}" for assignment in given.assignments])
    rows = published(given.published)
    for method in methods:
        found = []
        for row in (row for row in rows if row["method"] == NAMES[method]):
            mine, seconds = ours(method, settings.methods[method], row, given.captures)
            theirs = float(row["rmse_mm"])
            found.append((mine, theirs, seconds))
            case = f"{row['take']} {row['markers_out']}x{row['frames_out']} seed {row['seed']}"
            print(f"{method:6} {case:22} ours {mine:7.3f}  theirs {theirs:7.3f}  ratio {mine / theirs:5.2f}")
        mine, theirs, seconds = np.array(found).T
        ratio = mine / theirs
        print(
            f"{method}: {len(ratio)} cases, median of ours / theirs {np.median(ratio):.3f}, "
            f"geometric mean {np.exp(np.log(ratio).mean()):.3f}; "
            f"median error ours {np.median(mine):.2f}, theirs {np.median(theirs):.2f} mm; "
            f"{np.median(seconds):.2f} s of processor time a take\n"
        )


if __name__ == "__main__":
    main()
