"""svt, scsvt, ialm, psvt and tnnr compared with plain ports of their printed iterations.

First, on 13_17 with 10 of 31 joints missing in every block of 60 frames: milliseconds per iteration of the same printed
iteration, the ratio, and the largest difference. Then, for the convex problems, on every fourth frame with fewer
missing joints: processor time until the iterate is within a relative 1e-6 of the solution, by the port and by ours. The
solution is from long runs with two penalties, whose distance is printed. The port is stopped after ten times our time.

On short takes (118_10, 240 frames at 60 Hz) the solution is badly determined: matrices within 6e-9 of the least nuclear
norm are 4e-5 apart. scsvt has thousands of nearly inactive bounds, and the splitting is still 7e-6 away after 8000
iterations: there the race is run by Newton's method, from two first penalties.

    python benchmarks/low_rank_plain.py [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from dataclasses import replace
from pathlib import Path
from time import process_time
from unittest import mock

import numpy as np

import mocapclean
from mocapclean.numerics.low_rank import thresholding_by_newton
from mocapclean.numerics.low_rank.centred_matrix import centred_matrix
from mocapclean.numerics.low_rank.distance_bounds import no_bounds
from mocapclean.numerics.low_rank.nuclear_norm_completion import NuclearNormCompletion
from mocapclean.numerics.low_rank.robust_pca import robust_pca
from mocapclean.numerics.low_rank.shrinkage import top_singular_directions
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import threshold_by_dual_ascent
from mocapclean.numerics.low_rank.thresholding_by_splitting import threshold_by_splitting
from mocapclean.simulate import block_loss, hide
from mocapclean.solvers.scsvt import loose_edges
from mocapclean.take.bones import bones_of

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
THRESHOLD = 451.556  # mm, the default of svt and scsvt
RANK = 6  # the default of psvt
PORT_TIME_LIMIT = 10.0  # times our time


def shrunk(matrix, threshold, keep=0):
    left, values, rows = np.linalg.svd(matrix, full_matrices=False)
    lessened = np.maximum(values - threshold, 0)
    lessened[:keep] = values[:keep]
    return (left * lessened) @ rows


def after(iterates, n_iterations):
    """Return the iterate after n iterations and the seconds it took."""
    begin = process_time()
    for k, z in enumerate(iterates, 1):
        if k == n_iterations:
            return z, process_time() - begin
    raise AssertionError("the iterates never end")


def until_near(iterates, target, near, limit):
    """Return iterations, seconds and distance when the iterate is near the target or the limit (seconds) is reached."""
    begin = process_time()
    for k, z in enumerate(iterates, 1):
        seconds, distance = process_time() - begin, relative_distance(z, target)
        if distance <= near or seconds > limit:
            return k, seconds, distance
    raise AssertionError("the iterates never end")


def relative_distance(z, target):
    return np.linalg.norm(z - target) / np.linalg.norm(target)


def plain_svt(values, known, threshold, step):
    y = values.copy()
    while True:
        z = shrunk(y, threshold)
        yield z
        y = y + step * np.where(known, values - z, 0)


def plain_scsvt(values, known, threshold, step, first, second, lengths):
    """Bounds (N,): sample indices of both ends."""
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


def ours_dual(data, edges, n_iterations, step):
    begin = process_time()
    found = threshold_by_dual_ascent(
        data.values,
        data.known,
        edges,
        threshold=THRESHOLD * data.values.size**0.5,
        step=step,
        tolerance=0.0,
        excess_tolerance=0.0,
        max_iterations=n_iterations,
    )
    return found, process_time() - begin


def ours_bounded(data, edges, n_iterations, **speed):
    return threshold_by_splitting(
        data.values,
        data.known,
        edges,
        threshold=THRESHOLD * data.values.size**0.5,
        tolerance=0.0,
        excess_tolerance=0.0,
        max_iterations=n_iterations,
        **speed,
    ).matrix


def ours_newton(data, edges, n_iterations, penalty):
    """Penalty: the first one, in units of τ / ‖B‖₂."""
    with mock.patch.object(thresholding_by_newton, "_FIRST_PENALTY", penalty):
        return thresholding_by_newton.threshold_by_newton(
            data.values,
            data.known,
            edges,
            threshold=THRESHOLD * data.values.size**0.5,
            tolerance=1e-5,
            excess_tolerance=np.inf,
            max_iterations=n_iterations,
        ).matrix


def ours_completion(values, known, mu, n_iterations, relaxation=1.0, memory=0, **shape):
    begin = process_time()
    completion = NuclearNormCompletion(values, known, penalty=mu, relaxation=relaxation, memory=memory)
    completion.run(tolerance=0.0, change_tolerance=0.0, max_iterations=n_iterations, **shape)
    return completion.filled, process_time() - begin


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
    positions, trusted = take.positions[span], take.trusted[span]
    take = replace(take, positions=positions, trusted=trusted, poses=None, filled=None, moved=None, origin=None)
    missing = block_loss(*take.trusted.shape, length, n_out, np.random.default_rng(0))
    take = hide(take, missing)
    data = centred_matrix(take.positions, take.trusted)
    edges = loose_edges(bones_of(take)[1], take.markers, take.trusted)
    ends = edges._difference.tocoo()
    first = ends.col[np.argsort(ends.row + len(edges.lengths) * (ends.data < 0))]
    return data, edges, (first[: len(edges.lengths)], first[len(edges.lengths) :], edges.lengths)


def per_iteration(folder, n=40):
    data, edges, ends = hidden(folder, "13_17", 1, 10, 60)
    tau = THRESHOLD * data.values.size**0.5
    print(f"13_17, {data.values.shape[0]} x {data.values.shape[1]}, {n} printed iterations each, one thread")
    none = no_bounds(data.values.size // 3)
    found, our_seconds = ours_dual(data, none, n, 1.5)
    k = n + found.skipped
    port, seconds = after(plain_svt(data.values, data.known, tau, 1.5), k)
    line("svt", port, seconds / k, found.matrix, our_seconds / n)
    found, our_seconds = ours_dual(data, edges, n, 0.4)
    k = n + found.skipped
    port, seconds = after(plain_scsvt(data.values, data.known, tau, 0.4, *ends), k)
    line("scsvt", port, seconds / k, found.matrix, our_seconds / n)
    values = data.values / data.spread
    mu = 20 / np.linalg.norm(values, 2)
    tangent = top_singular_directions(values, RANK)
    for name, shape in (("ialm", {}), ("psvt", {"keep": RANK}), ("tnnr", {"tangent": tangent})):
        port, seconds = after(plain_completion(values, data.known, mu, **shape), n)
        ours, our_seconds = ours_completion(values, data.known, mu, n, **shape)
        line(f"{name} completion", port, seconds / n, ours, our_seconds / n)
    weight, few = len(values) ** -0.5, 25
    for name, keep in (("ialm", 0), ("psvt", RANK)):
        port, seconds = after(plain_robust(values, weight, keep), few)
        begin = process_time()
        ours = robust_pca(values, weight, keep=keep, tolerance=0.0, max_iterations=few)
        line(f"{name} robust", port, seconds / few, ours.low, (process_time() - begin) / few)


def to_converged(folder):
    """Processor time until the iterate is near the answer of long runs."""
    data, _, _ = hidden(folder, "13_17", 4, 6, 60)
    none, tau, values = no_bounds(data.values.size // 3), THRESHOLD * data.values.size**0.5, data.values / data.spread
    norm = np.linalg.norm(values, 2)
    print(f"13_17 at 30 Hz, {values.shape[0]} x {values.shape[1]}, processor time to near the answer")
    race(
        "svt, 6 of 31 out for 2 s",
        lambda n, penalty: ours_bounded(data, none, n, penalty=penalty, memory=10),
        (80.0, 300.0),
        600,
        plain_svt(data.values, data.known, tau, 1.5),
    )
    race(
        "ialm, 6 of 31 out for 2 s",
        lambda n, penalty: ours_completion(values, data.known, penalty / norm, n, 1.7, 10)[0],
        (80.0, 160.0),
        600,
        plain_completion(values, data.known, 80.0 / norm),
    )
    data, edges, ends = hidden(folder, "13_17", 4, 3, 15)
    race(
        "scsvt, 3 of 31 out for 0.5 s",
        lambda n, penalty: ours_newton(data, edges, n, penalty),
        (100.0, 1000.0),
        400,
        plain_scsvt(data.values, data.known, tau, 1.9 / edges.curvature(data.known), *ends),
    )


def race(name, run, penalties, n_long, port, near=1e-6):
    """run(n, penalty): our iterate after n iterations. The first penalty runs the race."""
    target, other = (run(n_long, penalty) for penalty in penalties[::-1])
    n = 16
    while relative_distance(run(n, penalties[0]), target) > near and n < n_long:
        n = int(1.2 * n)
    begin = process_time()
    distance = relative_distance(run(n, penalties[0]), target)
    seconds = process_time() - begin
    k, port_seconds, port_distance = until_near(port, target, near, PORT_TIME_LIMIT * seconds)
    ratio = f"{'' if port_distance <= near else 'at least '}{port_seconds / seconds:.0f}"
    print(
        f"{name}: solutions {relative_distance(target, other):.0e} apart; "
        f"ours {n} iterations {seconds:.1f} s to {distance:.0e}; "
        f"port {k} iterations {port_seconds:.1f} s to {port_distance:.0e}; ratio {ratio}",
        flush=True,
    )


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else CAPTURES
    per_iteration(folder)
    to_converged(folder)


if __name__ == "__main__":
    main()
