"""Takes cut to a few frames, filled without and with the rest of the take as their session (``--learn-from``).

    python benchmarks/session.py TAKE.c3d ... [--frames 300] [--seeds 5] [--methods kriging pca pma]

A marker and its nearest ones are hidden together: 3 for 60 frames or 5 for 120, or one alone for 30; each gap begins up
to a quarter of its length earlier or later. The session is the rest of the take, but for 60 frames on both sides. Takes
in which the median marker moves less than 10 mm are left out. Prints for each method, pattern and take, and over all
takes: the median RMSE per coordinate without and with the session in mm, the geometric mean and the largest of the
ratios, the share of cases with a ratio above 1.25, the share of coordinates in the 90 % interval, and seconds of
a fill. Errors below 0.03 mm count as equal.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np

import mocapclean
from mocapclean.experiments.markers import MIN_MOTION, labelled
from mocapclean.geometry.distances import mean_distances
from mocapclean.simulate import hide
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take.session import Session, Stretch

PATTERNS = {"3 x 60": (3, 60), "5 x 120": (5, 120), "1 x 30": (1, 30)}
APART = 60  # frames between the take and its session
EQUAL = 0.03  # mm
WORSE = 1.25  # ratio above which a case counts as worse
LONG = 600  # frames; a take of more is cut from its start, so that its session is as long as it can be


def moves(take):
    """Whether the median marker is on average 10 mm or more from its mean position."""
    positions = np.where(take.trusted[..., None], take.positions, np.nan)
    return np.median(np.sqrt(np.nanvar(positions, axis=0).sum(axis=1))) >= MIN_MOTION


def cut(take, n_frames, rng):
    """The frames of a take that are filled, and the session that the others are."""
    whole = len(take.trusted)
    n = min(n_frames, whole - 400 if n_frames <= LONG else whole - 1)
    start = int(rng.integers(0, whole - n + 1))
    start = 0 if n_frames > LONG else start
    spans = (0, max(0, start - APART)), (min(whole, start + n + APART), whole)
    rest = [Stretch(take.positions[a:b], take.trusted[a:b]) for a, b in spans if b - a > 30]
    return replace(take.crop(start, start + n), findings=()), Session.of(rest, take.rate)


def together(shape, near, rng, count, length):
    """The samples (F, M) that are hidden: of a marker and its nearest ones, at about the same time."""
    mask = np.zeros(shape, dtype=bool)
    marker, start = rng.integers(shape[1]), rng.integers(10, max(11, shape[0] - length - 10))
    for other in near[marker, :count]:
        first = max(5, start + rng.integers(-length // 4, length // 4 + 1))
        mask[first : min(first + length, shape[0] - 5), other] = True
    return mask


def measured(method, take, broken, hidden):
    """RMSE per coordinate, share inside the 90 % interval (NaN without error bars), and seconds."""
    started = process_time()
    solution = run_method(method, broken, SOLVERS[method].Params())
    seconds = process_time() - started
    filled = solution.filled & hidden
    errors = solution.positions[filled] - take.positions[filled]
    inside = np.nan if solution.sd is None else np.mean(np.abs(errors) <= 1.645 * solution.sd[filled][:, None])
    return np.sqrt(np.mean(errors**2)), inside, seconds


def line(name, cases):
    """One line of the table, from cases (n, 2, 3)."""
    errors = np.sqrt(cases[:, :, 0] ** 2 + EQUAL**2)
    ratio = errors[:, 1] / errors[:, 0]
    medians, inside, seconds = (
        np.median(cases[:, :, 0], axis=0),
        cases[:, :, 1].mean(axis=0),
        cases[:, :, 2].mean(axis=0),
    )
    return (
        f"{name:48} {len(cases):3} {medians[0]:7.2f} {medians[1]:7.2f}  {np.exp(np.log(ratio).mean()):5.2f} "
        f"{ratio.max():5.2f} {100 * np.mean(ratio > WORSE):4.0f} %  {inside[0]:4.2f} {inside[1]:4.2f}  "
        f"{seconds[0]:5.2f} {seconds[1]:5.2f}"
    )


def main():
    """Fill all cases and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("takes", nargs="+", type=Path)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--methods", nargs="+", default=["kriging"])
    options = parser.parse_args()
    cases = {}
    for path in options.takes:
        whole = labelled(mocapclean.read(path))
        if not moves(whole):
            print(f"{path.name}: left out, because it hardly moves")
            continue
        distance, spread = mean_distances(whole.positions, whole.trusted, 200)
        near = np.argsort(distance + 2.0 * spread + np.where(np.eye(len(distance)) > 0, -1e9, 0.0), axis=1)
        for seed in range(options.seeds):
            rng = np.random.default_rng([seed, 7])
            take, session = cut(whole, options.frames, rng)
            for pattern, size in PATTERNS.items():
                hidden = together(take.trusted.shape, near, rng, *size) & take.trusted
                broken = hide(take, hidden)
                for method in options.methods:
                    both = [measured(method, take, replace(broken, session=s), hidden) for s in (None, session)]
                    cases.setdefault((method, pattern), {}).setdefault(path.stem, []).append(both)
    print(f"{'':48}   n  without    with  ratio  most worse  inside 90 %     seconds")
    for (method, pattern), of_takes in cases.items():
        for name, of_take in of_takes.items():
            print(line(f"{method} {pattern} {name[-32:]}", np.array(of_take)))
        print(line(f"{method} {pattern} all", np.concatenate([np.array(each) for each in of_takes.values()])))


main()
