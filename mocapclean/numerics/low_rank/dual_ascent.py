"""Singular value thresholding as it is printed, gradient ascent on the dual, with and without cone constraints.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the known entries,  ‖C_i z‖ ≤ d_i for every i

With multipliers y of the equalities and (p_i, s_i) in the second-order cone {‖p‖ ≤ s} of the inequalities, the
minimiser for given multipliers is Z = 𝒟_τ(y + Σ C_iᵀ p_i), and the dual gradient is (B − Z, −C z, −d).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values, singular_values

Indices = NDArray[np.intp]

_POWER_ITERATIONS = 30
_TINY = np.finfo(np.float64).tiny


class Edges:
    """Upper bounds ‖z_a − z_b‖ ≤ d on pairs of samples, all at once.

    first, second: (N,) indices into the samples (F · m, 3) of a matrix (F, 3m) in C order. lengths: (N,).
    """

    def __init__(self, first: Indices, second: Indices, lengths: Floats, n_samples: int) -> None:
        self.lengths = lengths
        rows, ones = np.arange(len(lengths)), np.ones(len(lengths))
        entries = np.concatenate([ones, -ones]), (np.tile(rows, 2), np.concatenate([first, second]))
        self._difference = csr_array(entries, shape=(len(lengths), n_samples))
        self._adjoint = self._difference.T.tocsr()

    def differences(self, matrix: Floats) -> Floats:
        """z_a − z_b, (N, 3)."""
        differences: Floats = self._difference @ matrix.reshape(-1, 3)
        return differences

    def add_adjoint(self, target: Floats, vectors: Floats) -> None:
        """Add Σ C_iᵀ p_i of vectors (N, 3) to a matrix (F, 3m) in place."""
        samples = target.reshape(-1, 3)
        samples += self._adjoint @ vectors

    def excess(self, differences: Floats) -> float:
        """How much the worst of (N, 3) is longer than its bound, at least 0."""
        longer = np.sqrt(np.einsum("nc,nc->n", differences, differences)) - self.lengths
        return float(longer.max(initial=0.0))

    def curvature(self, known: Bools) -> float:
        """A tight upper bound of the largest eigenvalue of AᵀA + CᵀC, A the selection of the known (F, 3m) entries.

        By Collatz and Wielandt max (Hx)_i / x_i over i, for any x > 0, bounds the spectral radius of H ≥ 0; H is
        the matrix with its entries' magnitudes, which on a tree of bones has the same spectrum.
        """
        magnitudes = abs(self._difference)
        adjoint, own = magnitudes.T.tocsr(), known[:, ::3].ravel().astype(float)
        x = np.ones(len(own))
        for _ in range(_POWER_ITERATIONS):
            image = own * x + adjoint @ (magnitudes @ x)
            bound = float(np.max(image / x, initial=1.0))
            x += image
        return bound

    def columns(self, samples: Indices) -> csr_array:
        """C as a matrix (N, U) of these samples (U,) only."""
        return csr_array(self._difference[:, samples])


def no_edges(n_samples: int) -> Edges:
    """No inequality at all: plain singular value thresholding."""
    none = np.zeros(0, dtype=np.intp)
    return Edges(none, none, np.zeros(0), n_samples)


def project_to_cones(vectors: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """The nearest points of the cones ‖p‖ ≤ s to vectors (N, 3) and heights (N,)."""
    norms = np.sqrt(np.einsum("nc,nc->n", vectors, vectors))
    lifted = np.where(norms <= heights, heights, np.maximum((norms + heights) / 2.0, 0.0))
    return vectors * (np.minimum(lifted, norms) / np.maximum(norms, _TINY))[:, None], lifted


@dataclass(kw_only=True)
class Iterate:
    """A matrix (F, n), the iterate, and how far it has come.

    residual: root mean square of its miss over the known entries. excess: how much the worst inequality is broken.
    trace: the residual after every iteration.
    """

    matrix: Floats
    residual: float = np.inf
    excess: float = np.inf
    trace: list[float] = field(default_factory=list)
    converged: bool = False


@dataclass(kw_only=True)
class Ascent(Iterate):
    """With its multipliers: ``equality`` (F, n), ``vectors`` (N, 3) and ``heights`` (N,).

    skipped: how many iterations the kick-start jumped over.
    """

    equality: Floats
    vectors: Floats
    heights: Floats
    skipped: int


def ascend(
    values: Floats,
    known: Bools,
    edges: Edges,
    *,
    threshold: float,
    step: float,
    tolerance: float,
    excess_tolerance: float,
    max_iterations: int,
) -> Ascent:
    """Ascend until residual and excess are within their tolerances.

    values: (F, n), B where known and 0 elsewhere. ``step`` must be below 2 / ‖AᵀA + CᵀC‖. The kick-start is exact:
    while ‖y‖₂ ≤ τ, Z is 0 and so every p_i and s_i, and y grows by the step times B.
    """
    mask = known.astype(float)
    scale = max(int(known.sum()), 1) ** -0.5
    n_edges = len(edges.lengths)
    skipped = _skipped(float(singular_values(values).max(initial=0.0)), threshold, step)
    now = Ascent(
        matrix=np.zeros_like(values),
        equality=values * (1 + skipped * step),
        vectors=np.zeros((n_edges, 3)),
        heights=np.zeros(n_edges),
        skipped=skipped,
    )
    residual, total = np.empty_like(values), np.empty_like(values)
    while len(now.trace) < max_iterations:
        np.copyto(total, now.equality)
        edges.add_adjoint(total, now.vectors)
        shrink_singular_values(total, threshold, out=now.matrix)
        np.subtract(values, now.matrix, out=residual)
        residual *= mask
        differences = edges.differences(now.matrix)
        now.residual, now.excess = scale * float(np.linalg.norm(residual)), edges.excess(differences)
        now.trace.append(now.residual)
        if now.residual <= tolerance and now.excess <= excess_tolerance:
            now.converged = True
            break
        residual *= step
        now.equality += residual
        now.vectors, now.heights = project_to_cones(
            now.vectors - step * differences, now.heights - step * edges.lengths
        )
    return now


def _skipped(norm: float, threshold: float, step: float) -> int:
    return max(int((threshold / norm - 1.0) / step), 0) if norm > 0 else 0
