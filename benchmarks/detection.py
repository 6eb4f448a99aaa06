"""The cost of detection: over that of the default fill, and how it grows with frames and markers.

    python benchmarks/detection.py TAKE [TAKE ...] [--frames 600]
    python benchmarks/detection.py --growth
    python benchmarks/detection.py --largest

Each take loses 5 % of its samples in 200 gaps. It is examined by the rules and filled by the default method, with the
parameters that ``mocapclean fill`` chooses. Its first half is examined as well. Prints ratios of processor times.

``--growth``: simulated figures side by side (walking and boxing) whose segments carry more markers, as hands and faces
do, with one gap of 1 to 20 frames for each 200 samples of 20 frames. The ratio of times is given beside that of sizes:
detection must grow no faster than the frames, and no faster than the square of the markers. ``--largest``: the seconds
and the memory of 300 markers in 10,000 frames.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import resource
import sys
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np

import mocapclean
from mocapclean.config.settings import DEFAULT_METHOD
from mocapclean.detection import detect
from mocapclean.simulate import hide, perform
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Take

GAPS, SHARE = 200, 0.05
GROWTH_FRAMES, GROWTH_MARKERS = (1000, 2000, 4000, 8000), (25, 50, 100, 200)
FEWEST_FRAMES, FEWEST_MARKERS = 2000, 50  # of the takes in which the other size grows
LARGEST = 10_000, 300  # frames, markers: two bodies with hands and faces
FIGURE = 150  # markers of a figure at most
RATE, APART = 120.0, 1500.0  # Hz; mm between figures
NOISE = 0.3  # mm
LONGEST_GAP, GAP_SAMPLES = 20, 4000  # frames; samples for each gap


def gaps(trusted, rng):
    """Return the samples (F, M) to hide: 5 % of them in 200 gaps of the same length, which may touch."""
    n_frames, n_markers = trusted.shape
    length = max(1, round(SHARE * trusted.size / GAPS))
    missing = np.zeros_like(trusted)
    for _ in range(GAPS):
        start = rng.integers(n_frames - length + 1)
        missing[start : start + length, rng.integers(n_markers)] = True
    return missing & trusted


def crowd(n_frames, n_markers):
    """Return a take of figures side by side, with short gaps; what a figure lacks in markers its segments carry."""
    rng, figures = np.random.default_rng(0), []
    while n_markers > 0:
        motion = ("walk", "boxing")[len(figures) % 2]
        positions = perform(motion, n_frames / RATE, RATE, len(figures)).markers.positions[:n_frames]
        size = min(n_markers, FIGURE)
        added = [carried(positions, rng) for _ in range(size - positions.shape[1])]
        figure = np.concatenate([positions, *added], axis=1)[:, :size]
        figures.append(figure + np.array([APART * len(figures), 0.0, 0.0]))
        n_markers -= size
    positions = np.concatenate(figures, axis=1)
    positions += NOISE * rng.normal(size=positions.shape)
    trusted = np.ones(positions.shape[:2], dtype=bool)
    take = Take(positions=positions, trusted=trusted, markers=[f"m{k}" for k in range(len(trusted[0]))], rate=RATE)
    missing = np.zeros_like(trusted)
    for _ in range(trusted.size // GAP_SAMPLES):
        start = rng.integers(n_frames)
        missing[start : start + rng.integers(1, LONGEST_GAP + 1), rng.integers(len(trusted[0]))] = True
    return hide(take, missing)


def carried(positions, rng):
    """Return a marker (F, 1, 3) on a segment of positions (F, M, 3): beside a marker, towards the two next to it."""
    middle = positions[len(positions) // 2]
    marker = rng.integers(len(middle))
    nearest = np.argsort(np.linalg.norm(middle - middle[marker], axis=1))[1:3]
    one, other = (positions[:, near] - positions[:, marker] for near in nearest)
    across = np.cross(one, other)
    across /= np.linalg.norm(across, axis=1, keepdims=True) + 1.0
    a, b, c = rng.uniform(-0.4, 0.4, 3)
    return (positions[:, marker] + a * one + b * other + 60.0 * c * across)[:, None]


def timed(work, *given):
    """Return the processor time of a call, s, the least of three."""
    spent = []
    for _ in range(3):
        started = process_time()
        work(*given)
        spent.append(process_time() - started)
    return min(spent)


def over_fill(paths, n_frames):
    """Print the ratios of detection and fill, and of a whole take and its half."""
    params = SOLVERS[DEFAULT_METHOD].Params()

    def solve(take, wanted):
        return run_method(DEFAULT_METHOD, take, params, wanted=wanted)

    for path in paths:
        take = mocapclean.read(path)
        take = take.crop(0, min(n_frames or len(take.trusted), len(take.trusted)))
        missing = gaps(take.trusted, np.random.default_rng(0))
        broken = hide(take, missing)
        detection, filling = timed(detect, broken), timed(solve, broken, ~broken.trusted)
        half = timed(detect, broken.crop(0, len(broken.trusted) // 2))
        print(
            f"{path.name} {take.trusted.shape}: detection / fill {detection / filling:.2f}, "
            f"detection of the whole / of half {detection / half:.2f}",
            flush=True,
        )


def growth():
    """Print the ratios of times where the frames double, and where the markers do."""
    for name, sizes, sizes_of in (
        ("frames", GROWTH_FRAMES, lambda size: (size, FEWEST_MARKERS)),
        ("markers", GROWTH_MARKERS, lambda size: (FEWEST_FRAMES, size)),
    ):
        times = [timed(detect, crowd(*sizes_of(size))) for size in sizes]
        for (less, fewer), (more, longer) in pairwise(zip(sizes, times, strict=True)):
            print(f"{less} -> {more} {name}: {more / less:.0f} times as many, {longer / fewer:.2f} times as long")


def largest():
    """Print the processor time and the memory of the largest take."""
    take = crowd(*LARGEST)
    started = process_time()
    detect(take)
    spent = process_time() - started
    # The unit is bytes on macOS and kB elsewhere.
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e9 if sys.platform == "darwin" else 1e6)
    print(f"{take.trusted.shape}: {spent:.1f} s, at most {peak:.2f} GB in use")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("takes", nargs="*", type=Path)
    parser.add_argument("--frames", type=int, help="only so many frames of each take")
    parser.add_argument("--growth", action="store_true", help="growth with frames and markers")
    parser.add_argument("--largest", action="store_true", help="300 markers in 10,000 frames")
    given = parser.parse_args()
    over_fill(given.takes, given.frames)
    if given.growth:
        growth()
    if given.largest:
        largest()


if __name__ == "__main__":
    main()
