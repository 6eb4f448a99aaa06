"""Kalman filter and Rauch-Tung-Striebel smoother in information form, for many columns seen now and then.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, diag r), of which only some columns are seen

What a frame says of z is G_t = C_oᵀ diag(1/r_o) C_o and h_t = C_oᵀ diag(1/r_o) x_o, over the columns o seen in it, so
that nothing as large as the number of columns is ever factored. With P = A V_{t−1} Aᵀ + Q = L Lᵀ the update is

    S = I + Lᵀ G L = R Rᵀ    V = (P⁻¹ + G)⁻¹ = L S⁻¹ Lᵀ    μ_t = (I − V G) A μ_{t−1} + V h_t

in which S ≥ I, so that P may be as large as one likes. Backwards

    J = V_t Aᵀ P_{t+1}⁻¹    V̂_t = (V_t − J A V_t) + J V̂_{t+1} Jᵀ    ẑ_t = (I − J A) μ_t + J ẑ_{t+1}.

R. E. Kalman, 1960, doi:10.1115/1.3662552; H. E. Rauch, F. Tung, C. T. Striebel, 1965, doi:10.2514/3.3166.

Covariances do not depend on the data. While the same columns are seen they settle, in some tens of frames, and are
computed no further: a frame costs O(H²) then and O(H³) otherwise, beside O(n H) for h and one G of O(n H²) for every
set of columns that occurs.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs, dtrtrs

from mocapclean.arrays import Bools, Floats, Ints

# A covariance that moves by less than this part of itself in a frame has settled: it is the rounding of the update.
SETTLED = 1e-13
LOOKS = 4  # frames from one look at that to the next
CHUNK = 4096  # frames whose outer products are held at a time


@dataclass(frozen=True, kw_only=True)
class Dynamics:
    """How the state moves: transition A (H, H), process Q (H, H), start m (H,), start_covariance P_1 (H, H).

    Q and P_1 are positive definite.
    """

    transition: Floats
    process: Floats
    start: Floats
    start_covariance: Floats


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What the frames say of the state: vectors h (T, H), and G as information[kinds] of (K, H, H) and (T,).

    compared: (K, H, H), the G of the columns whose innovation x − C A μ counts; G itself in a Kalman filter.
    """

    information: Floats
    compared: Floats
    kinds: Ints
    vectors: Floats


class Masks:
    """The sets of columns seen: (T, g) bool as distinct (K, g) and, for every frame, kinds (T,) into them."""

    def __init__(self, seen: Bools) -> None:
        packed = np.packbits(seen, axis=1)
        rows = np.ascontiguousarray(packed).view(f"V{packed.shape[1]}").ravel()
        _, first, kinds = np.unique(rows, return_index=True, return_inverse=True)
        self.seen, self.distinct, self.kinds = seen, seen[first], kinds.reshape(-1)


def observe(loadings: Floats, noise: float, values: Floats, masks: Masks, *, predict: bool = False) -> Evidence:
    """The evidence of values (T, n), 0 where not seen, under loadings C (n, H) and the variance r of the noise.

    Neighbouring columns are seen together: n is d times the g of ``masks``, and column j is seen with group j // d.
    With ``predict`` an unseen value is taken for seen, and for just what the filter predicts.
    """
    n_groups, n_states = masks.distinct.shape[1], loadings.shape[1]
    blocks = loadings.reshape(n_groups, -1, n_states)
    squares = (blocks.swapaxes(1, 2) @ blocks).reshape(n_groups, -1) / noise
    compared = (masks.distinct.astype(float) @ squares).reshape(-1, n_states, n_states)
    information = np.broadcast_to(squares.sum(axis=0).reshape(n_states, -1), compared.shape) if predict else compared
    return Evidence(information=information, compared=compared, kinds=masks.kinds, vectors=values @ (loadings / noise))


@dataclass(frozen=True, kw_only=True)
class Filtered:
    """Means given the frames so far, and with the covariances what the smoother needs.

    predicted, means: (T, H), before and after a frame's own evidence. covariances V, gains J and rests V − J A V
    (K, H, H), and kinds (T,) into them. log_volume: Σ log det(I + P G), what the evidence narrowed.
    """

    predicted: Floats
    means: Floats
    covariances: Floats
    gains: Floats
    rests: Floats
    kinds: Ints
    log_volume: float


@dataclass(frozen=True, kw_only=True)
class Smoothed:
    """Means (T, H) given all frames, covariances V̂ (K, H, H) and kinds (T,) into them.

    lagged: (H, H), Σ_t cov(z_{t+1}, z_t).
    """

    means: Floats
    covariances: Floats
    kinds: Ints
    lagged: Floats

    def second_moments(self, weights: Floats) -> Floats:
        """Σ_t w_t E[z_t z_tᵀ] for the rows w of weights (g, T): (g, H, H)."""
        n_states = self.means.shape[1]
        starts = np.flatnonzero(np.diff(self.kinds, prepend=-1))
        per_run = np.add.reduceat(weights, starts, axis=1)
        spread = per_run @ self.covariances[self.kinds[starts]].reshape(len(starts), -1)
        for frames in range(0, len(self.means), CHUNK):
            means = self.means[frames : frames + CHUNK]
            outer = (means[:, :, None] * means[:, None]).reshape(len(means), -1)
            spread += weights[:, frames : frames + CHUNK] @ outer
        return spread.reshape(-1, n_states, n_states)


def forward(dynamics: Dynamics, evidence: Evidence) -> Filtered:
    """The Kalman filter."""
    transition, process = dynamics.transition, dynamics.process
    n_frames, n_states = evidence.vectors.shape
    kinds = np.empty(n_frames, dtype=np.intp)
    roots: list[Floats] = []
    backs: list[Floats] = []
    volumes: list[Floats] = []
    counts: list[int] = []
    diagonal = slice(None, None, n_states + 1)
    prior = dynamics.start_covariance
    lower = dpotrf(prior, lower=1)[0]
    for start, stop in _runs(evidence.kinds):
        information, frame = evidence.information[evidence.kinds[start]], start
        while frame < stop:
            narrowed = lower.T.dot(information.dot(lower))
            narrowed.ravel()[diagonal] += 1.0
            factor = dpotrf(narrowed.T, lower=1, clean=0, overwrite_a=1)[0]
            root = dtrtrs(factor, lower.T, lower=1)[0].T
            spread = transition.dot(root)
            after = spread.dot(spread.T)
            after += process
            lower = dpotrf(after, lower=1)[0]
            settled = frame > start and frame % LOOKS == 0 and _near(after, prior)
            last = stop if settled else frame + 1
            kinds[frame:last] = len(roots)
            roots.append(root)
            backs.append(dpotrs(lower, spread, lower=1)[0])
            volumes.append(factor.diagonal())
            counts.append(last - frame)
            prior, frame = after, last
    stacked = np.array(roots)
    covariances = stacked @ stacked.swapaxes(1, 2)
    gains = stacked @ np.array(backs).swapaxes(1, 2)
    first = np.searchsorted(kinds, np.arange(len(roots)))
    shrunk = np.eye(n_states) - covariances @ evidence.compared[evidence.kinds[first]]
    shrunk[1:] = shrunk[1:] @ transition
    means = _recur(np.concatenate([shrunk, covariances], axis=2), kinds, dynamics.start, evidence.vectors)
    return Filtered(
        predicted=np.concatenate([dynamics.start[None], means[:-1] @ transition.T]),
        means=means,
        covariances=covariances,
        gains=gains,
        rests=covariances - gains @ (transition @ covariances),
        kinds=kinds,
        log_volume=2.0 * float(np.dot(counts, np.log(np.array(volumes)).sum(axis=1))),
    )


def _near(covariance: Floats, other: Floats) -> bool:
    return bool(np.abs(covariance - other).max() <= SETTLED * covariance.diagonal().max())


def _recur(updates: Floats, kinds: Ints, start: Floats, inputs: Floats) -> Floats:
    """y_t = U_t [y_{t−1}, u_t] with y_0 = start, U = updates[kinds] of (K, H, 2H) and inputs u (T, H): y (T, H)."""
    n_frames, n_states = inputs.shape
    table = np.empty((n_frames + 1, 2 * n_states))
    table[0, :n_states] = start
    table[:-1, n_states:] = inputs
    for kind, row, following in zip(kinds.tolist(), table, table[1:, :n_states], strict=False):
        np.dot(updates[kind], row, out=following)
    return table[1:, :n_states]


def _runs(kinds: Ints) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(kinds)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(kinds)], strict=True))


def backward(dynamics: Dynamics, filtered: Filtered) -> Smoothed:
    """The Rauch-Tung-Striebel smoother."""
    transition, gains = dynamics.transition, filtered.gains
    n_states = len(transition)
    updates = np.concatenate([gains, np.eye(n_states) - gains @ transition], axis=2)
    earlier, last = filtered.means[-2::-1], filtered.means[-1]
    means = np.concatenate([last[None], _recur(updates, filtered.kinds[-2::-1], last, earlier)])[::-1]
    smoothed, counts = [filtered.covariances[filtered.kinds[-1]]], [1]
    lagged = np.zeros((n_states, n_states))
    for start, stop in reversed(_runs(filtered.kinds[:-1])):
        gain, rest, frame = gains[filtered.kinds[start]], filtered.rests[filtered.kinds[start]], stop
        while frame > start:
            after = smoothed[-1]
            across = gain.dot(after)
            before = across.dot(gain.T)
            before += rest
            settled = frame < stop and frame % LOOKS == 0 and _near(before, after)
            count = frame - start if settled else 1
            lagged += count * across
            smoothed.append(before)
            counts.append(count)
            frame -= count
    return Smoothed(
        means=means,
        covariances=np.array(smoothed[::-1]),
        kinds=np.repeat(np.arange(len(counts)), counts[::-1]),
        lagged=lagged.T,
    )
