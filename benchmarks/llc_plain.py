"""llc and srmmp compared with plain ports, on a part of AMC take 13_17 with a dictionary of 13_18.

llc: the port solves the printed (7) window by window with numpy, C formed from the observed rows, all atoms, stride 1.
It is compared with reconstruct() for the same problem, then with the defaults. srmmp: textbook FISTA frame by frame
until the duality gap is 1e-6 of the objective, at most 5000 steps, is compared with feature-sign search. Prints seconds
of processor time, ratio and largest difference.

    python benchmarks/llc_plain.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from pathlib import Path
from time import process_time

import numpy as np

from mocapclean import read
from mocapclean.dictionaries.body_parts import known_parts
from mocapclean.dictionaries.training import train
from mocapclean.dictionaries.training_parameters import Params
from mocapclean.numerics import windows
from mocapclean.numerics.coding.dictionary_learning import normalised
from mocapclean.numerics.coding.locality import reconstruct
from mocapclean.numerics.coding.sparse_coding import lasso
from mocapclean.simulate import block_loss

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
WEIGHT, BANDWIDTH = 10.0, 0.1


def plain_llc(atoms, points, observed):
    rebuilt = np.empty_like(points)
    for row, (point, seen) in enumerate(zip(points, observed, strict=True)):
        apart = atoms[:, seen] - point[seen]
        distance = np.linalg.norm(apart, axis=1)
        g = np.exp((distance - distance.max()) / BANDWIDTH)
        covariance = apart @ apart.T
        ridge = WEIGHT * g**2 + 1e-8 * np.trace(covariance) / len(atoms)
        weights = np.linalg.solve(covariance + np.diag(ridge), np.ones(len(atoms)))
        rebuilt[row] = weights / weights.sum() @ atoms
    return rebuilt


def objective(atoms, target, penalty, codes):
    return 0.5 * np.sum((target - codes @ atoms) ** 2) + penalty * np.abs(codes).sum()


def plain_lasso(atoms, target, penalty):
    step = 1.0 / np.linalg.norm(atoms, 2) ** 2
    codes, ahead, t = np.zeros(len(atoms)), np.zeros(len(atoms)), 1.0
    for k in range(5000):
        moved = ahead + step * (atoms @ (target - ahead @ atoms))
        new = np.sign(moved) * np.maximum(np.abs(moved) - step * penalty, 0.0)
        t, last = (1 + np.sqrt(1 + 4 * t * t)) / 2, t
        codes, ahead = new, new + (last - 1) / t * (new - codes)
        if k % 10 == 0:
            residual = target - codes @ atoms
            dual = residual * min(1.0, penalty / np.abs(atoms @ residual).max())
            bound = 0.5 * target @ target - 0.5 * np.sum((target - dual) ** 2)
            value = objective(atoms, target, penalty, codes)
            if value - bound <= 1e-6 * value:
                break
    return codes


def timed(function, *arguments, **options):
    begin = process_time()
    result = function(*arguments, **options)
    return result, process_time() - begin


def main() -> None:
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES) / "amc"
    learnt, take = read(folder / "13_18.amc"), read(folder / "13_17.amc")
    parts = known_parts(take.markers)
    dictionary = train([learnt], parts, Params(sweeps=2, hole_passes=0))
    columns = dictionary.columns(take)
    positions = take.positions[1000:1200, columns]
    trusted = ~block_loss(*positions.shape[:2], 60, 6, np.random.default_rng(1))
    local = dictionary.frames(positions, np.ones_like(trusted)).to_local(positions)
    arm = [parts.markers.index(name) for name in parts.parts["RA"]]
    atoms = dictionary.atoms["RA"]
    scale = np.sqrt(np.mean(np.sum(atoms**2, axis=1)))
    first = windows.starts(len(local), dictionary.window)
    points = windows.cut(local[:, arm].reshape(len(local), -1), first, dictionary.window) / scale
    observed = windows.cut(np.repeat(trusted[:, arm], 3, axis=1), first, dictionary.window)
    observed[observed.all(axis=1), 0] = False
    options = {"weight": WEIGHT, "bandwidth": BANDWIDTH, "exponent": 2}
    plain, slow = timed(plain_llc, atoms / scale, points, observed)
    every, quick = timed(reconstruct, atoms / scale, points, observed, neighbours=0, **options)
    near, quickest = timed(reconstruct, atoms / scale, points, observed, neighbours=100, **options)
    print(f"llc, {len(points)} windows, {len(atoms)} atoms: plain {slow:.2f} s, all atoms {quick:.2f} s", end="")
    print(f" ({slow / quick:.1f}x, difference {scale * np.abs(plain - every).max():.1e} mm)", end="")
    print(f", 100 nearest {quickest:.2f} s ({slow / quickest:.1f}x, {scale * np.abs(plain - near).max():.1e} mm)")

    poses, some = normalised(dictionary.poses.reshape(len(dictionary.poses), -1)), range(0, 40)
    codes, before, quick, slow, worst = np.zeros(len(poses)), 0, 0.0, 0.0, 0.0
    for frame in some:
        seen, target = np.repeat(trusted[frame], 3), local[frame].ravel()
        penalty = 1e-3 * np.abs(poses[:, seen] @ target[seen]).max()
        (codes, _), before = timed(lasso, poses, target, seen, penalty, codes)
        quick += before
        fista, before = timed(plain_lasso, poses[:, seen], target[seen], penalty)
        slow += before
        values = [objective(poses[:, seen], target[seen], penalty, c) for c in (fista, codes)]
        worst = max(worst, values[1] / values[0] - 1)
    print(f"srmmp, {len(some)} frames, {len(poses)} poses: FISTA {slow:.2f} s, feature-sign {quick:.2f} s", end="")
    print(f" ({slow / quick:.0f}x); its objective is at most {worst:.1e} above FISTA's")


if __name__ == "__main__":
    main()
