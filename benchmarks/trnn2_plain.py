"""trnn2 compared with a plain port of its equations: processor time per iteration, ratio, largest difference.

The port keeps every W and Y, takes numpy.linalg.svd of each block and one sparse LU per set of missing frames.
Both run the same number of iterations at one rank, on joints with 10 of them missing in every block of 60 frames.

    python benchmarks/trnn2_plain.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from pathlib import Path
from time import process_time

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu
from trnn2_sweep import CAPTURES, hide, read_take

from mocapclean.numerics.interpolation import linear
from mocapclean.solvers import trnn2
from mocapclean.solvers.running import run_method

RANK, FEW, MANY = 15, 5, 45


def svt(matrix, threshold):
    left, values, rows = np.linalg.svd(matrix, full_matrices=False)
    return (left * np.maximum(values - threshold, 0)) @ rows


def soft(values, threshold):
    return np.sign(values) * np.maximum(np.abs(values) - threshold, 0)


def plain(start, known, rank, params, n_iterations):
    """The inner ADMM of algorithm 2 with the exact X step; start (F, n) normalised, known (F, n) bool."""
    n_frames = len(start)
    D1 = sparse.diags([1.0, -1.0], [0, 1], shape=(n_frames, n_frames), format="lil")
    D1[-1] = 0
    D1 = D1.tocsr()
    D2 = (D1 @ D1).tolil()
    D2[-2] = 0
    D2 = D2.tocsr()
    H = (2 * sparse.eye(n_frames) + D1.T @ D1 + D2.T @ D2).tocsc()
    groups = {}
    for column in range(start.shape[1]):
        groups.setdefault(known[:, column].tobytes(), []).append(column)
    systems = []
    for mask, columns in groups.items():
        seen = np.frombuffer(mask, dtype=bool)
        u, o = np.flatnonzero(~seen), np.flatnonzero(seen)
        if len(u):
            systems.append((np.ix_(u, columns), splu(H[u][:, u].tocsc()), H[u][:, o] @ start[np.ix_(o, columns)]))
    left, _, rows = np.linalg.svd(start, full_matrices=False)
    AB = left[:, :rank] @ rows[:rank]
    rho, X = params.penalty, start.copy()
    W1, W2, W3, W4 = X.copy(), X.copy(), D1 @ X, D2 @ X
    Y1, Y2, Y3, Y4 = np.zeros_like(X), -AB, np.zeros_like(X), np.zeros_like(X)
    begin = process_time()
    for _ in range(n_iterations):
        R = (W1 - Y1 / rho) + (W2 - Y2 / rho) + D1.T @ (W3 - Y3 / rho) + D2.T @ (W4 - Y4 / rho)
        for place, factor, held in systems:
            X[place] = factor.solve(R[place] - held)
        W1 = svt(X + Y1 / rho, 1 / rho)
        W2 = X + (AB + Y2) / rho
        W3 = soft(D1 @ X + Y3 / rho, params.first_weight / rho)
        W4 = svt(D2 @ X + Y4 / rho, params.second_weight / rho)
        Y1 += rho * (X - W1)
        Y2 += rho * (X - W2)
        Y3 += rho * (D1 @ X - W3)
        Y4 += rho * (D2 @ X - W4)
    return X, (process_time() - begin) / n_iterations


def normalised(take):
    """What trnn2 iterates on: centre (3,), spread, start (F, 3M), known (F, 3M)."""
    known = take.positions[take.trusted]
    centre = known.mean(axis=0)
    spread = np.sqrt(np.mean((known - centre) ** 2))
    start = (linear(take.positions, take.trusted) - centre) / spread
    return centre, spread, start.reshape(len(start), -1), np.repeat(take.trusted, 3, axis=1)


def timed(take, n_iterations):
    params = trnn2.Params(rank=RANK, rank_schedule=(), outer_iterations=1, inner_iterations=n_iterations, tolerance=0.0)
    begin = process_time()
    solution = run_method("trnn2", take, params)
    assert solution.iterations == n_iterations
    return solution.positions, process_time() - begin


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    take, hidden = hide(read_take(folder / "amc/13_17.amc"), "60", seed=0)
    centre, spread, start, known = normalised(take)
    port, port_seconds = plain(start, known, RANK, trnn2.Params(), MANY)
    _, few = timed(take, FEW)
    ours, many = timed(take, MANY)
    our_seconds = (many - few) / (MANY - FEW)
    gap = np.abs(port.reshape(take.positions.shape) * spread + centre - ours)[hidden].max()
    print(f"13_17, {start.shape[0]} x {start.shape[1]}, {MANY} iterations each, processor time of one thread")
    print(f"plain port  {1e3 * port_seconds:7.1f} ms per iteration")
    print(f"mocapclean  {1e3 * our_seconds:7.1f} ms per iteration, the stopping test included")
    print(f"ratio       {port_seconds / our_seconds:7.1f}")
    print(f"largest difference over the hidden samples {gap:.1e} mm")


if __name__ == "__main__":
    main()
