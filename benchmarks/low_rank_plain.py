"""svt, scsvt, ialm, psvt and tnnr against plain ports of their printed iterations.

First 13_17, joints with 10 of 31 missing in every block of 60 frames: milliseconds per iteration of the same printed
iteration, the ratio, and the largest difference. Then, for the convex ones, a shorter take: seconds until the iterate
is within a relative 1e-3 of the converged answer, by the port of the printed iteration and by the default one.

    python benchmarks/low_rank_plain.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

import mocapclean
from mocapclean.bones import bones_of
from mocapclean.numerics.centred import centred
from mocapclean.numerics.completion import Completion
from mocapclean.numerics.dual_ascent import ascend, no_edges
from mocapclean.numerics.robust_pca import robust_pca
from mocapclean.numerics.shrinkage import top_singular_directions
from mocapclean.simulate import block_loss, hide
from mocapclean.solvers.scsvt import loose_edges

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
THRESHOLD, RANK = 451.556, 6
NEAR, MOST = 1e-3, 10000


def shrunk(matrix, threshold, keep=0):
    left, values, rows = np.linalg.svd(matrix, full_matrices=False)
    lessened = np.maximum(values - threshold, 0)
    lessened[:keep] = values[:keep]
    return (left * lessened) @ rows


def watched(iterates, n_iterations, target=None, near=0.0):
    """The iterate and the seconds it took: after so many iterations, or when it is near the target."""
    begin = perf_counter()
    for k, z in enumerate(iterates, 1):
        if target is not None and np.linalg.norm(z - target) <= near * np.linalg.norm(target):
            break
        if k == n_iterations:
            break
    return z, perf_counter() - begin, k


def plain_svt(values, known, threshold, step):
    y = values.copy()
    while True:
        z = shrunk(y, threshold)
        yield z
        y = y + step * np.where(known, values - z, 0)


def plain_scsvt(values, known, threshold, step, first, second, lengths):
    """Edges (N,): sample indices of both ends."""
    y, p, s = values.copy(), np.zeros((len(lengths), 3)), np.zeros(len(lengths))
    while True:
        total = y.reshape(-1, 3).copy()
        np.add.at(total, first, p)
        np.subtract.at(total, second, p)
        z = shrunk(total.reshape(values.shape), threshold)
        yield z
        y = y + step * np.where(known, values - z, 0)
        samples = z.reshape(-1, 3)
        p, s = p - step * (samples[first] - samples[second]), s - step * lengths
        norms = np.linalg.norm(p, axis=1)
        inside, below = norms <= s, s <= -norms
        lifted = np.where(inside, s, np.where(below, 0, (norms + s) / 2))
        p = np.where(inside[:, None], p, p / np.maximum(norms, 1e-300)[:, None] * lifted[:, None])
        s = lifted


def plain_completion(values, known, mu, keep=0, tangent=0.0):
    w, y = values.copy(), np.zeros_like(values)
    y = np.where(known, 0.0, tangent)
    while True:
        x = shrunk(w + y / mu, 1 / mu, keep)
        w = np.where(known, values, x)
        yield w
        y = y + mu * np.where(known, values - x, 0)


def plain_robust(matrix, weight, keep=0):
    norm = np.linalg.norm(matrix, 2)
    mu, low = 1.25 / norm, np.zeros_like(matrix)
    limit, y = 1e7 * mu, matrix / max(norm, np.abs(matrix).max() / weight)
    while True:
        rest = matrix - low + y / mu
        sparse = np.sign(rest) * np.maximum(np.abs(rest) - weight / mu, 0)
        low = shrunk(matrix - sparse + y / mu, 1 / mu, keep)
        yield low
        y = y + mu * (matrix - low - sparse)
        mu = min(1.5 * mu, limit)


def ours_dual(data, edges, n_iterations, step=None):
    begin = perf_counter()
    found = ascend(
        data.values,
        data.known,
        edges,
        threshold=THRESHOLD * data.values.size**0.5,
        step=step,
        tolerance=0.0,
        excess_tolerance=0.0,
        max_iterations=n_iterations,
    )
    return found, perf_counter() - begin


def ours_completion(values, known, mu, n_iterations, relaxation=1.0, **shape):
    begin = perf_counter()
    completion = Completion(values, known, penalty=mu, relaxation=relaxation)
    completion.run(tolerance=0.0, change_tolerance=0.0, max_iterations=n_iterations, **shape)
    return completion.filled, perf_counter() - begin


def line(name, port, seconds, ours, our_seconds):
    gap = np.abs(port - ours).max() / np.abs(port).max()
    print(
        f"{name:18s} port {1e3 * seconds:6.1f} ms, ours {1e3 * our_seconds:6.1f} ms, "
        f"ratio {seconds / our_seconds:4.1f}, largest relative difference {gap:.0e}",
        flush=True,
    )


def hidden(folder, name, step, n_out, length):
    take = mocapclean.read(folder / "amc" / f"{name}.amc", rate=120.0)
    span = slice(None, len(take.trusted) // step // length * length * step, step)
    take = replace(
        take, positions=take.positions[span], trusted=take.trusted[span], filled=None, moved=None, origin=None
    )
    missing = block_loss(*take.trusted.shape, length, n_out, np.random.default_rng(0))
    take = hide(take, missing)
    data = centred(take.positions, take.trusted)
    edges = loose_edges(bones_of(take)[1], take.markers, take.trusted)
    ends = edges._difference.tocoo()
    first = ends.col[np.argsort(ends.row + len(edges.lengths) * (ends.data < 0))]
    return data, edges, (first[: len(edges.lengths)], first[len(edges.lengths) :], edges.lengths)


def per_iteration(folder, n=40):
    data, edges, ends = hidden(folder, "13_17", 1, 10, 60)
    tau = THRESHOLD * data.values.size**0.5
    print(f"13_17, {data.values.shape[0]} x {data.values.shape[1]}, {n} printed iterations each, one thread")
    none = no_edges(data.values.size // 3)
    found, our_seconds = ours_dual(data, none, n, 1.5)
    port, seconds, k = watched(plain_svt(data.values, data.known, tau, 1.5), n + found.skipped)
    line("svt", port, seconds / k, found.matrix, our_seconds / n)
    found, our_seconds = ours_dual(data, edges, n, 0.4)
    port, seconds, k = watched(plain_scsvt(data.values, data.known, tau, 0.4, *ends), n + found.skipped)
    line("scsvt", port, seconds / k, found.matrix, our_seconds / n)
    values = data.values / data.spread
    mu = 20 / np.linalg.norm(values, 2)
    tangent = top_singular_directions(values, RANK)
    for name, shape in (("ialm", {}), ("psvt", {"keep": RANK}), ("tnnr", {"tangent": tangent})):
        port, seconds, _ = watched(plain_completion(values, data.known, mu, **shape), n)
        ours, our_seconds = ours_completion(values, data.known, mu, n, **shape)
        line(f"{name} completion", port, seconds / n, ours, our_seconds / n)
    weight, few = len(values) ** -0.5, 25
    for name, keep in (("ialm", 0), ("psvt", RANK)):
        port, seconds, _ = watched(plain_robust(values, weight, keep), few)
        begin = perf_counter()
        ours = robust_pca(values, weight, keep=keep, tolerance=0.0, max_iterations=few)
        line(f"{name} robust", port, seconds / few, ours.low, (perf_counter() - begin) / few)


def to_converged(folder):
    """How soon the iterate is near the answer of a run ten times as long."""
    data, edges, ends = hidden(folder, "118_10", 2, 6, 60)
    tau, none, curvature = (
        THRESHOLD * data.values.size**0.5,
        no_edges(data.values.size // 3),
        edges.curvature(data.known),
    )
    values = data.values / data.spread
    norm = np.linalg.norm(values, 2)
    print(
        f"118_10 at 60 Hz, {values.shape[0]} x {values.shape[1]}: seconds until within {NEAR:g} of the converged answer"
    )
    ours = {
        "svt": lambda n: ours_dual(data, none, n)[0].matrix,
        "scsvt": lambda n: ours_dual(data, edges, n)[0].matrix,
        "ialm": lambda n: ours_completion(values, data.known, 20 / norm, n, 1.7)[0],
    }
    ports = {
        "svt": plain_svt(data.values, data.known, tau, 1.5),
        "scsvt": plain_scsvt(data.values, data.known, tau, 1.9 / curvature, *ends),
        "ialm": plain_completion(values, data.known, 0.3 / norm),
    }
    for name, run in ours.items():
        target, n = run(MOST), 32
        while np.linalg.norm(run(n) - target) > NEAR * np.linalg.norm(target):
            n = int(1.25 * n)
        begin = perf_counter()
        run(n)
        seconds = perf_counter() - begin
        _, port_seconds, k = watched(ports[name], MOST, target, NEAR)
        at_least = "at least " if k == MOST else ""
        print(
            f"{name:6s} port {at_least}{k} iterations {port_seconds:.1f} s, ours {n} iterations {seconds:.2f} s, "
            f"ratio {at_least}{port_seconds / seconds:.0f}",
            flush=True,
        )


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    per_iteration(folder)
    to_converged(folder)


if __name__ == "__main__":
    main()
