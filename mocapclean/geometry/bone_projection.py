"""Projection of points onto the lengths of bones, in many frames at once.

    min_y  ½ Σ_u p_u |y_u − t_u|² + ½ Σ_e w_e c_e²    c_e = (|y_u − y_v|² − ℓ_e²) / 2ℓ_e

over the movable points u of a frame; the other points stay at their targets t. w_e = ∞ makes it |y_u − y_v| = ℓ_e. With
multipliers λ_e = w_e c_e, both cases are Newton's method on one system, that of L. Li et al. (2010) for w = ∞:

    [ P + Σ λ_e/ℓ_e L_e   Bᵀ  ] [Δy]      [ P(y − t) + Bᵀ λ ]
    [ B                  −1/w ] [Δλ] = −  [ c − λ/w         ]    B = ∂c/∂y, L_e the Laplacian of bone e, P = diag p

The first steps leave λ out of the upper block: they project onto the tangents of the bones in turn, and do not diverge.
The other steps are Newton's own. w_e is limited, because more bones than degrees of freedom would make the system
singular.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.state_space.smoother import Masks

# Largest weight of a bone, relative to the precision of a target, about 1; chosen by hand, it leaves bones to within
# 1e-9 of the distance by which their points move.
LARGEST_WEIGHT = 1e9
# Steps without the curvature of the bones, and the most steps in all; chosen by hand, no sweep was kept.
TANGENT_STEPS = 8
MOST_STEPS = 60
# Longest move of a coordinate in one step, relative to the shortest bone; chosen by hand, no sweep was kept.
LONGEST_STEP = 0.5
# Largest KKT residual at which the steps end, relative to the longest bone: a few thousand rounding errors.
TOLERANCE = 1e-12


def tied_points(movable: Bools, ends: Ints, anchored: Bools) -> Bools:
    """Return the movable points (F, M) that a bone of ends (E, 2) ties to a movable or anchored (F, M) point."""
    tied = np.zeros_like(movable)
    for a, b in ends:
        active = (movable[:, a] | anchored[:, a]) & (movable[:, b] | anchored[:, b])
        tied[:, a] |= active
        tied[:, b] |= active
    return tied & movable


def project_to_bone_lengths(
    targets: Floats,
    movable: Bools,
    anchored: Bools,
    ends: Ints,
    lengths: Floats,
    weights: Floats | float = np.inf,
    precision: Floats | None = None,
    tolerance: float = TOLERANCE,
) -> tuple[Floats, Floats]:
    """Return points (F, M, 3) near targets (F, M, 3) with bones of ends (E, 2) and lengths, and the error (F,).

    lengths: (E,), or (F, E) where they differ from frame to frame. weights: w (E,), or one for all; infinite for exact
    lengths. precision: p (F, M), the weight of the squared distance from each target, of the order of 1; 1 by default.
    tolerance: the KKT residual at which the steps end, relative to the longest bone.

    Only movable (F, M) points move. A bone counts in a frame where both ends are movable or anchored (F, M), and one of
    them is movable. The error is the largest entry of the frame's KKT residual, in the unit of the targets.
    """
    points, errors = targets.copy(), np.zeros(len(targets))
    weights, lengths = np.broadcast_to(weights, len(ends)), np.broadcast_to(lengths, (len(targets), len(ends)))
    # Frames with the same movable and anchored points share one system.
    masks = Masks(np.concatenate([movable, anchored], axis=1))
    order = np.argsort(masks.index, kind="stable")
    groups = np.split(order, np.cumsum(np.bincount(masks.index))[:-1])
    for rows, pattern in zip(groups, masks.distinct, strict=True):
        free, present = pattern[: movable.shape[1]], pattern[: movable.shape[1]] | pattern[movable.shape[1] :]
        active = present[ends].all(axis=1) & free[ends].any(axis=1)
        if active.any():
            moved = np.flatnonzero(free & np.isin(np.arange(len(free)), ends[active]))
            points[rows], errors[rows] = _newton(
                targets[rows],
                np.ones((len(rows), len(moved))) if precision is None else precision[np.ix_(rows, moved)],
                moved,
                ends[active],
                lengths[np.ix_(rows, active)],
                weights[active],
                tolerance,
            )
    return points, errors


def _newton(
    targets: Floats, precision: Floats, moved: Ints, ends: Ints, lengths: Floats, weights: Floats, tolerance: float
) -> tuple[Floats, Floats]:
    """Return what ``project_to_bone_lengths`` does, for frames (f, M, 3) in which the same points move and bones count.

    precision: (f, m) of the ``moved`` points (m,). lengths: (f, E).
    """
    n_moved, n_bones = 3 * len(moved), len(ends)
    incidence = np.zeros((n_bones, targets.shape[1]))
    incidence[np.arange(n_bones), ends[:, 0]], incidence[np.arange(n_bones), ends[:, 1]] = 1.0, -1.0
    incidence = incidence[:, moved]
    compliance = 1.0 / np.minimum(weights, LARGEST_WEIGHT)  # 1/w
    points, multipliers = targets.copy(), np.zeros((len(targets), n_bones))
    longest = LONGEST_STEP * lengths.min()
    system = np.zeros((len(targets), n_moved + n_bones, n_moved + n_bones))
    for step in range(MOST_STEPS + 1):
        # B = (y_u − y_v)/ℓ along each bone, and c = ℓ (|y_u − y_v|²/ℓ² − 1) / 2
        along = (points[:, ends[:, 0]] - points[:, ends[:, 1]]) / lengths[..., None]
        slopes = (incidence[:, :, None] * along[:, :, None]).reshape(len(targets), n_bones, n_moved)
        stretch = 0.5 * lengths * (np.einsum("fec,fec->fe", along, along) - 1.0)
        # [P(y − t) + Bᵀ λ, c − λ/w]
        gradient = (precision[..., None] * (points - targets)[:, moved]).reshape(len(targets), -1) + np.einsum(
            "fen,fe->fn", slopes, multipliers
        )
        residual = np.concatenate([gradient, stretch - compliance * multipliers], axis=1)
        errors = np.abs(residual).max(axis=1)
        if step == MOST_STEPS or errors.max() <= tolerance * lengths.max():
            break
        # P + Σ λ_e/ℓ_e L_e, the same for x, y and z
        tension = multipliers / lengths if step >= TANGENT_STEPS else np.zeros_like(multipliers)
        curvature = np.einsum("fe,ea,eb->fab", tension, incidence, incidence) + precision[:, :, None] * np.eye(
            len(moved)
        )
        system[:, :n_moved, :n_moved] = np.einsum("fab,cd->facbd", curvature, np.eye(3)).reshape(-1, n_moved, n_moved)
        system[:, n_moved:, :n_moved], system[:, :n_moved, n_moved:] = slopes, slopes.swapaxes(1, 2)
        system[:, n_moved:, n_moved:] = -np.diag(compliance)
        move = np.linalg.solve(system, -residual[..., None])[..., 0]
        share = longest / np.maximum(np.abs(move[:, :n_moved]).max(axis=1), longest)
        points[:, moved] += (share[:, None] * move[:, :n_moved]).reshape(len(targets), -1, 3)
        multipliers += share[:, None] * move[:, n_moved:]
    return points, errors
