"""dynammo compared with a textbook Kalman filter and smoother: seconds per iteration, ratio, largest difference.

The textbook version forms and inverts the innovation covariance of every frame and stores all matrices of all frames.
Both run the same number of iterations of exact expectation maximisation from the same start. 10 joints are missing in
every block of 60 frames; with --random, a third of the samples is missing at random.

    python benchmarks/dynammo_plain.py [--random] [folder of captures]
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import sys
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from mocapclean.formats import amc
from mocapclean.numerics.state_space.linear_dynamics import (
    expectation_step,
    maximisation_step,
    system_of_principal_components,
)
from mocapclean.numerics.state_space.smoother import Masks
from mocapclean.simulate import block_loss, random_loss
from mocapclean.solvers.dynammo import LEAST_VARIANCE, Columns
from mocapclean.take import ReadOptions

CAPTURES = Path(__file__).resolve().parents[2] / "shared" / "data"
STATES, ITERATIONS = 16, 3


def textbook(system, values, known):
    """Return (A, q, m, p, C, r), the smoothed means and the log-likelihood after one E-step and M-step."""
    A, Q = system["A"], system["q"] * np.eye(STATES)
    C, r = system["C"], system["r"]
    n_frames = len(values)
    mu, V, P, a = (np.zeros((n_frames, *s)) for s in ((STATES,), (STATES,) * 2, (STATES,) * 2, (STATES,)))
    likelihood = 0.0
    for t in range(n_frames):
        a[t] = A @ mu[t - 1] if t else system["m"]
        P[t] = A @ V[t - 1] @ A.T + Q if t else system["p"] * np.eye(STATES)
        o = known[t]
        S = C[o] @ P[t] @ C[o].T + r * np.eye(o.sum())
        K = P[t] @ C[o].T @ np.linalg.inv(S)
        e = values[t, o] - C[o] @ a[t]
        mu[t] = a[t] + K @ e
        V[t] = P[t] - K @ C[o] @ P[t]
        likelihood -= 0.5 * (o.sum() * np.log(2 * np.pi) + np.linalg.slogdet(S)[1] + e @ np.linalg.solve(S, e))
    z, Vz, cross = mu.copy(), V.copy(), np.zeros((STATES, STATES))
    for t in range(n_frames - 2, -1, -1):
        J = V[t] @ A.T @ np.linalg.inv(P[t + 1])
        z[t] = mu[t] + J @ (z[t + 1] - a[t + 1])
        Vz[t] = V[t] + J @ (Vz[t + 1] - P[t + 1]) @ J.T
        cross += Vz[t + 1] @ J.T + np.outer(z[t + 1], z[t])
    E = Vz + z[:, :, None] * z[:, None]
    new = {"A": cross @ np.linalg.inv(E[:-1].sum(axis=0)), "m": z[0], "p": np.trace(Vz[0]) / STATES}
    new["q"] = np.trace(E[1:].sum(axis=0) - new["A"] @ cross.T) / STATES / (n_frames - 1)
    new["C"], total = np.zeros_like(C), 0.0
    for j in range(values.shape[1]):
        o = known[:, j]
        moment, product = E[o].sum(axis=0), values[o, j] @ z[o]
        new["C"][j] = np.linalg.solve(moment, product)
        total += values[o, j] @ values[o, j] - new["C"][j] @ product
    new["r"] = total / known.sum()
    return new, z, likelihood


def main() -> None:
    folders = [a for a in sys.argv[1:] if not a.startswith("--")]
    folder = Path(folders[0]) if folders else CAPTURES
    take = amc.read(folder / "amc/13_17.amc", ReadOptions(skeleton=folder / "amc/13.asf", rate=120.0))
    n_frames, n_markers = take.trusted.shape
    rng, scattered = np.random.default_rng(0), "--random" in sys.argv
    missing = (
        random_loss(n_frames, n_markers, 1 / 3, rng) if scattered else block_loss(n_frames, n_markers, 60, 10, rng)
    )
    columns = Columns(replace(take, trusted=~missing), "body")
    known = np.repeat(columns.seen, 3, axis=1)
    values = np.where(known, columns.start, 0.0)
    masks, system = Masks(columns.seen), system_of_principal_components(columns.start, STATES, LEAST_VARIANCE)
    port = {"A": system.dynamics.transition, "q": system.dynamics.process[0, 0], "m": system.dynamics.start}
    port |= {"p": system.dynamics.start_covariance[0, 0], "C": system.loadings, "r": system.noise_variance}
    begin = perf_counter()
    for _ in range(ITERATIONS):
        port, states, port_likelihood = textbook(port, values, known)
    middle = perf_counter()
    for _ in range(ITERATIONS):
        smoothed, likelihood = expectation_step(system, values, masks)
        system = maximisation_step(system, smoothed, values, masks, full=False, least=LEAST_VARIANCE)
    end = perf_counter()
    slow, fast = (middle - begin) / ITERATIONS, (end - middle) / ITERATIONS
    gap = np.abs(smoothed.means @ system.loadings.T - states @ port["C"].T)[~known].max() * columns.spread
    print(f"13_17, {n_frames} x {3 * n_markers}, {STATES} states, {len(masks.distinct)} sets of missing markers")
    print(f"textbook    {1e3 * slow:8.1f} ms per iteration")
    print(f"mocapclean  {1e3 * fast:8.1f} ms per iteration")
    print(f"ratio       {slow / fast:8.1f}")
    print(f"largest difference over the hidden samples {gap:.1e} mm")
    print(f"difference of the log-likelihoods {abs(likelihood / port_likelihood - 1):.1e} of themselves")


if __name__ == "__main__":
    main()
