"""Codes with few atoms: Batch-OMP, and the lasso by feature-sign search."""

import numpy as np
from scipy.linalg.lapack import dposv

from mocapclean.arrays import Bools, Floats, Ints

_CHUNK = 2048
_NOTHING = 1e-12
_CANDIDATES = 64


def batch_omp(atoms: Floats, signals: Floats, n_nonzero: int) -> tuple[Ints, Floats]:
    """Orthogonal matching pursuit: atoms chosen (N, T) and their coefficients (N, T), T = min(n_nonzero, K).

    atoms: (K, d) of unit norm; signals: (N, d). Every step takes the atom that goes best with the residual and
    solves for all taken ones, on the Gram matrix alone: O(K d + K T²) for a signal, O(K² d) once. R. Rubinstein,
    M. Zibulevsky, M. Elad, 2008, Technion CS-2008-08.
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
    left = products.copy()
    for step in range(chosen.shape[1]):
        size = np.abs(left)
        np.put_along_axis(size, chosen[:, :step], -1.0, axis=1)
        chosen[:, step] = size.argmax(axis=1)
        taken = chosen[:, : step + 1]
        block = gram[taken[:, :, None], taken[:, None, :]] + _NOTHING * np.eye(step + 1)
        found = np.asarray(np.linalg.solve(block, np.take_along_axis(products, taken, axis=1)[..., None])[..., 0])
        if step + 1 < chosen.shape[1]:
            left = products - dense(taken, found, len(gram)) @ gram
    values[:] = found


def dense(chosen: Ints, values: Floats, n_atoms: int) -> Floats:
    """Codes (N, K) with values (N, T) at the chosen (N, T) distinct atoms of each row."""
    codes = np.zeros((len(chosen), n_atoms))
    np.put_along_axis(codes, chosen, values, axis=1)
    return codes


def lasso(
    atoms: Floats, signal: Floats, observed: Bools, penalty: float, start: Floats, *, most_rounds: int = 100
) -> tuple[Floats, bool]:
    """argmin ½‖wᵀD − x‖² + penalty ‖w‖₁ over the observed entries: w (K,), and whether its optimality was reached.

    atoms D: (K, d); signal x: (d,), not read where not observed (d,); start: (K,) where to begin, such as the codes of
    the frame before. Exact up to rounding: feature-sign search (H. Lee et al., "Efficient sparse coding algorithms",
    NIPS 2006) among the active atoms and the 64 that violate |D(x − wᵀD)| ≤ penalty the most, until none does. O(K d) a
    round.
    """
    codes, seen = start.copy(), np.flatnonzero(observed)
    target = np.where(observed, signal, 0.0)
    residual = target.copy()
    products = atoms @ target
    slack = 1e-9 * float(np.abs(products).max())
    for _ in range(most_rounds):
        active = np.flatnonzero(codes)
        residual[seen] = target[seen] - codes[active] @ atoms[np.ix_(active, seen)]
        excess = np.abs(atoms @ residual) - penalty
        excess[active] = 0.0
        worst = np.argpartition(-excess, min(_CANDIDATES, len(excess)) - 1)[:_CANDIDATES]
        chosen = np.concatenate([active, worst[excess[worst] > slack]])
        local = atoms[np.ix_(chosen, seen)]
        found, moved = _feature_sign(local @ local.T, products[chosen], penalty, codes[chosen], slack)
        if not moved:
            return codes, True
        codes[chosen] = found
    return codes, False


def _feature_sign(gram: Floats, products: Floats, penalty: float, start: Floats, slack: float) -> tuple[Floats, bool]:
    """The lasso of a Gram matrix (k, k) and products (k,), and whether it differs from where it began.

    On the active atoms the signs are fixed, the quadratic is solved and the objective searched along the way for a sign
    that turns; then the atom that violates optimality the most is let in. The objective falls at every step.
    """
    codes = start.copy()
    gram[np.diag_indices(len(gram))] += _NOTHING * np.trace(gram) / max(len(gram), 1) + np.finfo(float).tiny
    for step in range(20 * len(codes) + 20):
        pull, signs = products - gram @ codes, np.sign(codes)
        active = codes != 0.0
        if np.abs(pull - penalty * signs)[active].max(initial=0.0) <= slack:
            outside = np.where(active, 0.0, np.abs(pull))
            if outside.max(initial=0.0) <= penalty + slack:
                return codes, step > 0
            worst = int(outside.argmax())
            active[worst], signs[worst] = True, np.sign(pull[worst])
        (rows,) = np.nonzero(active)
        codes[rows] = _search(gram[np.ix_(rows, rows)], products[rows], penalty, codes[rows], signs[rows])
    return codes, True


def _search(gram: Floats, products: Floats, penalty: float, codes: Floats, signs: Floats) -> Floats:
    """The best of the points on the way to the minimum for these signs where a sign turns, and that minimum."""
    _, goal, failed = dposv(gram, products - penalty * signs, lower=1)
    way = (np.linalg.lstsq(gram, products - penalty * signs, rcond=None)[0] if failed else goal) - codes
    turning = np.flatnonzero((codes != 0.0) & (codes * (codes + way) < 0.0))
    if not turning.size:
        return np.asarray(codes + way)
    ends = np.append(-codes[turning] / way[turning], 1.0)
    points = codes + ends[:, None] * way
    points[np.arange(len(turning)), turning] = 0.0
    values = np.sum((0.5 * points @ gram - products) * points + penalty * np.abs(points), axis=1)
    best: Floats = points[values.argmin()]
    return best
