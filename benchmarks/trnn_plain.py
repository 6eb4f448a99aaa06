"""tsmc and trnn compared with plain ports of their equations: seconds per iteration, ratio, largest difference.

The ports keep M, S, Y1 and Y2, take numpy.linalg.svd of the matrix and two cosine transforms per iteration. Both run
the same number of iterations on 13_17, 10 joints missing in every block of 60 frames. For tsmc, whose problem is
convex, also the time until a relative distance of 1e-6 from its solution, on 300 frames of 14_04: the port with a fixed
penalty compared with Anderson acceleration.

    python benchmarks/trnn_plain.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from pathlib import Path
from time import perf_counter

import numpy as np
from scipy.fft import dct, idct
from trnn2_sweep import CAPTURES, hide, read_take

from mocapclean.numerics.low_rank.anderson_acceleration import AndersonAcceleration
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values
from mocapclean.numerics.low_rank.smooth_sparse_splitting import SplitCopies
from mocapclean.solvers import trnn, tsmc
from mocapclean.solvers.sparse_noise import NoisyTake

N_ITERATIONS = 30
CLOSE = 1e-6  # relative distance from the solution at which a run ends
MOST = 30000  # iterations


class Port:
    """The printed iteration; X is moved by the penalty's own threshold, rank r kept, at most d singular values."""

    def __init__(self, start, given, penalty, rank=0, dimension=10**6):
        self.data, self.known = np.ascontiguousarray(given.data), np.ascontiguousarray(given.known)
        self.lam, self.mu, self.eta, self.rank, self.dimension = (
            given.sparsity,
            given.smoothness,
            penalty,
            rank,
            dimension,
        )
        n_frames = len(start)
        self.roughness = 16 * np.sin(np.pi * np.arange(n_frames) / (2 * n_frames))[:, None] ** 4
        self.X = self.M = start.copy()
        self.S = np.where(self.known, 0.0, -start)
        self.Y1, self.Y2 = np.zeros_like(start), np.zeros_like(start)
        left, _, right = np.linalg.svd(start, full_matrices=False)
        self.T = left[:, :rank] @ right[:rank]

    def move_x(self):
        observed = np.where(self.known, self.data, 0.0)
        N = (self.T + self.Y1 + self.Y2 + self.eta * (self.M + observed - self.S)) / (2 * self.eta)
        left, values, right = np.linalg.svd(N, full_matrices=False)
        values = np.maximum(values - 1 / (2 * self.eta), 0)
        values[self.dimension :] = 0
        self.X = (left * values) @ right
        r = min(self.rank, np.count_nonzero(values > 1e-6 * values[0]))
        self.T = left[:, :r] @ right[:r]

    def move_copies(self):
        observed = np.where(self.known, self.data, 0.0)
        rest = observed - self.X + self.Y2 / self.eta
        shrunk = np.sign(rest) * np.maximum(np.abs(rest) - self.lam / self.eta, 0)
        self.S = np.where(self.known, shrunk, rest)
        waves = dct(self.eta * self.X - self.Y1, axis=0, norm="ortho")
        self.M = idct(waves / (self.eta + self.mu * self.roughness), axis=0, norm="ortho")
        self.Y1 = self.Y1 + self.eta * (self.M - self.X)
        self.Y2 = self.Y2 + self.eta * (observed - self.X - self.S)


def compare(take, name, rank):
    problem = NoisyTake(take, 56.444)
    given, start = problem.observe(100.0, 100.0), problem.start
    penalty, growth, dimension = (1.0, 1.0, min(start.shape)) if name == "tsmc" else (1e-2, 1.1, 40)
    params = trnn.Params(penalty=penalty, growth=growth, tolerance=0.0, max_iterations=N_ITERATIONS)
    port, alm = Port(start, given, penalty, rank, dimension), trnn.Alm(start, given, rank, dimension, params)
    begin = perf_counter()
    port.move_x()
    for k in range(N_ITERATIONS):
        port.eta *= growth if k else 1.0
        port.move_copies()
        port.move_x()
    middle = perf_counter()
    if name == "tsmc":
        plain = tsmc.Params(memory=0, penalty=penalty, tolerance=0.0, max_iterations=N_ITERATIONS)
        low, _ = tsmc.minimise(SplitCopies(alm.low.copy(), given), plain)
    else:
        alm.run()
        low = alm.low
    end = perf_counter()
    theirs, ours = middle - begin, end - middle
    print(f"{name}: 13_17, {start.shape[0]} x {start.shape[1]}, {N_ITERATIONS} iterations each, one thread")
    print(f"  each: plain port {1e3 * theirs / N_ITERATIONS:6.1f} ms, mocapclean {1e3 * ours / N_ITERATIONS:6.1f} ms")
    print(f"  ratio {theirs / ours:.1f}, largest difference {56.444 * np.abs(port.X - low).max():.1e} mm")


def race(take, penalty, memory):
    problem = NoisyTake(take, 56.444)
    given = problem.observe(100.0, 100.0)
    tight = tsmc.Params(tolerance=1e-12, max_iterations=6000)
    goal, _ = tsmc.minimise(SplitCopies(problem.start, given), tight)

    def far(low):
        return np.linalg.norm(low - goal) > CLOSE * np.linalg.norm(goal)

    begin, n_ours = perf_counter(), 0
    copies, low = SplitCopies(problem.start, given), problem.start.copy(order="F")
    ahead = AndersonAcceleration(memory, copies.state.size)
    while far(low) and n_ours < MOST:
        shrink_singular_values(copies.update(penalty), 0.5 / penalty, out=low)
        copies.state = ahead.next_state(copies.state, copies.next_state(low)[0])
        n_ours += 1
    middle, n_theirs = perf_counter(), 0
    port = Port(problem.start, given, penalty)
    while far(port.X) and n_theirs < MOST and perf_counter() - middle < 60:
        port.move_x()
        port.move_copies()
        n_theirs += 1
    end = perf_counter()
    reached = "not yet" if far(port.X) else "is"
    print(f"tsmc: 14_04, 300 frames, penalty {penalty:g}, to within {CLOSE:g} of the minimiser")
    print(f"  mocapclean {n_ours} iterations, {middle - begin:.1f} s")
    print(
        f"  plain port {n_theirs} iterations, {end - middle:.1f} s, {reached} there; "
        f"ratio {(end - middle) / (middle - begin):.1f}"
    )


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    take, _ = hide(read_take(folder / "amc/13_17.amc"), "60", seed=0)
    compare(take, "tsmc", 0)
    compare(take, "trnn", 15)
    short, _ = hide(read_take(folder / "amc/14_04.amc").crop(0, 300), "60", seed=0)
    for penalty in (0.3, 1.0):
        race(short, penalty, tsmc.Params().memory)


if __name__ == "__main__":
    main()
