"""Kalman filter and Rauch-Tung-Striebel smoother in information form, for many columns that are seen in some frames.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, diag r), of which some columns are seen

A frame enters by its information matrix G_t = C_oᵀ diag(1/r_o) C_o and vector h_t = C_oᵀ diag(1/r_o) x_o, over the
columns o seen in it. So no matrix as large as the number of columns is factored. With the predicted covariance
P = A V_{t−1} Aᵀ + Q = L Lᵀ the filtered covariance V and the filtered mean μ_t are

    S = I + Lᵀ G L = R Rᵀ    V = (P⁻¹ + G)⁻¹ = L S⁻¹ Lᵀ    μ_t = (I − V G) A μ_{t−1} + V h_t

As S ≥ I, P may be arbitrarily large. The smoothed covariance V̂ and the smoothed mean ẑ_t follow backwards, with the
smoother's gain J:

    J = V_t Aᵀ P_{t+1}⁻¹    V̂_t = (V_t − J A V_t) + J V̂_{t+1} Jᵀ    ẑ_t = (I − J A) μ_t + J ẑ_{t+1}.

R. E. Kalman, 1960, doi:10.1115/1.3662552; H. E. Rauch, F. Tung, C. T. Striebel, 1965, doi:10.2514/3.3166.

Covariances do not depend on the data. While the same columns are seen they converge within some tens of frames to a
steady state, which then serves the remaining frames of that run. So covariances and gains are stored once for each
distinct value, (K, H, H), with an index (T,) from frames. A frame of the steady state costs O(H²), any other O(H³). In
addition h costs O(n H) for each frame, and G O(n H²) for each distinct set of seen columns.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, Ints

# Largest change of a covariance in one frame, relative to its largest variance, at which it counts as steady. Of the
# order of the rounding error of one update.
STEADY_CHANGE = 1e-13
# Frames from one test for the steady state to the next; chosen by hand, to save most of the cost of the test.
STEADY_TEST_INTERVAL = 4
# Frames whose outer products are in memory at a time; chosen by hand, 8 MB for 16 states.
OUTER_PRODUCT_FRAMES = 4096


@dataclass(frozen=True, kw_only=True)
class Dynamics:
    """The state's transition matrix A, process covariance Q, and prior mean m and covariance P_1 of the first state.

    transition: (H, H). process: (H, H). start: (H,). start_covariance: (H, H). Q and P_1 are positive definite.
    """

    transition: Floats
    process: Floats
    start: Floats
    start_covariance: Floats


@dataclass(frozen=True, kw_only=True)
class Measurements:
    """The measurements of all frames in information form.

    information: (K, H, H), G of each distinct set of seen columns. innovation_information: (K, H, H), the G of the
    columns that have an innovation x − C A μ; equal to ``information`` in a Kalman filter. index: (T,), the set of
    each frame. vectors: (T, H), h.
    """

    information: Floats
    innovation_information: Floats
    index: Ints
    vectors: Floats


class Masks:
    """The groups of columns seen in each frame, (T, g) bool, as distinct rows (K, g) and an index (T,) into them."""

    def __init__(self, seen: Bools) -> None:
        # Rows packed into bits and viewed as one opaque value each are compared fast.
        packed = np.packbits(seen, axis=1)
        rows = np.ascontiguousarray(packed).view(f"V{packed.shape[1]}").ravel()
        _, first, index = np.unique(rows, return_index=True, return_inverse=True)
        self.seen, self.distinct, self.index = seen, seen[first], index.reshape(-1)


def measure(
    loadings: Floats, noise_variance: float, values: Floats, masks: Masks, *, predict: bool = False
) -> Measurements:
    """Return the information form of values (T, n) under loadings C (n, H) and the noise variance r.

    values: 0 where not seen. masks: of g groups of d = n / g neighbouring columns each; column j is seen with group
    j // d. predict: an unseen value counts as seen, with the filter's own prediction as its value.
    """
    n_groups, n_states = masks.distinct.shape[1], loadings.shape[1]
    # G is the sum of C_gᵀ C_g / r over the seen groups.
    blocks = loadings.reshape(n_groups, -1, n_states)
    squares = (blocks.swapaxes(1, 2) @ blocks).reshape(n_groups, -1) / noise_variance
    of_seen = (masks.distinct.astype(float) @ squares).reshape(-1, n_states, n_states)
    information = np.broadcast_to(squares.sum(axis=0).reshape(n_states, -1), of_seen.shape) if predict else of_seen
    return Measurements(
        information=information,
        innovation_information=of_seen,
        index=masks.index,
        vectors=values @ (loadings / noise_variance),
    )


@dataclass(frozen=True, kw_only=True)
class Filtered:
    """The filter's result: moments given the frames so far, and the smoother's gains.

    predicted_means, means: (T, H), before and after the frame's own measurement. covariances: (K, H, H), V. gains:
    (K, H, H), J. residual_covariances: (K, H, H), V − J A V, the covariance of a state given the next one. index: (T,)
    into the three. log_determinant: Σ log det(I + P G) over the frames, a term of the log-likelihood.
    """

    predicted_means: Floats
    means: Floats
    covariances: Floats
    gains: Floats
    residual_covariances: Floats
    index: Ints
    log_determinant: float


@dataclass(frozen=True, kw_only=True)
class Smoothed:
    """The smoother's result: moments given all frames.

    means: (T, H), ẑ. covariances: (K, H, H), V̂. index: (T,) into them. lagged: (H, H), Σ_t cov(z_{t+1}, z_t).
    """

    means: Floats
    covariances: Floats
    index: Ints
    lagged: Floats

    def second_moments(self, weights: Floats) -> Floats:
        """Return Σ_t w_t E[z_t z_tᵀ] (g, H, H) for the rows w of weights (g, T)."""
        n_states = self.means.shape[1]
        # Covariances: one product for each run of frames that share one.
        starts = np.flatnonzero(np.diff(self.index, prepend=-1))
        run_weights = np.add.reduceat(weights, starts, axis=1)
        moments = run_weights @ self.covariances[self.index[starts]].reshape(len(starts), -1)
        # Outer products of the means, chunk by chunk.
        for first in range(0, len(self.means), OUTER_PRODUCT_FRAMES):
            means = self.means[first : first + OUTER_PRODUCT_FRAMES]
            outer = (means[:, :, None] * means[:, None]).reshape(len(means), -1)
            moments += weights[:, first : first + OUTER_PRODUCT_FRAMES] @ outer
        return moments.reshape(-1, n_states, n_states)


def kalman_filter(dynamics: Dynamics, measurements: Measurements) -> Filtered:
    """Return the filtered means and covariances of all frames."""
    transition, n_states = dynamics.transition, len(dynamics.transition)
    roots, gain_factors, log_determinant, index = _filtered_covariances(dynamics, measurements)
    covariances = roots @ roots.swapaxes(1, 2)  # V = K Kᵀ
    gains = roots @ gain_factors  # J = K (P_{t+1}⁻¹ A K)ᵀ
    # V Aᵀ of all frames is one product; V − J A V
    moved = (covariances.reshape(-1, n_states) @ transition.T).reshape(covariances.shape)
    residual_covariances = covariances - gains @ moved.swapaxes(1, 2)
    # μ_t = (I − V G) A μ_{t−1} + V h_t; the first mean is predicted to be m itself, without A.
    first = np.searchsorted(index, np.arange(len(roots)))
    shrinkage = np.eye(n_states) - covariances @ measurements.innovation_information[measurements.index[first]]
    updates = np.empty((len(roots), n_states, 2 * n_states))
    updates[..., :n_states] = (shrinkage.reshape(-1, n_states) @ transition).reshape(shrinkage.shape)
    updates[0, :, :n_states], updates[..., n_states:] = shrinkage[0], covariances
    means = _recursion(updates, index, dynamics.start, measurements.vectors)
    return Filtered(
        predicted_means=np.concatenate([dynamics.start[None], means[:-1] @ transition.T]),
        means=means,
        covariances=covariances,
        gains=gains,
        residual_covariances=residual_covariances,
        index=index,
        log_determinant=log_determinant,
    )


def _filtered_covariances(dynamics: Dynamics, measurements: Measurements) -> tuple[Floats, Floats, float, Ints]:
    """Return the roots K of V = K Kᵀ, (P_{t+1}⁻¹ A K)ᵀ, Σ log det(I + P G), and the index (T,) into the first two."""
    transition, process = dynamics.transition, dynamics.process
    n_frames, n_states = measurements.vectors.shape
    index = np.empty(n_frames, dtype=np.intp)
    # Room for a value of each frame; what is not used is never touched.
    roots, gain_factors = (np.empty((n_frames, n_states, n_states)) for _ in range(2))
    diagonals, counts, identity = np.empty((n_frames, n_states)), list[int](), np.eye(n_states)
    factored, solved, divided = scipy.linalg.lapack.dpotrf, scipy.linalg.lapack.dtrtrs, scipy.linalg.lapack.dpotrs
    predicted, k = dynamics.start_covariance, 0
    lower = factored(predicted, lower=1)[0]
    for start, stop in _constant_runs(measurements.index):
        information, frame = measurements.information[measurements.index[start]], start
        while frame < stop:
            # S = I + Lᵀ G L = R Rᵀ
            scaled = lower.T.dot(information.dot(lower))
            scaled += identity
            factor = factored(scaled.T, lower=1, clean=0, overwrite_a=1)[0]
            # K = L R⁻ᵀ, the root of V = L S⁻¹ Lᵀ
            root = solved(factor, lower.T, lower=1)[0].T
            # P_{t+1} = A K (A K)ᵀ + Q = L Lᵀ
            moved = transition.dot(root)
            following = moved.dot(moved.T)
            following += process
            lower = factored(following, lower=1)[0]
            # The steady state serves all frames that are left of the run.
            tested = frame > start and frame % STEADY_TEST_INTERVAL == 0
            last = stop if tested and _is_steady(following, predicted) else frame + 1
            index[frame:last] = k
            roots[k], gain_factors[k] = root, divided(lower, moved, lower=1)[0].T
            diagonals[k] = factor.diagonal()
            counts.append(last - frame)
            predicted, frame, k = following, last, k + 1
    log_determinant = 2.0 * float(np.dot(counts, np.log(diagonals[:k]).sum(axis=1)))
    return roots[:k], gain_factors[:k], log_determinant, index


def _is_steady(covariance: Floats, other: Floats) -> bool:
    """Whether two covariances of successive frames differ by rounding alone."""
    # The trace is at least the largest variance: one entry that changes more than its share shows most changes.
    if abs(covariance.item(0) - other.item(0)) > STEADY_CHANGE * covariance.trace():
        return False
    return bool(np.abs(covariance - other).max() <= STEADY_CHANGE * covariance.diagonal().max())


def _recursion(updates: Floats, index: Ints, start: Floats, inputs: Floats) -> Floats:
    """Return y (T, H) of y_t = U_t [y_{t−1}, u_t], y_0 = start, for inputs u (T, H) and U = updates[index] (H, 2H)."""
    n_frames, n_states = inputs.shape
    # Row t holds [y_{t−1}, u_t]; each product is written into the next row.
    table = np.empty((n_frames + 1, 2 * n_states))
    table[0, :n_states] = start
    table[:-1, n_states:] = inputs
    for update, row, following in zip(index.tolist(), table, table[1:, :n_states], strict=False):
        np.dot(updates[update], row, out=following)
    return table[1:, :n_states]


def _constant_runs(index: Ints) -> list[tuple[int, int]]:
    """Return the runs (start, stop) of frames with one value of the index, half open."""
    edges = np.flatnonzero(np.diff(index)) + 1
    return list(zip([0, *edges.tolist()], [*edges.tolist(), len(index)], strict=True))


def rts_smoother(dynamics: Dynamics, filtered: Filtered) -> Smoothed:
    """Return the smoothed means and covariances of all frames."""
    gains, residuals, n_frames = filtered.gains, filtered.residual_covariances, len(filtered.index)
    n_states = len(dynamics.transition)
    # ẑ_t = J ẑ_{t+1} + (I − J A) μ_t, from the last frame backwards
    updates = np.empty((len(gains), n_states, 2 * n_states))
    updates[..., :n_states] = gains
    stayed = (gains.reshape(-1, n_states) @ dynamics.transition).reshape(gains.shape)
    np.subtract(np.eye(n_states), stayed, out=updates[..., n_states:])
    earlier, last = filtered.means[-2::-1], filtered.means[-1]
    means = np.concatenate([last[None], _recursion(updates, filtered.index[-2::-1], last, earlier)])[::-1]
    # Covariances are stored from the end of the room for a value of each frame.
    covariances, counts, k = np.empty((n_frames, n_states, n_states)), [1], n_frames - 1
    covariances[k] = following = filtered.covariances[filtered.index[-1]]
    lagged = np.zeros((n_states, n_states))
    for start, stop in reversed(_constant_runs(filtered.index[:-1])):
        value = int(filtered.index[start])
        gain, residual, frame = gains[value], residuals[value], stop
        while frame > start:
            # V̂_t = (V − J A V) + J V̂_{t+1} Jᵀ and cov(z_t, z_{t+1}) = J V̂_{t+1}
            cross = gain.dot(following)
            covariance = cross.dot(gain.T)
            covariance += residual
            tested = frame < stop and frame % STEADY_TEST_INTERVAL == 0
            count = frame - start if tested and _is_steady(covariance, following) else 1
            lagged += cross if count == 1 else count * cross
            k, frame, following = k - 1, frame - count, covariance
            covariances[k] = covariance
            counts.append(count)
    return Smoothed(
        means=means,
        covariances=covariances[k:],
        index=np.repeat(np.arange(len(counts)), counts[::-1]),
        lagged=lagged.T,
    )
