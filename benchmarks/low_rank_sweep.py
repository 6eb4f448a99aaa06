"""The sweep behind the defaults of svt, scsvt, ialm, psvt and tnnr, on captures kept apart from the results.

Writes one line per setting and take to low_rank_sweep.csv beside this file: root mean square error per coordinate over
the hidden samples in mm, iterations, seconds. Takes are at 60 Hz, cut to 480 frames; n of 31 joints are hidden in every
block of frames. In the cases "spiked" 2 % of the other samples are moved by 150 mm per coordinate as well.

    python benchmarks/low_rank_sweep.py [folder of captures]
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
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
CASES = (("05_10", 10, 60), ("118_10", 6, 60), ("61_02", 3, 120), ("14_04", 10, 20), ("02_05", 6, 120))
ROBUST_CASES = CASES[1:4]
PLAIN = (
    ("linear", {}),
    ("svt", {}),
    ("svt", {"origin": "file"}),
    ("scsvt", {}),
    ("scsvt", {"bone_tolerance": 0.564444}),
    ("ialm", {}),
    *(("ialm", {"penalty": p}) for p in (20.0, 320.0)),
    ("ialm", {"memory": 0}),
    ("ialm", {"schedule": "paper"}),
    *(("psvt", {"rank": r, "rank_schedule": tuple(range(r))}) for r in (2, 4, 6, 10)),
    *(("psvt", {"penalty": p}) for p in (100.0, 1000.0)),
    ("psvt", {"relaxation": 1.7}),
    ("psvt", {"rank_schedule": ()}),
    ("psvt", {"rank": "auto"}),
    ("tnnr", {}),
    *(("tnnr", {"rank": r, "rank_schedule": tuple(range(r))}) for r in (2, 4, 6, 8, 12)),
    ("tnnr", {"rank_schedule": ()}),
)
ROBUST = tuple(
    (name, {"mode": "robust", "error_weight": weight, "growth": growth})
    for name in ("ialm", "psvt")
    for weight in (1.0, 2.0)
    for growth in (1.5, 1.05, 1.02)
)


def hidden(take, n_out, length, spiked):
    """Return the truth, the take with hidden samples, and the hidden samples (F, M)."""
    n_frames = min(len(take.trusted[::2]), 480) // length * length
    truth = replace(
        take,
        positions=take.positions[::2][:n_frames],
        trusted=take.trusted[::2][:n_frames],
        filled=None,
        moved=None,
        rate=60.0,
        origin=None,
    )
    missing = block_loss(*truth.trusted.shape, length, n_out, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    spikes = (rng.random(missing.shape) < 0.02) & ~missing & spiked
    noise = np.where(spikes[..., None], 150 * rng.normal(size=truth.positions.shape), 0.0)
    return truth, hide(replace(truth, positions=truth.positions + noise), missing), missing


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["method", "setting", "take", "n_out", "length", "spiked", "rmse_mm", "iterations", "seconds"])
        for spiked, cases, settings in ((False, CASES, PLAIN), (True, ROBUST_CASES, ROBUST)):
            for name, n_out, length in cases:
                take = mocapclean.read(folder / "amc" / f"{name}.amc", rate=120.0)
                truth, seen, missing = hidden(take, n_out, length, spiked)
                for method, setting in settings:
                    begin = perf_counter()
                    solution = run_method(method, seen, SOLVERS[method].Params(**setting))
                    seconds = perf_counter() - begin
                    error = np.sqrt(np.mean((solution.positions - truth.positions)[missing] ** 2))
                    words = "; ".join(f"{key} {value}" for key, value in setting.items()) or "defaults"
                    told = [f"{error:.2f}", solution.iterations, f"{seconds:.2f}"]
                    writer.writerow([method, words, name, n_out, length, spiked, *told])
                file.flush()


if __name__ == "__main__":
    main()
