"""Dictionaries learnt from signals: K-SVD, and its sequel for signals that will have holes."""

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.coding.sparse_coding import batch_omp

_FEWEST_USERS = 4
_TWINS = 0.99
_RIDGE = 1e-3


def ksvd(
    signals: Floats,
    n_atoms: int,
    n_nonzero: int,
    sweeps: int,
    rng: np.random.Generator,
    tick: Callable[[], None] = lambda: None,
) -> Floats:
    """Atoms (K, d) of unit norm that code signals (N, d) with ``n_nonzero`` atoms each; K = min(n_atoms, N).

    Approximate K-SVD: M. Aharon, M. Elad, A. Bruckstein, 2006, doi:10.1109/TSP.2006.881199, and R. Rubinstein et al.,
    2008. The first atoms are random signals. After each sweep but the last, atoms with fewer than 4 users or a twin
    (coherence above 0.99) give way to signals drawn in proportion to their squared error, since the neighbours in
    time of the worst one are as bad and all alike.
    """
    atoms = unit(signals[rng.choice(len(signals), min(n_atoms, len(signals)), replace=False)])
    for sweep in range(sweeps):
        chosen, values = batch_omp(atoms, signals, n_nonzero)
        _update_atoms(atoms, signals, chosen, values)
        if sweep + 1 < sweeps:
            _replace_idle(atoms, signals, chosen, values, rng)
        tick()
    return atoms


def unit(vectors: Floats) -> Floats:
    """Rows (n, d) scaled to norm 1; rows of zeros stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny))


def users(chosen: Ints, n_atoms: int) -> tuple[Ints, Ints]:
    """Places in chosen.ravel(), atom after atom, and where each atom's begin (K + 1,)."""
    order = np.argsort(chosen, axis=None, kind="stable")
    return order, np.searchsorted(chosen.ravel()[order], np.arange(n_atoms + 1))


def _update_atoms(atoms: Floats, signals: Floats, chosen: Ints, values: Floats) -> None:
    """One pass over the atoms, in place: d = E g / ‖E g‖, g = E d, with E the error left by all others."""
    order, begin = users(chosen, len(atoms))
    flat = values.reshape(-1)
    for atom in range(len(atoms)):
        places = order[begin[atom] : begin[atom + 1]]
        weights = flat[places]
        if not weights.any():
            continue
        rows = places // chosen.shape[1]
        others = atoms[chosen[rows]]
        error = signals[rows] - (values[rows][:, None] @ others)[:, 0] + weights[:, None] * atoms[atom]
        direction = weights @ error
        length = np.linalg.norm(direction)
        if length > 0.0:
            atoms[atom] = direction / length
            flat[places] = error @ atoms[atom]


def _replace_idle(atoms: Floats, signals: Floats, chosen: Ints, values: Floats, rng: np.random.Generator) -> None:
    codes = sparse(chosen, values, len(atoms))
    error = np.sum((signals - codes @ atoms) ** 2, axis=1)
    twin = np.triu(np.abs(atoms @ atoms.T) > _TWINS, k=1).any(axis=0)
    idle = np.flatnonzero(twin | (np.bincount(chosen.ravel(), minlength=len(atoms)) < _FEWEST_USERS))
    idle = idle[: np.count_nonzero(error)]
    if idle.size:
        atoms[idle] = unit(signals[rng.choice(len(signals), len(idle), replace=False, p=error / error.sum())])


def sparse(chosen: Ints, values: Floats, n_atoms: int) -> csr_array:
    """The codes as a sparse (N, K) matrix."""
    begin = np.arange(0, chosen.size + 1, chosen.shape[1])
    return csr_array((values.ravel(), chosen.ravel(), begin), shape=(len(chosen), n_atoms))


def learn_holes(
    atoms: Floats, signals: Floats, hidden: Bools, pattern: Ints, n_nonzero: int, hidden_weight: float
) -> Floats:
    """One pass of missing-aware learning: atoms (K, d) of norm 1 at most.

    signals: (N, d). hidden: (P, d) patterns of holes; pattern: (N,) which one each signal has. The codes w come from
    what is not hidden, the atoms D from everything, min Σ ‖a ∘ (y − wᵀD)‖² with a² = 1, or ``hidden_weight`` where
    hidden: row by row a weighted least squares, Z. Wang et al., 2016, eq. 2 with its constraint as a penalty.
    """
    codes = _codes_of_seen(atoms, signals, hidden, pattern, n_nonzero)
    result = np.empty_like(atoms)
    columns, group = np.unique(hidden, axis=1, return_inverse=True)
    for index, column in enumerate(columns.T):
        weight = np.where(column[pattern], hidden_weight, 1.0)
        weighted = (codes * weight[:, None]).T.tocsr()
        normal = (weighted @ codes).toarray()
        ridge = _RIDGE * np.trace(normal) / len(normal) + np.finfo(float).tiny
        normal[np.diag_indices(len(normal))] += ridge
        rows = np.flatnonzero(group.ravel() == index)
        result[:, rows] = np.linalg.solve(normal, weighted @ signals[:, rows] + ridge * atoms[:, rows])
    return np.asarray(result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1.0))


def _codes_of_seen(atoms: Floats, signals: Floats, hidden: Bools, pattern: Ints, n_nonzero: int) -> csr_array:
    n_used = min(n_nonzero, len(atoms))
    chosen, values = np.zeros((len(signals), n_used), dtype=np.intp), np.zeros((len(signals), n_used))
    for index, holes in enumerate(hidden):
        rows = np.flatnonzero(pattern == index)
        norms = np.maximum(np.linalg.norm(atoms[:, ~holes], axis=1), np.finfo(float).tiny)
        masked = atoms[:, ~holes] / norms[:, None]
        chosen[rows], values[rows] = batch_omp(masked, signals[rows][:, ~holes], n_nonzero)
        values[rows] /= norms[chosen[rows]]
    return sparse(chosen, values, len(atoms))


def prototypes(atoms: Floats, signals: Floats, n_nonzero: int) -> Floats:
    """Atoms (K, d) stretched by the mean size of their coefficients in signals (N, d), turned to their usual sign.

    An atom has neither length nor sign; what stands for a place among the signals, as locality asks, has both.
    """
    norms = np.maximum(np.linalg.norm(atoms, axis=1), np.finfo(float).tiny)
    chosen, values = batch_omp(atoms / norms[:, None], signals, n_nonzero)
    total = np.bincount(chosen.ravel(), values.ravel(), len(atoms))
    size = np.bincount(chosen.ravel(), np.abs(values).ravel(), len(atoms))
    count = np.bincount(chosen.ravel(), minlength=len(atoms))
    mean = np.where(count > 0, size / np.maximum(count, 1), np.linalg.norm(signals, axis=1).mean())
    stretched: Floats = atoms * (np.where(total < 0.0, -1.0, 1.0) * mean / norms)[:, None]
    return stretched
