"""Upper bounds on the distances between pairs of samples of a matrix."""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, Ints

# Power iterations for the bound on the curvature; chosen by hand, every number of them gives a valid bound.
_POWER_ITERATIONS = 30


class DistanceBounds:
    """The bounds ‖z_a − z_b‖ ≤ d of N pairs of samples, and their difference operator C.

    first, second: (N,) indices a and b into the samples (F · m, 3) of a matrix (F, 3m) in C order. lengths: (N,), d.
    """

    def __init__(self, first: Ints, second: Ints, lengths: Floats, n_samples: int) -> None:
        self.first, self.second, self.lengths = first, second, lengths
        rows, ones = np.arange(len(lengths)), np.ones(len(lengths))
        entries = np.concatenate([ones, -ones]), (np.tile(rows, 2), np.concatenate([first, second]))
        self._difference = scipy.sparse.csr_array(entries, shape=(len(lengths), n_samples))
        self._adjoint = self._difference.T.tocsr()

    def differences(self, matrix: Floats) -> Floats:
        """Return z_a − z_b (N, 3) of the samples of a matrix (F, 3m)."""
        differences: Floats = self._difference @ matrix.reshape(-1, 3)
        return differences

    def add_adjoint(self, target: Floats, vectors: Floats) -> None:
        """Add Σ C_iᵀ p_i of vectors (N, 3) to a matrix (F, 3m) in place."""
        samples = target.reshape(-1, 3)
        samples += self._adjoint @ vectors

    def excess(self, differences: Floats) -> float:
        """Return the largest excess of the norms of differences (N, 3) over their bounds, at least 0."""
        longer = np.sqrt(np.einsum("nc,nc->n", differences, differences)) - self.lengths
        return float(longer.max(initial=0.0))

    def curvature(self, known: Bools) -> float:
        """Return a tight upper bound of the largest eigenvalue of AᵀA + CᵀC, A the selection of known (F, 3m) entries.

        For any x > 0, the maximum of (Hx)_i / x_i over i bounds the spectral radius of H ≥ 0 (Collatz and Wielandt).
        H is the matrix of the entries' magnitudes, which on a tree of bones has the same spectrum.
        """
        magnitudes = abs(self._difference)
        adjoint, own = magnitudes.T.tocsr(), known[:, ::3].ravel().astype(float)
        x = np.ones(len(own))
        for _ in range(_POWER_ITERATIONS):
            image = own * x + adjoint @ (magnitudes @ x)
            bound = float(np.max(image / x, initial=1.0))
            x += image
        return bound

    def columns(self, samples: Ints) -> "scipy.sparse.csr_array":
        """Return the columns (N, U) of C for samples (U,)."""
        return scipy.sparse.csr_array(self._difference[:, samples])


def no_bounds(n_samples: int) -> DistanceBounds:
    """Return an empty set of bounds, which makes the problem plain singular value thresholding."""
    none = np.zeros(0, dtype=np.intp)
    return DistanceBounds(none, none, np.zeros(0), n_samples)
