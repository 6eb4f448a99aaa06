"""The nearest points that keep the lengths of bones, in many frames at once.

    min_y  ½ Σ_u p_u |y_u − t_u|² + ½ Σ_e w_e c_e²    c_e = (|y_u − y_v|² − ℓ_e²) / 2ℓ_e

over the movable points u of a frame, the others standing where t has them; w_e = ∞ makes it |y_u − y_v| = ℓ_e. With
multipliers λ_e = w_e c_e both are Newton's method on one system, of L. Li et al. (2010) for w = ∞:

    [ P + Σ λ_e/ℓ_e L_e   Bᵀ  ] [Δy]      [ P(y − t) + Bᵀ λ ]
    [ B                  −1/w ] [Δλ] = −  [ c − λ/w         ]    B = ∂c/∂y, L_e the Laplacian of bone e, P = diag p

For a few steps λ is left out of the upper block, which projects onto the bones' tangents by turns and cannot go
astray; then the steps are Newton's own. More bones than freedom would make the system singular, so w_e is at most 1e9.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.state_space.smoother import Masks

STIFFEST = 1e9
TANGENT_STEPS, STEPS = 8, 60
STRIDE = 0.5  # of the shortest bone, the longest move of a point in one step


def held(movable: Bools, ends: Ints, anchored: Bools) -> Bools:
    """Movable points (F, M) that some bone of ends (E, 2) ties to a point that is movable too or anchored (F, M)."""
    tied = np.zeros_like(movable)
    for a, b in ends:
        active = (movable[:, a] | anchored[:, a]) & (movable[:, b] | anchored[:, b])
        tied[:, a] |= active
        tied[:, b] |= active
    return tied & movable


def project(
    targets: Floats,
    movable: Bools,
    anchored: Bools,
    ends: Ints,
    lengths: Floats,
    weights: Floats | float = np.inf,
    precision: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Points (F, M, 3) near targets (F, M, 3) with the bones of ends (E, 2) and lengths (E,), and the error left (F,).

    weights: w (E,), or one for all; infinite where a length is to hold. precision: p (F, M), how dearly a target is
    left; of the order of 1, which it is everywhere if not given.

    Only movable (F, M) points move; a bone counts where its ends are movable or anchored, and one of them movable. The
    error is the largest entry of the frame's KKT residual, in the unit of the targets.
    """
    points, errors = targets.copy(), np.zeros(len(targets))
    weights = np.broadcast_to(weights, lengths.shape)
    masks = Masks(np.concatenate([movable, anchored], axis=1))
    order = np.argsort(masks.kinds, kind="stable")
    for rows, pattern in zip(np.split(order, np.cumsum(np.bincount(masks.kinds))[:-1]), masks.distinct, strict=True):
        free, there = pattern[: movable.shape[1]], pattern[: movable.shape[1]] | pattern[movable.shape[1] :]
        active = there[ends].all(axis=1) & free[ends].any(axis=1)
        if active.any():
            own = np.flatnonzero(free & np.isin(np.arange(len(free)), ends[active]))
            points[rows], errors[rows] = _newton(
                targets[rows],
                np.ones((len(rows), len(own))) if precision is None else precision[np.ix_(rows, own)],
                own,
                ends[active],
                lengths[active],
                weights[active],
            )
    return points, errors


def _newton(
    targets: Floats, precision: Floats, own: Ints, ends: Ints, lengths: Floats, weights: Floats
) -> tuple[Floats, Floats]:
    """``project`` for frames (f, M, 3) in which the same points ``own`` move and the same bones count."""
    incidence = np.zeros((len(ends), targets.shape[1]))
    incidence[np.arange(len(ends)), ends[:, 0]], incidence[np.arange(len(ends)), ends[:, 1]] = 1.0, -1.0
    incidence = incidence[:, own]
    n_moved, n_bones = 3 * len(own), len(ends)
    give = 1.0 / np.minimum(weights, STIFFEST)
    points, forces = targets.copy(), np.zeros((len(targets), n_bones))
    longest = STRIDE * lengths.min()
    system = np.zeros((len(targets), n_moved + n_bones, n_moved + n_bones))
    for step in range(STEPS + 1):
        along = (points[:, ends[:, 0]] - points[:, ends[:, 1]]) / lengths[:, None]
        slopes = (incidence[:, :, None] * along[:, :, None]).reshape(len(targets), n_bones, n_moved)
        stretch = 0.5 * lengths * (np.einsum("fec,fec->fe", along, along) - 1.0)
        pull = (precision[..., None] * (points - targets)[:, own]).reshape(len(targets), -1) + np.einsum(
            "fen,fe->fn", slopes, forces
        )
        residual = np.concatenate([pull, stretch - give * forces], axis=1)
        errors = np.abs(residual).max(axis=1)
        if step == STEPS or errors.max() <= 1e-12 * lengths.max():
            break
        bent = forces / lengths if step >= TANGENT_STEPS else np.zeros_like(forces)
        curved = np.einsum("fe,ea,eb->fab", bent, incidence, incidence) + precision[:, :, None] * np.eye(len(own))
        system[:, :n_moved, :n_moved] = np.einsum("fab,cd->facbd", curved, np.eye(3)).reshape(-1, n_moved, n_moved)
        system[:, n_moved:, :n_moved], system[:, :n_moved, n_moved:] = slopes, slopes.swapaxes(1, 2)
        system[:, n_moved:, n_moved:] = -np.diag(give)
        move = np.linalg.solve(system, -residual[..., None])[..., 0]
        share = np.minimum(1.0, longest / np.maximum(np.abs(move[:, :n_moved]).max(axis=1), np.finfo(float).tiny))
        points[:, own] += (share[:, None] * move[:, :n_moved]).reshape(len(targets), -1, 3)
        forces += share[:, None] * move[:, n_moved:]
    return points, errors
