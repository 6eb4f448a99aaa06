"""Linear dynamical systems learned from incomplete columns by expectation maximisation.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, r I)

R. H. Shumway, D. S. Stoffer, 1982, doi:10.1111/j.1467-9892.1982.tb00349.x. Here each row of C is learned from the
frames in which its column is seen. Values are (T, n), 0 where not seen; neighbouring columns form the groups of
``Masks`` (T, g). P_1 is a multiple of I, and so is Q by default.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.numerics.state_space.smoother import (
    Dynamics,
    Masks,
    Smoothed,
    kalman_filter,
    measure,
    rts_smoother,
)

# Singular values below this share of the largest are rounding errors: the eigenvalues of a Gram matrix, their squares,
# are exact to about 1e-16 of the largest eigenvalue.
_RANK_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class LinearSystem:
    """The dynamics of the state, loadings C (n, H), and the variance r of the measurement noise."""

    dynamics: Dynamics
    loadings: Floats
    noise_variance: float

    def expected_values(self, states: Floats) -> Floats:
        """Return the columns C z (T, n) of states (T, H)."""
        return states @ self.loadings.T

    def value_variance(self, smoothed: Smoothed, n_groups: int) -> Floats:
        """Return the mean variance (T, g) of a column in each of g groups of neighbouring columns, noise included."""
        # tr(C_g V̂ C_gᵀ) / d = ⟨C_gᵀ C_g / d, V̂⟩
        blocks = self.loadings.reshape(n_groups, -1, self.loadings.shape[1])
        squares = (blocks.swapaxes(1, 2) @ blocks).reshape(n_groups, -1) / blocks.shape[1]
        variance: Floats = smoothed.covariances.reshape(-1, squares.shape[1]) @ squares.T + self.noise_variance
        return variance[smoothed.index]


def system_of_principal_components(values: Floats, n_states: int, least: float) -> LinearSystem:
    """Return the system whose states are the first principal components, about 0, of complete values (T, n).

    There are ``n_states`` components, or as many as the values have directions. Each state has mean square 1. No
    variance is smaller than ``least``.
    """
    # Principal directions, largest first, from the Gram matrix; loadings are scaled to unit states.
    squares, vectors = np.linalg.eigh(values.T @ values)
    squares, vectors = squares[::-1], vectors[:, ::-1]
    rank = int(np.count_nonzero(squares > _RANK_TOLERANCE**2 * squares[0]))
    n_kept = max(1, min(n_states, len(values), rank))
    scale = np.sqrt(np.maximum(squares[:n_kept] / len(values), least))
    loadings, identity = vectors[:, :n_kept] * scale, np.eye(n_kept)
    states = values @ vectors[:, :n_kept] / scale
    # A by least squares from one state to the next; Q is the mean square of its innovations.
    transition = np.linalg.lstsq(states[:-1], states[1:], rcond=_RANK_TOLERANCE)[0].T
    innovations = states[1:] - states[:-1] @ transition.T
    process = max(float(np.square(innovations).mean()) if innovations.size else 1.0, least)
    dynamics = Dynamics(
        transition=transition, process=process * identity, start=states[0], start_covariance=process * identity
    )
    noise_variance = max(float(np.square(values - states @ loadings.T).mean()), least)
    return LinearSystem(dynamics=dynamics, loadings=loadings, noise_variance=noise_variance)


def expectation_step(
    system: LinearSystem, values: Floats, masks: Masks, *, predict: bool = False
) -> tuple[Smoothed, float]:
    """Return the smoothed states given the seen values, and the log-likelihood of the seen values.

    predict: the filter counts an unseen value as seen and equal to its prediction; the second result is then no
    likelihood.
    """
    measurements = measure(system.loadings, system.noise_variance, values, masks, predict=predict)
    filtered = kalman_filter(system.dynamics, measurements)
    # eᵀ(C P Cᵀ + r I)⁻¹ e of the innovation e = x − C A μ_{t−1} is eᵀ(x − C μ_t) / r.
    known = np.repeat(masks.seen, values.shape[1] // masks.seen.shape[1], axis=1)
    innovation = values - system.expected_values(filtered.predicted_means)
    residual = values - system.expected_values(filtered.means)
    misfit = np.einsum("tj,tj->", innovation, np.where(known, residual, 0.0)) / system.noise_variance
    # log det(2π (C P Cᵀ + r I)) = n_seen log(2π r) + log det(I + P G)
    normalisation = np.count_nonzero(known) * np.log(2.0 * np.pi * system.noise_variance)
    likelihood = -0.5 * float(normalisation + misfit + filtered.log_determinant)
    return rts_smoother(system.dynamics, filtered), likelihood


def maximisation_step(
    system: LinearSystem, smoothed: Smoothed, values: Floats, masks: Masks, *, full: bool, least: float
) -> LinearSystem:
    """Return the system of greatest expected log-likelihood, with Q ``full`` or a multiple of I."""
    means, n_groups = smoothed.means, masks.seen.shape[1]
    # Σ E[z zᵀ] over the frames in which each group is seen, and over all frames in the last entry
    moments = smoothed.second_moments(np.vstack([masks.seen.T, np.ones(len(means))]))
    # C_g = (Σ x E[z]ᵀ)(Σ E[z zᵀ])⁻¹
    products = (values.T @ means).reshape(n_groups, -1, means.shape[1])
    loadings = np.linalg.solve(moments[:-1], products.swapaxes(1, 2)).swapaxes(1, 2)
    # r = (Σ x² − ⟨C, Σ x E[z]ᵀ⟩) / number of seen values
    n_seen = np.count_nonzero(masks.seen) * products.shape[1]
    noise_variance = (np.einsum("tj,tj->", values, values) - np.einsum("gdi,gdi->", loadings, products)) / n_seen
    return LinearSystem(
        dynamics=_likeliest_dynamics(system.dynamics, smoothed, moments[-1], full=full, least=least),
        loadings=np.asarray(loadings.reshape(values.shape[1], -1), dtype=np.float64),
        noise_variance=max(float(noise_variance), least),
    )


def _likeliest_dynamics(
    dynamics: Dynamics, smoothed: Smoothed, moments: Floats, *, full: bool, least: float
) -> Dynamics:
    """Return the dynamics of greatest expected log-likelihood; moments: Σ E[z_t z_tᵀ] over all frames."""
    means, identity = smoothed.means, np.eye(len(moments))
    first, last = (smoothed.covariances[smoothed.index[k]] for k in (0, -1))
    start_covariance = max(float(first.trace()) / len(moments), least) * identity
    transition, process = dynamics.transition, dynamics.process
    if len(means) > 1:
        # A = (Σ E[z_{t+1} z_tᵀ]) (Σ E[z_t z_tᵀ] without the last frame)⁻¹
        lagged = smoothed.lagged + means[1:].T @ means[:-1]
        transition = np.linalg.solve(moments - last - np.outer(means[-1], means[-1]), lagged.T).T
        # Q = (Σ E[z_{t+1} z_{t+1}ᵀ] − A (Σ E[z_{t+1} z_tᵀ])ᵀ) / (T − 1)
        without_first = moments - first - np.outer(means[0], means[0])
        process = np.asarray((without_first - transition @ lagged.T) / (len(means) - 1), dtype=np.float64)
        if full:
            variances, axes = np.linalg.eigh((process + process.T) / 2)
            process = (axes * np.maximum(variances, least)) @ axes.T
        else:
            process = max(float(process.trace()) / len(moments), least) * identity
    return Dynamics(transition=transition, process=process, start=means[0], start_covariance=start_covariance)
