"""What the default method costs: a minute of 41 markers at 120 Hz with 5 % missing in 200 gaps, self-check included.

Processor time and the most memory held at once (tracemalloc), over frames and over gaps; ``growth`` is the time over
that of the line before, divided by what the frames or the gaps grew: at most 1 where it grows no faster. Then the time
on the clock of the fill on one core and on all cores, which have the same result. With a file that defines
fill(positions, missing), the time of that on the same take stands beside it.

    python benchmarks/default_method.py [file]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import runpy
import statistics
import sys
import tracemalloc
from time import perf_counter, process_time

import numpy as np

from mocapclean.batch.limits import processors
from mocapclean.cores import sharing
from mocapclean.evaluation import self_check
from mocapclean.simulate import hide, perform
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method

RATE, N_FRAMES, N_GAPS, SHARE = 120.0, 7200, 200, 0.05
METHOD = "kriging"


def walk(n_frames):
    """The simulated walk, at this length."""
    return perform("walk", n_frames / RATE, RATE).markers


def lose(take, n_gaps, length, seed=0):
    """The take without ``n_gaps`` gaps of ``length`` frames, no two of a marker within 5 frames of each other."""
    rng = np.random.default_rng(seed)
    n_frames, n_markers = take.trusted.shape
    missing, made = np.zeros_like(take.trusted), 0
    while made < n_gaps:
        marker, start = rng.integers(n_markers), rng.integers(10, n_frames - 10 - length)
        if not missing[start - 5 : start + length + 5, marker].any():
            missing[start : start + length, marker] = True
            made += 1
    return hide(take, missing)


def once(take):
    """Seconds of the fill, and with the self-check."""
    params = SOLVERS[METHOD].Params()

    everything = np.ones_like(take.trusted)
    begin = process_time()
    solution = run_method(METHOD, take, params)
    filled = process_time() - begin

    def solve(take, wanted):
        return run_method(METHOD, take, params, wanted=wanted, begun=solution)

    self_check.check(take, everything, solve, self_check.Params())
    return filled, process_time() - begin


def memory(take):
    """The most held while filling and checking, in units of the positions."""
    tracemalloc.start()
    once(take)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most / take.positions.nbytes


def share(take):
    """Print the seconds on the clock of a fill on one core and on all, medians of five runs by turns."""
    params, n = SOLVERS[METHOD].Params(), processors()
    seconds, results = {1: [], n: []}, {}
    for _ in range(5):
        for cores, times in seconds.items():
            with sharing(cores):
                begin = perf_counter()
                results[cores] = run_method(METHOD, take, params)
                times.append(perf_counter() - begin)
    alone, shared = (statistics.median(times) for times in seconds.values())
    same = np.array_equal(results[1].positions, results[n].positions)
    print(f"{n} cores: {shared:.2f} s on the clock, one core {alone:.2f} s, {alone / shared:.2f} times; same: {same}")


def grow(what, takes):
    """Print the seconds of takes that double each time, and how they grow."""
    before = None
    for n, take in takes:
        seconds = once(take)[1]
        print(f"{n} {what}: {seconds:.2f} s" + (f", growth {seconds / before / 2:.2f}" if before else ""), flush=True)
        before = seconds


def main() -> None:
    whole = walk(4 * N_FRAMES)
    length = round(SHARE * N_FRAMES * len(whole.markers) / N_GAPS)
    take = lose(whole.crop(0, N_FRAMES), N_GAPS, length)
    filled, both = once(take)
    print(f"{take.trusted.shape} with {N_GAPS} gaps of {length}: fill {filled:.2f} s, with self-check {both:.2f} s")
    if len(sys.argv) > 1:
        other = runpy.run_path(sys.argv[1])["fill"]
        begin = process_time()
        other(np.where(take.trusted[..., None], take.positions, 0.0), ~take.trusted)
        seconds = process_time() - begin
        print(
            f"the other: {seconds:.2f} s, {seconds / both:.1f} times ours, {seconds / filled:.1f} times the fill alone"
        )
    share(take)
    print(f"memory {memory(take):.1f} times the take", flush=True)
    few, double = N_GAPS // 4, 2 * N_FRAMES
    grow("frames", ((n, lose(whole.crop(0, n), few, length)) for n in (N_FRAMES // 2, N_FRAMES, double, 2 * double)))
    grow("gaps", ((n, lose(whole.crop(0, double), n, length)) for n in (few, 2 * few, N_GAPS, 2 * N_GAPS)))


if __name__ == "__main__":
    main()
