"""Linear dynamical systems learned from incomplete columns: a start from principal components, E-step, M-step.

    z_1 ~ N(m, P_1)    z_t = A z_{t−1} + N(0, Q)    x_t = C z_t + N(0, r I)

R. H. Shumway, D. S. Stoffer, 1982, doi:10.1111/j.1467-9892.1982.tb00349.x, with a C that is learned row by row from
the frames in which the row is seen. Values are (T, n), 0 where not seen; neighbouring columns are seen together, as
``Masks`` (T, g) say. P_1 is a multiple of I, and so is Q unless it is asked to be full.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Floats
from mocapclean.numerics.state_space.smoother import Dynamics, Masks, Smoothed, backward, forward, observe

_FLAT = 1e-6  # a direction this much smaller than the largest one is rounding


@dataclass(frozen=True, kw_only=True)
class LinearSystem:
    """Loadings C (n, H), the variance r of the noise, and the dynamics of the state."""

    dynamics: Dynamics
    loadings: Floats
    noise: float

    def emit(self, states: Floats) -> Floats:
        """The columns (T, n) of states (T, H)."""
        return states @ self.loadings.T

    def variance(self, smoothed: Smoothed, n_groups: int) -> Floats:
        """The mean variance (T, g) of the emitted columns of each of g groups of neighbours, noise included."""
        blocks = self.loadings.reshape(n_groups, -1, self.loadings.shape[1])
        squares = (blocks.swapaxes(1, 2) @ blocks).reshape(n_groups, -1) / blocks.shape[1]
        variance: Floats = smoothed.covariances.reshape(-1, squares.shape[1]) @ squares.T + self.noise
        return variance[smoothed.kinds]


def principal_system(values: Floats, n_states: int, least: float) -> LinearSystem:
    """The system whose states are the first principal components, about 0, of complete values (T, n).

    There are ``n_states`` of them, or as many as the values have directions; their mean square is 1. No variance is
    smaller than ``least``.
    """
    squares, vectors = np.linalg.eigh(values.T @ values)
    squares, vectors = squares[::-1], vectors[:, ::-1]
    kept = max(1, min(n_states, len(values), int(np.count_nonzero(squares > _FLAT**2 * squares[0]))))
    scale = np.sqrt(np.maximum(squares[:kept] / len(values), least))
    loadings, identity = vectors[:, :kept] * scale, np.eye(kept)
    states = values @ vectors[:, :kept] / scale
    transition = np.linalg.lstsq(states[:-1], states[1:], rcond=_FLAT)[0].T
    wrong = states[1:] - states[:-1] @ transition.T
    process = max(float(np.square(wrong).mean()) if wrong.size else 1.0, least)
    dynamics = Dynamics(
        transition=transition, process=process * identity, start=states[0], start_covariance=process * identity
    )
    noise = max(float(np.square(values - states @ loadings.T).mean()), least)
    return LinearSystem(dynamics=dynamics, loadings=loadings, noise=noise)


def expect(system: LinearSystem, values: Floats, masks: Masks, *, predict: bool = False) -> tuple[Smoothed, float]:
    """E-step: what the seen values say of the states, and their log-likelihood.

    With ``predict`` the filter takes an unseen value for seen and just as predicted, which is no likelihood.
    """
    filtered = forward(system.dynamics, observe(system.loadings, system.noise, values, masks, predict=predict))
    known = np.repeat(masks.seen, values.shape[1] // masks.seen.shape[1], axis=1)
    before, after = values - system.emit(filtered.predicted), values - system.emit(filtered.means)
    misfit = np.einsum("tj,tj->", before, np.where(known, after, 0.0)) / system.noise
    size = np.count_nonzero(known) * np.log(2.0 * np.pi * system.noise)
    return backward(system.dynamics, filtered), -0.5 * float(size + misfit + filtered.log_volume)


def maximise(
    system: LinearSystem, smoothed: Smoothed, values: Floats, masks: Masks, *, full: bool, least: float
) -> LinearSystem:
    """M-step: the system that makes the seen values and the expected states likeliest, Q ``full`` or isotropic."""
    means, n_groups = smoothed.means, masks.seen.shape[1]
    moments = smoothed.second_moments(np.vstack([masks.seen.T, np.ones(len(means))]))
    products = (values.T @ means).reshape(n_groups, -1, means.shape[1])
    loadings = np.linalg.solve(moments[:-1], products.swapaxes(1, 2)).swapaxes(1, 2)
    n_seen = np.count_nonzero(masks.seen) * products.shape[1]
    noise = (np.einsum("tj,tj->", values, values) - np.einsum("gdi,gdi->", loadings, products)) / n_seen
    return LinearSystem(
        dynamics=_move(system.dynamics, smoothed, moments[-1], full=full, least=least),
        loadings=np.asarray(loadings.reshape(values.shape[1], -1), dtype=np.float64),
        noise=max(float(noise), least),
    )


def _move(dynamics: Dynamics, smoothed: Smoothed, moments: Floats, *, full: bool, least: float) -> Dynamics:
    """The likeliest dynamics; moments: Σ E[z_t z_tᵀ] over all frames."""
    means, identity = smoothed.means, np.eye(len(moments))
    first, last = (smoothed.covariances[smoothed.kinds[k]] for k in (0, -1))
    start_covariance = max(float(first.trace()) / len(moments), least) * identity
    transition, process = dynamics.transition, dynamics.process
    if len(means) > 1:
        lagged = smoothed.lagged + means[1:].T @ means[:-1]
        transition = np.linalg.solve(moments - last - np.outer(means[-1], means[-1]), lagged.T).T
        second = moments - first - np.outer(means[0], means[0])
        process = np.asarray((second - transition @ lagged.T) / (len(means) - 1), dtype=np.float64)
        if full:
            sizes, axes = np.linalg.eigh((process + process.T) / 2)
            process = (axes * np.maximum(sizes, least)) @ axes.T
        else:
            process = max(float(process.trace()) / len(moments), least) * identity
    return Dynamics(transition=transition, process=process, start=means[0], start_covariance=start_covariance)
