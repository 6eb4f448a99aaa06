"""The sweep behind trnn2's defaults: one parameter at a time around them, on captures kept apart from the results.

Writes one line per setting, take and pattern to trnn2_sweep.csv beside this file: RMS error per coordinate over
the hidden samples in mm, iterations, seconds. Every take is cut to its middle 480 frames; a pattern is either
the length of blocks with 10 random markers hidden in each, or "long": 4 random markers hidden for 200 frames.
Settings are compared on four of the takes and one pattern, the defaults (and linear and spline) on all.

    python benchmarks/trnn2_sweep.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from mocapclean.formats import amc, c3d
from mocapclean.solvers import SOLVERS, trnn2
from mocapclean.solvers.running import run_method
from mocapclean.take import ReadOptions, Take

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
TAKES = (
    "amc/05_13.amc",
    "amc/14_04.amc",
    "amc/60_03.amc",
    "amc/131_04.amc",
    "c3d/MocapRecovery__data_85_12.c3d",
    "c3d/MocapRecovery__data_HDM_mm_01-02_03_120.c3d",
    "c3d/nimblephysics__c3d_cmu_02_05.c3d",
    "c3d/nimblephysics__c3d_cmu_dribble_shoot_basketball.c3d",
)
N_FRAMES = 480
PATTERNS = ("20", "40", "60", "120", "long")
COMPARED_TAKES = (TAKES[0], TAKES[2], TAKES[5], TAKES[7])
COMPARED_PATTERNS = ("60",)
SETTINGS = {
    "first_weight": (0.0, 1e-3, 1e-1),
    "second_weight": (0.0, 3.0, 30.0),
    "penalty": (0.1, 1.0, 3.0),
    "tolerance": (1e-3,),
    "inner_iterations": (30, 200),
    "outer_iterations": (1, 6),
    "rank": (5, 10),
    "rank_limit": (20,),
    "rank_schedule": ((), (0, 3, 6, 10)),
    "form": ("paper",),
    "x_step": ("paper",),
    "d2": ("paper",),
}


def read_take(path: Path) -> Take:
    """Return a take without unlabelled points, whose names start with *."""
    if path.suffix.lower() == ".amc":
        asf = path.with_name(path.stem.split("_")[0] + ".asf")
        return amc.read(path, ReadOptions(skeleton=asf, rate=120.0))
    take = c3d.read(path, ReadOptions())
    kept = [k for k, name in enumerate(take.markers) if not name.startswith("*") and take.trusted[:, k].any()]
    return take.select(np.asarray(kept))


def excerpt(take: Take, n_frames: int) -> Take:
    first = max((len(take.positions) - n_frames) // 2, 0)
    return take.crop(first, first + n_frames)


def hide(take: Take, pattern: str, seed: int) -> tuple[Take, np.ndarray]:
    """Return the take with hidden samples, and these samples (F, M)."""
    rng, (n_frames, n_markers) = np.random.default_rng(seed), take.trusted.shape
    hidden = np.zeros((n_frames, n_markers), dtype=bool)
    if pattern == "long":
        for marker in rng.choice(n_markers, 4, replace=False):
            start = rng.integers(10, n_frames - 210)
            hidden[start : start + 200, marker] = True
    else:
        for start in range(0, n_frames, int(pattern)):
            hidden[start : start + int(pattern), rng.choice(n_markers, 10, replace=False)] = True
    trusted = take.trusted & ~hidden
    positions = np.where(trusted[..., None], take.positions, 0.0)
    return replace(take, positions=positions, trusted=trusted), hidden & take.trusted


def measure(method: str, params: object, truth: Take, pattern: str, seed: int) -> dict[str, object]:
    """Return the error over all hidden samples; unfilled ones are interpolated linearly, constant at the ends."""
    take, hidden = hide(truth, pattern, seed)
    begin = perf_counter()
    solution = run_method(method, take, params)
    seconds = perf_counter() - begin
    interpolated = run_method("linear", take, SOLVERS["linear"].Params()).positions
    estimate = np.where(solution.filled[..., None], solution.positions, interpolated)
    rmse = np.sqrt(np.mean((estimate - truth.positions)[hidden] ** 2))
    return {
        "rmse_mm": f"{rmse:.3f}",
        "converged": solution.converged,
        "iterations": solution.iterations,
        "seconds": f"{seconds:.2f}",
    }


def cases():
    """Yield (method, setting, value, Params, takes, patterns): the defaults, then one changed parameter at a time."""
    for method in ("linear", "spline", "trnn2"):
        yield method, "defaults", "", SOLVERS[method].Params(), TAKES, PATTERNS
    for name, values in SETTINGS.items():
        for value in values:
            yield "trnn2", name, value, trnn2.Params(**{name: value}), COMPARED_TAKES, COMPARED_PATTERNS


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    truths = {name: excerpt(read_take(folder / name), N_FRAMES) for name in TAKES}
    columns = ["method", "setting", "value", "take", "pattern", "rmse_mm", "converged", "iterations", "seconds"]
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        for method, setting, value, params, takes, patterns in cases():
            for name in takes:
                for pattern in patterns:
                    row = {"method": method, "setting": setting, "value": value, "take": Path(name).stem}
                    writer.writerow(row | {"pattern": pattern} | measure(method, params, truths[name], pattern, seed=1))
            file.flush()


if __name__ == "__main__":
    main()
