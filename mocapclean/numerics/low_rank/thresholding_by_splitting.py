"""Singular value thresholding with bounds on distances, by operator splitting.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the known entries,  ‖C_i z‖ ≤ d_i for every i

The problem is that of ``thresholding_by_dual_ascent``, in far fewer iterations. X is a copy of Z for the norms, and e_i
one of C_i z for the bounds. With any t > 0 and a state v, w of their sizes, one iteration is

    X = 𝒟_{τt/(1+t)}(v / (1 + t))    e_i = w_i d_i / max(d_i, ‖w_i‖)
    Z = argmin ‖Z − (2X − v)‖² + Σ ‖C_i z − (2e_i − w_i)‖²  with Z = B on the known entries
    v += Z − X    w_i += C_i z − e_i

This is Douglas-Rachford splitting: J. Eckstein, D. P. Bertsekas, 1992, doi:10.1007/BF01581204. It converges to the
minimum for every t; then (v − X) / t and (w − e) / t are the multipliers. Anderson acceleration hastens it.
"""

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.anderson_acceleration import AndersonAcceleration
from mocapclean.numerics.low_rank.distance_bounds import DistanceBounds
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values, singular_values
from mocapclean.numerics.low_rank.thresholding_by_dual_ascent import Iterate

# The tolerance of Z − X over the unknown entries, relative to that over the known ones. Chosen on the takes of
# benchmarks/low_rank_sweep.csv: at an equal tolerance the missing entries were up to 15 % worse than at the minimum, at
# a tenth of it 1 %, for 20 more iterations.
_UNKNOWN_TOLERANCE = 0.1


class FeasiblePairs:
    """The set of pairs (Z, C z) with Z = B on the known entries, and the projection onto it.

    unknown: (U,) the samples of Z that are free.
    """

    def __init__(self, values: Floats, known: Bools, bounds: DistanceBounds) -> None:
        self.unknown = np.flatnonzero(~known[:, ::3].ravel())
        self._values, self._fixed = values, bounds.differences(values)
        self._free_columns = bounds.columns(self.unknown)
        self._adjoint = self._free_columns.T.tocsr()
        n_unknown = len(self.unknown)
        self._system = None
        if n_unknown:
            identity = scipy.sparse.eye_array(n_unknown)
            self._system = scipy.sparse.linalg.splu((identity + self._adjoint @ self._free_columns).tocsc())

    def nearest(self, matrix: Floats, vectors: Floats) -> tuple[Floats, Floats]:
        """Return Z (F, n) and C z (N, 3) nearest to a matrix (F, n) and vectors (N, 3), by least squares."""
        nearest = self._values.copy()
        if self._system is None:
            return nearest, self._fixed
        # (I + CᵀC) z = matrix + Cᵀ(vectors − C of the known samples), on the unknown samples z
        right_side = matrix.reshape(-1, 3)[self.unknown] + self._adjoint @ (vectors - self._fixed)
        free = self._system.solve(right_side)
        nearest.reshape(-1, 3)[self.unknown] = free
        return nearest, self._fixed + self._free_columns @ free


def threshold_by_splitting(
    values: Floats,
    known: Bools,
    bounds: DistanceBounds,
    *,
    threshold: float,
    penalty: float,
    memory: int,
    tolerance: float,
    excess_tolerance: float,
    max_iterations: int,
) -> Iterate:
    """Iterate until X and Z agree and no bound is exceeded by more than its tolerance; return the last iterate, X.

    values: (F, n), B where known and 0 elsewhere. threshold: τ. penalty: ‖B‖₂ / (τt). memory: that of Anderson
    acceleration. tolerance: root mean square of Z − X over the known entries; a tenth of it over the unknown ones,
    which change more until convergence.
    """
    feasible = FeasiblePairs(values, known, bounds)
    step = (float(singular_values(values).max(initial=0.0)) or 1.0) / (penalty * threshold)
    state = np.concatenate([values.ravel(), np.zeros(3 * len(bounds.lengths))])
    acceleration = AndersonAcceleration(memory, state.size)
    n_known, mask = max(int(known.sum()), 1), known.astype(float)
    n_unknown = max(known.size - n_known, 1)
    now = Iterate(matrix=np.zeros_like(values))
    while len(now.trace) < max_iterations:
        v, w = state[: values.size].reshape(values.shape), state[values.size :].reshape(-1, 3)
        # X and e: the proximal maps of the norms and of the bounds
        shrink_singular_values(v / (1.0 + step), threshold * step / (1.0 + step), out=now.matrix)
        bounded = w * (bounds.lengths / np.maximum(bounds.lengths, np.linalg.norm(w, axis=1)))[:, None]
        # Z and C z: the projection of the reflected point; then the steps Z − X and C z − e
        matrix, differences = feasible.nearest(2.0 * now.matrix - v, 2.0 * bounded - w)
        matrix -= now.matrix
        differences = differences - bounded
        # Convergence on the known entries, on the unknown ones, and of the bounds
        total, known_norm = float(np.vdot(matrix, matrix)), float(np.linalg.norm(matrix * mask))
        now.residual = known_norm / n_known**0.5
        now.excess = bounds.excess(bounds.differences(now.matrix))
        now.trace.append(now.residual)
        unknown_residual = (max(total - known_norm**2, 0.0) / n_unknown) ** 0.5
        agrees = now.residual <= tolerance and unknown_residual <= _UNKNOWN_TOLERANCE * tolerance
        if agrees and now.excess <= excess_tolerance:
            now.converged = True
            break
        state = acceleration.next_state(state, state + np.concatenate([matrix.ravel(), differences.ravel()]))
    return now
