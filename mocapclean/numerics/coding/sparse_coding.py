"""Codes with few atoms: Batch-OMP, and the lasso by feature-sign search."""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, Ints

# Signals that are coded at a time; chosen for memory.
_CHUNK = 2048
# Ridge that keeps a Gram matrix of chosen atoms regular, relative to their norm; chosen by hand, a few thousand
# rounding errors.
_RIDGE = 1e-12
# Atoms outside of the active set that one round of the lasso may let in; chosen by hand for speed, it does not change
# the minimiser.
_CANDIDATES = 64
# Largest violation of the lasso's optimality that counts as rounding, relative to the largest correlation of an atom
# with the signal; chosen by hand.
_OPTIMALITY_TOLERANCE = 1e-9


def batch_omp(atoms: Floats, signals: Floats, n_nonzero: int) -> tuple[Ints, Floats]:
    """Return the atoms (N, T) that orthogonal matching pursuit chooses and their coefficients (N, T).

    T = min(n_nonzero, K). atoms: (K, d) of unit norm; signals: (N, d). Every step adds the atom of greatest correlation
    with the residual and solves the least squares for all chosen atoms, on the Gram matrix alone: O(K d + K T²) for a
    signal, O(K² d) once. R. Rubinstein, M. Zibulevsky, M. Elad, 2008, Technion CS-2008-08.
    """
    gram = atoms @ atoms.T
    n_nonzero = min(n_nonzero, len(atoms))
    chosen = np.zeros((len(signals), n_nonzero), dtype=np.intp)
    values = np.zeros((len(signals), n_nonzero))
    for start in range(0, len(signals), _CHUNK):
        span = slice(start, start + _CHUNK)
        _pursue(gram, signals[span] @ atoms.T, chosen[span], values[span])
    return chosen, values


def _pursue(gram: Floats, products: Floats, chosen: Ints, values: Floats) -> None:
    """Fill chosen (n, T) and values (n, T) for signals with the given products (n, K) with all atoms."""
    correlations = products.copy()
    for step in range(chosen.shape[1]):
        # The atom of greatest correlation with the residual that is not chosen yet
        size = np.abs(correlations)
        np.put_along_axis(size, chosen[:, :step], -1.0, axis=1)
        chosen[:, step] = size.argmax(axis=1)
        # Least squares of the signal on the chosen atoms
        support = chosen[:, : step + 1]
        block = gram[support[:, :, None], support[:, None, :]] + _RIDGE * np.eye(step + 1)
        right_side = np.take_along_axis(products, support, axis=1)[..., None]
        coefficients = np.asarray(np.linalg.solve(block, right_side)[..., 0])
        if step + 1 < chosen.shape[1]:
            correlations = products - dense_codes(support, coefficients, len(gram)) @ gram
    values[:] = coefficients


def dense_codes(chosen: Ints, values: Floats, n_atoms: int) -> Floats:
    """Return codes (N, K) with values (N, T) at the chosen (N, T) distinct atoms of each row, and 0 elsewhere."""
    codes = np.zeros((len(chosen), n_atoms))
    np.put_along_axis(codes, chosen, values, axis=1)
    return codes


def lasso(
    atoms: Floats, signal: Floats, observed: Bools, penalty: float, start: Floats, *, most_rounds: int = 100
) -> tuple[Floats, bool]:
    """Return argmin_w ½‖wᵀD − x‖² + penalty ‖w‖₁ over the observed entries (K,), and whether it is optimal.

    atoms D: (K, d). signal x: (d,), read where observed (d,) only. start: (K,), such as the codes of the frame before.
    Exact up to rounding by feature-sign search: H. Lee et al., Efficient sparse coding algorithms, NIPS 2006. Each
    round searches among the active atoms and the 64 others that violate |D(x − wᵀD)| ≤ penalty most, until none does.
    O(K d) for a round.
    """
    codes, seen = start.copy(), np.flatnonzero(observed)
    target = np.where(observed, signal, 0.0)
    residual = target.copy()
    products = atoms @ target
    slack = _OPTIMALITY_TOLERANCE * float(np.abs(products).max())
    for _ in range(most_rounds):
        active = np.flatnonzero(codes)
        residual[seen] = target[seen] - codes[active] @ atoms[np.ix_(active, seen)]
        # Violation of the optimality of atoms with weight 0
        excess = np.abs(atoms @ residual) - penalty
        excess[active] = 0.0
        worst = np.argpartition(-excess, min(_CANDIDATES, len(excess)) - 1)[:_CANDIDATES]
        chosen = np.concatenate([active, worst[excess[worst] > slack]])
        local = atoms[np.ix_(chosen, seen)]
        updated, changed = _feature_sign(local @ local.T, products[chosen], penalty, codes[chosen], slack)
        if not changed:
            return codes, True
        codes[chosen] = updated
    return codes, False


def _feature_sign(gram: Floats, products: Floats, penalty: float, start: Floats, slack: float) -> tuple[Floats, bool]:
    """Return the lasso's minimiser for a Gram matrix (k, k) and products (k,), and whether it differs from the start.

    With the signs of the active atoms fixed, the quadratic is solved, and the objective searched on the line to its
    minimum for the best point where a sign changes. Then the atom that violates optimality most becomes active. The
    objective falls at every step. ``slack``: the violation that counts as rounding.
    """
    codes = start.copy()
    gram[np.diag_indices(len(gram))] += _RIDGE * np.trace(gram) / max(len(gram), 1) + np.finfo(float).tiny
    # The search ends by itself; the number of steps guards against cycles by rounding.
    for step in range(20 * len(codes) + 20):
        correlations, signs = products - gram @ codes, np.sign(codes)
        active = codes != 0.0
        if np.abs(correlations - penalty * signs)[active].max(initial=0.0) <= slack:
            outside = np.where(active, 0.0, np.abs(correlations))
            if outside.max(initial=0.0) <= penalty + slack:
                return codes, step > 0
            worst = int(outside.argmax())
            active[worst], signs[worst] = True, np.sign(correlations[worst])
        (rows,) = np.nonzero(active)
        codes[rows] = _line_search(gram[np.ix_(rows, rows)], products[rows], penalty, codes[rows], signs[rows])
    return codes, True


def _line_search(gram: Floats, products: Floats, penalty: float, codes: Floats, signs: Floats) -> Floats:
    """Return the best point on the line from the codes (k,) to the minimum for fixed signs (k,).

    Candidates are that minimum and the points of the line where a code changes its sign.
    """
    _, minimum, failed = scipy.linalg.lapack.dposv(gram, products - penalty * signs, lower=1)
    direction = (np.linalg.lstsq(gram, products - penalty * signs, rcond=None)[0] if failed else minimum) - codes
    turning = np.flatnonzero((codes != 0.0) & (codes * (codes + direction) < 0.0))
    if not turning.size:
        return np.asarray(codes + direction)
    shares = np.append(-codes[turning] / direction[turning], 1.0)
    points = codes + shares[:, None] * direction
    points[np.arange(len(turning)), turning] = 0.0
    objectives = np.sum((0.5 * points @ gram - products) * points + penalty * np.abs(points), axis=1)
    best: Floats = points[objectives.argmin()]
    return best
