"""The sweep behind the defaults of dynammo and bolero: one parameter at a time, on captures that no result uses.

Writes one line per method, setting and take to dynammo_sweep.csv beside this file: RMS error per coordinate over the
hidden samples in mm, iterations, seconds. Every second frame is used (60 Hz), and 3 of 31 joints are hidden in each
block of frames. All settings start from the defaults with a tolerance of 1e-4; the default tolerance is a result.

    python benchmarks/dynammo_sweep.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from mocapclean.formats import amc
from mocapclean.parameters import annotations
from mocapclean.simulate import block_loss
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import ReadOptions, Take

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
CASES = (("61_02", 60), ("118_10", 60), ("05_10", 120))
BASE = {"tolerance": 1e-4}
SETTINGS = (
    {},
    {"states": 8},
    {"states": 12},
    {"states": 24},
    {"em": "imputed"},
    {"em": "plus"},
    {"process": "full"},
    {"frame": "take"},
    {"state_schedule": ()},
    {"stage_iterations": 10},
    {"tolerance": 1e-3},
    {"max_iterations": 200, "tolerance": 0.0},
    {"constraint": "soft"},
    {"bone_iterations": 5},
)


def hide(folder: Path, name: str, length: int) -> tuple[Take, np.ndarray]:
    """Return a take at 60 Hz with hidden joints, and its true positions."""
    skeleton = folder / "amc" / f"{name.split('_')[0]}.asf"
    take = amc.read(folder / "amc" / f"{name}.amc", ReadOptions(skeleton=skeleton, rate=120.0))
    truth = take.positions[::2][: len(take.positions[::2]) // length * length]
    missing = block_loss(len(truth), truth.shape[1], length, 3, np.random.default_rng(5))
    positions = np.where(missing[..., None], 0.0, truth)
    return Take(positions=positions, trusted=~missing, markers=take.markers, rate=60.0, skeleton=take.skeleton), truth


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    takes = {(name, length): hide(folder, name, length) for name, length in CASES}
    columns = ["method", "setting", "take", "frames_out", "rmse_mm", "converged", "iterations", "seconds"]
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        for setting in SETTINGS:
            for method in ("dynammo", "bolero"):
                module = SOLVERS[method]
                if not set(setting) <= set(annotations(module.Params)):
                    continue
                for (name, length), (take, truth) in takes.items():
                    begin = perf_counter()
                    solution = run_method(method, take, module.Params(**BASE | setting))
                    seconds = perf_counter() - begin
                    rmse = np.sqrt(np.square(solution.positions - truth)[~take.trusted].mean())
                    text = " ".join(f"{key}={value}" for key, value in setting.items()) or "base"
                    row = {"method": method, "setting": text, "take": name, "frames_out": length}
                    row |= {"rmse_mm": f"{rmse:.2f}", "converged": solution.converged}
                    writer.writerow(row | {"iterations": solution.iterations, "seconds": f"{seconds:.2f}"})
            file.flush()


if __name__ == "__main__":
    main()
