"""Dictionaries learned from signals: K-SVD, and further passes for signals with missing entries."""

from collections.abc import Callable

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.numerics.coding.sparse_coding import batch_omp

# Fewest signals of an atom that is not replaced, and largest coherence |d·e| of two atoms that both stay; the values of
# R. Rubinstein's published program ksvd.
_FEWEST_USERS = 4
_LARGEST_COHERENCE = 0.99
# Ridge of the atoms' weighted least squares towards their last values, relative to the mean diagonal; chosen by hand.
_RIDGE = 1e-3


def ksvd(
    signals: Floats,
    n_atoms: int,
    n_nonzero: int,
    sweeps: int,
    rng: np.random.Generator,
    tick: Callable[[], None] = lambda: None,
) -> Floats:
    """Return atoms (K, d) of unit norm that code signals (N, d) with ``n_nonzero`` atoms each; K = min(n_atoms, N).

    Approximate K-SVD: M. Aharon, M. Elad, A. Bruckstein, 2006, doi:10.1109/TSP.2006.881199, and R. Rubinstein,
    M. Zibulevsky, M. Elad, 2008, Technion CS-2008-08. The first atoms are random signals. After each sweep but the
    last, atoms with fewer than 4 signals and one of each pair with coherence above 0.99 are replaced by signals. These
    are drawn with probabilities in proportion to their squared errors: the signals of greatest error are mostly
    neighbours in time and alike. tick: called after every sweep.
    """
    atoms = normalised(signals[rng.choice(len(signals), min(n_atoms, len(signals)), replace=False)])
    for sweep in range(sweeps):
        chosen, values = batch_omp(atoms, signals, n_nonzero)
        _update_atoms(atoms, signals, chosen, values)
        if sweep + 1 < sweeps:
            _replace_idle(atoms, signals, chosen, values, rng)
        tick()
    return atoms


def normalised(vectors: Floats) -> Floats:
    """Return rows (n, d) scaled to norm 1; rows of zeros stay."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny))


def _uses_by_atom(chosen: Ints, n_atoms: int) -> tuple[Ints, Ints]:
    """Return the positions in chosen.ravel() sorted by atom, and where those of each atom begin (K + 1,)."""
    order = np.argsort(chosen, axis=None, kind="stable")
    return order, np.searchsorted(chosen.ravel()[order], np.arange(n_atoms + 1))


def _update_atoms(atoms: Floats, signals: Floats, chosen: Ints, values: Floats) -> None:
    """Update each atom d and its coefficients g in turn, in place: d = E g / ‖E g‖, g = E d.

    E is the error of the signals that use the atom, without the atom's own part.
    """
    order, begin = _uses_by_atom(chosen, len(atoms))
    flat = values.reshape(-1)
    for atom in range(len(atoms)):
        uses = order[begin[atom] : begin[atom + 1]]
        coefficients = flat[uses]
        if not coefficients.any():
            continue
        rows = uses // chosen.shape[1]
        used = atoms[chosen[rows]]
        error = signals[rows] - (values[rows][:, None] @ used)[:, 0] + coefficients[:, None] * atoms[atom]
        direction = coefficients @ error
        length = np.linalg.norm(direction)
        if length > 0.0:
            atoms[atom] = direction / length
            flat[uses] = error @ atoms[atom]


def _replace_idle(atoms: Floats, signals: Floats, chosen: Ints, values: Floats, rng: np.random.Generator) -> None:
    """Replace atoms with few signals and the second of nearly equal atoms by signals of large error, in place."""
    codes = sparse_codes(chosen, values, len(atoms))
    error = np.sum((signals - codes @ atoms) ** 2, axis=1)
    duplicate = np.triu(np.abs(atoms @ atoms.T) > _LARGEST_COHERENCE, k=1).any(axis=0)
    idle = np.flatnonzero(duplicate | (np.bincount(chosen.ravel(), minlength=len(atoms)) < _FEWEST_USERS))
    idle = idle[: np.count_nonzero(error)]
    if idle.size:
        drawn = rng.choice(len(signals), len(idle), replace=False, p=error / error.sum())
        atoms[idle] = normalised(signals[drawn])


def sparse_codes(chosen: Ints, values: Floats, n_atoms: int) -> "scipy.sparse.csr_array":
    """Return the codes (N, K) with values (N, T) at the chosen (N, T) atoms, as a sparse matrix."""
    begin = np.arange(0, chosen.size + 1, chosen.shape[1])
    return scipy.sparse.csr_array((values.ravel(), chosen.ravel(), begin), shape=(len(chosen), n_atoms))


def learn_with_hidden_entries(
    atoms: Floats, signals: Floats, hidden: Bools, pattern: Ints, n_nonzero: int, hidden_weight: float
) -> Floats:
    """Return the atoms (K, d), of norm 1 at most, after one pass of missing-aware learning.

    signals: (N, d). hidden: (P, d), patterns of hidden entries; pattern: (N,), that of each signal. The codes w come
    from the other entries, the atoms D from all: min Σ ‖a ∘ (y − wᵀD)‖² with a² = 1, or ``hidden_weight`` where
    hidden. Each column of D is a weighted least squares: Z. Wang et al., 2016, eq. 2 with its constraint as a penalty.
    """
    codes = _codes_of_observed(atoms, signals, hidden, pattern, n_nonzero)
    learned = np.empty_like(atoms)
    # Columns of D that are hidden in the same patterns share one system, (Wᵀ A W + ridge) D = Wᵀ A Y + ridge D before.
    columns, group = np.unique(hidden, axis=1, return_inverse=True)
    for index, column in enumerate(columns.T):
        weight = np.where(column[pattern], hidden_weight, 1.0)
        weighted = (codes * weight[:, None]).T.tocsr()
        normal = (weighted @ codes).toarray()
        ridge = _RIDGE * np.trace(normal) / len(normal) + np.finfo(float).tiny
        normal[np.diag_indices(len(normal))] += ridge
        rows = np.flatnonzero(group.ravel() == index)
        learned[:, rows] = np.linalg.solve(normal, weighted @ signals[:, rows] + ridge * atoms[:, rows])
    return np.asarray(learned / np.maximum(np.linalg.norm(learned, axis=1, keepdims=True), 1.0))


def _codes_of_observed(
    atoms: Floats, signals: Floats, hidden: Bools, pattern: Ints, n_nonzero: int
) -> "scipy.sparse.csr_array":
    """Return the codes (N, K) of signals by the entries that their patterns do not hide."""
    n_used = min(n_nonzero, len(atoms))
    chosen, values = np.zeros((len(signals), n_used), dtype=np.intp), np.zeros((len(signals), n_used))
    for index, entries in enumerate(hidden):
        rows = np.flatnonzero(pattern == index)
        # Pursuit needs unit norms over the observed entries; the coefficients are scaled back.
        norms = np.maximum(np.linalg.norm(atoms[:, ~entries], axis=1), np.finfo(float).tiny)
        observed = atoms[:, ~entries] / norms[:, None]
        chosen[rows], values[rows] = batch_omp(observed, signals[rows][:, ~entries], n_nonzero)
        values[rows] /= norms[chosen[rows]]
    return sparse_codes(chosen, values, len(atoms))


def scaled_to_use(atoms: Floats, signals: Floats, n_nonzero: int) -> Floats:
    """Return atoms (K, d) with the mean length, and the more frequent sign, of their coefficients in signals (N, d).

    Atoms of K-SVD have neither length nor sign. Local coding compares signals with atoms by distance and needs both.
    """
    norms = np.maximum(np.linalg.norm(atoms, axis=1), np.finfo(float).tiny)
    chosen, values = batch_omp(atoms / norms[:, None], signals, n_nonzero)
    total = np.bincount(chosen.ravel(), values.ravel(), len(atoms))
    size = np.bincount(chosen.ravel(), np.abs(values).ravel(), len(atoms))
    count = np.bincount(chosen.ravel(), minlength=len(atoms))
    # An atom without signals gets the mean length of all signals.
    mean = np.where(count > 0, size / np.maximum(count, 1), np.linalg.norm(signals, axis=1).mean())
    scaled: Floats = atoms * (np.where(total < 0.0, -1.0, 1.0) * mean / norms)[:, None]
    return scaled
