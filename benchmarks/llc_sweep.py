"""The protocol of Wang et al. (2016) on other takes, and the sweep behind the defaults of llc, srmmp and training.

Each row trains on some takes of a subject and fills the middle of another take. 10 to 30 % of the joints are hidden, at
random in each frame or in blocks of 60 frames. The error is eq. (8): the root mean square distance over the hidden
joints of a frame, in cm, averaged over frames. Samples that a method does not fill are interpolated linearly, constant
at the ends of the take. Writes llc_sweep.csv beside this file.

    python benchmarks/llc_sweep.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import csv
import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from mocapclean import read
from mocapclean.dictionaries.body_parts import known_parts
from mocapclean.dictionaries.training import train
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.numerics import interpolation
from mocapclean.simulate import block_loss, hide, random_loss
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
SUBJECTS = {
    "14_04": ("14_12", "14_20", "14_30"),
    "05_13": ("05_02", "05_06", "05_10"),
    "61_08": ("61_02",),
    "60_08": ("60_03",),
    "13_29": ("13_18",),
}
PATTERNS = (("random", 0.1), ("random", 0.2), ("random", 0.3), ("block", 0.1), ("block", 0.2), ("block", 0.3))
SWEEP_SUBJECTS, SWEEP_PATTERNS = ("05_13", "61_08"), (("random", 0.3), ("block", 0.2))
N_FRAMES = 600
SWEEP = {
    ("train", "hole_passes"): (0, 4),
    ("train", "sparsity"): (1, 8),
    ("train", "hole_weight"): (1.0,),
    ("llc", "neighbours"): (50, 200),
    ("llc", "bandwidth"): (0.03, 0.3),
    ("llc", "llc_exponent"): (1,),
    ("llc", "form"): ("nearest",),
    ("llc", "stride"): (1, 10),
    ("llc", "seams"): ("paper",),
    ("srmmp", "sparsity_weight"): (1e-2, 3e-3, 3e-4, 1e-4),
    ("srmmp", "seams"): ("paper",),
}


def excerpt(take: Take) -> Take:
    start = max((len(take.trusted) - N_FRAMES) // 2, 0)
    span = slice(start, start + N_FRAMES)
    positions, trusted = take.positions[span], take.trusted[span]
    return replace(take, positions=positions, trusted=trusted, filled=None, moved=None, origin=None)


def lose(truth: Take, pattern: tuple[str, float]) -> np.ndarray:
    (n_frames, n_joints), rng = truth.trusted.shape, np.random.default_rng(1)
    if pattern[0] == "random":
        return random_loss(n_frames, n_joints, pattern[1], rng)
    return block_loss(n_frames, n_joints, 60, round(pattern[1] * n_joints), rng)


def frame_error(estimate: np.ndarray, truth: np.ndarray, missing: np.ndarray) -> float:
    squares = np.where(missing, np.sum((estimate - truth) ** 2, axis=2), 0.0)
    return float(np.mean(np.sqrt(squares.sum(axis=1) / missing.sum(axis=1)))) / 10


def measure(method: str, parameters: dict, dictionary, truth: Take, pattern: tuple[str, float]) -> dict:
    missing = lose(truth, pattern)
    take, params = hide(truth, missing), SOLVERS[method].Params(**parameters)
    begin = perf_counter()
    solution = run_method(method, take, params, dictionary=dictionary)
    seconds = perf_counter() - begin
    held = interpolation.linear(take.positions, take.trusted)
    estimate = np.where(solution.filled[..., None], solution.positions, held)
    error = frame_error(estimate, truth.positions, missing)
    return {"pattern": f"{pattern[0]} {pattern[1]:.0%}", "error_cm": f"{error:.3f}", "seconds": f"{seconds:.2f}"}


def main() -> None:
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES) / "amc"
    with Path(__file__).with_suffix(".csv").open("w", newline="") as file:
        columns = ["take", "method", "setting", "value", "pattern", "error_cm", "seconds"]
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        for name, others in SUBJECTS.items():
            takes = [read(folder / f"{other}.amc") for other in others]
            parts, truth = known_parts(takes[0].markers), excerpt(read(folder / f"{name}.amc"))

            def report(method, setting, value, dictionary, patterns, parameters=(), name=name, truth=truth):
                for pattern in patterns:
                    row = {"take": name, "method": method, "setting": setting, "value": value}
                    writer.writerow(row | measure(method, dict(parameters), dictionary, truth, pattern))
                file.flush()

            default = train(takes, parts, Params())
            for method in ("linear", "llc", "srmmp"):
                report(method, "defaults", "", default, PATTERNS)
            for (kind, setting), values in SWEEP.items() if name in SWEEP_SUBJECTS else ():
                for value in values:
                    if kind == "train":
                        learnt = train(takes, parts, Params(**{setting: value}))
                        report("llc", setting, value, learnt, SWEEP_PATTERNS)
                    else:
                        report(kind, setting, value, default, SWEEP_PATTERNS, {setting: value}.items())


if __name__ == "__main__":
    main()
