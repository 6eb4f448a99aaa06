"""K-SVD: residuals orthogonal to chosen atoms, unit norms, an error that falls, and atoms of planted signals."""

import numpy as np
import pytest

from mocapclean.numerics.coding.dictionary_learning import (
    _update_atoms,
    ksvd,
    learn_with_hidden_entries,
    normalised,
    scaled_to_use,
    sparse_codes,
)
from mocapclean.numerics.coding.sparse_coding import batch_omp, dense_codes


def planted(rng, n_signals=600):
    """(atoms, signals) of 12 atoms in 20 dimensions, 2 in each signal."""
    atoms = normalised(rng.normal(size=(12, 20)))
    chosen = np.array([rng.choice(12, 2, replace=False) for _ in range(n_signals)])
    return atoms, dense_codes(chosen, rng.uniform(1, 2, (n_signals, 2)), 12) @ atoms


def test_pursuit_leaves_residuals_orthogonal_to_what_it_chose(rng):
    atoms, signals = normalised(rng.normal(size=(30, 12))), rng.normal(size=(50, 12))
    chosen, values = batch_omp(atoms, signals, 5)
    residual = signals - dense_codes(chosen, values, 30) @ atoms
    assert np.abs(np.einsum("nd,ntd->nt", residual, atoms[chosen])).max() < 1e-9
    assert all(len(set(row)) == 5 for row in chosen)


def test_pursuit_finds_the_nearest_atom_and_never_asks_for_more_than_there_are(rng):
    atoms = normalised(rng.normal(size=(3, 12)))
    chosen, values = batch_omp(atoms, 4 * atoms, 1)
    assert chosen[:, 0].tolist() == [0, 1, 2]
    assert values == pytest.approx(4.0)
    assert batch_omp(atoms, atoms, 9)[0].shape == (3, 3)


def test_the_atom_update_lowers_the_error_and_keeps_unit_norms(rng):
    _, signals = planted(rng)
    atoms = normalised(signals[:12].copy())
    chosen, values = batch_omp(atoms, signals, 2)

    def error():
        return np.sum((signals - sparse_codes(chosen, values, 12) @ atoms) ** 2)

    before = error()
    for _ in range(3):
        _update_atoms(atoms, signals, chosen, values)
        assert error() < before
        before = error()
    assert np.linalg.norm(atoms, axis=1) == pytest.approx(1.0)


def test_sweeps_find_atoms_that_code_planted_signals(rng):
    _, signals = planted(rng)

    def error(sweeps):
        atoms = ksvd(signals, 24, 2, sweeps, np.random.default_rng(3))
        chosen, values = batch_omp(atoms, signals, 2)
        assert np.linalg.norm(atoms, axis=1) == pytest.approx(1.0)
        return np.sum((signals - dense_codes(chosen, values, 24) @ atoms) ** 2) / np.sum(signals**2)

    assert error(40) < min(0.05, 0.5 * error(1))


def test_learning_with_holes_lowers_the_error_where_they_are(rng):
    _, signals = planted(rng)
    atoms = ksvd(signals, 12, 2, 10, rng)
    hidden = np.zeros((3, 20), dtype=bool)
    hidden[0, :3] = hidden[1, 3:6] = hidden[2, 6:] = True
    pattern = rng.integers(3, size=len(signals))

    def error(trained):
        total = 0.0
        for k, holes in enumerate(hidden):
            norms = np.linalg.norm(trained[:, ~holes], axis=1)
            rows = signals[pattern == k]
            chosen, values = batch_omp(trained[:, ~holes] / norms[:, None], rows[:, ~holes], 2)
            rebuilt = dense_codes(chosen, values / norms[chosen], 12) @ trained
            total += np.sum((rows - rebuilt)[:, holes] ** 2)
        return total

    start = error(atoms)
    for _ in range(5):
        atoms = learn_with_hidden_entries(atoms, signals, hidden, pattern, 2, 1.0)
    assert error(atoms) < start
    assert np.linalg.norm(atoms, axis=1).max() <= 1 + 1e-12


def test_scaled_atoms_have_the_length_and_sign_of_their_use(rng):
    atoms = normalised(rng.normal(size=(2, 6)))
    signals = np.concatenate([-3 * atoms[:1]] * 4 + [5 * atoms[1:]] * 4)
    assert scaled_to_use(atoms, signals, 1) == pytest.approx(np.stack([-3 * atoms[0], 5 * atoms[1]]))
