"""Singular value thresholding with bounds, by splitting: the problem of ``dual_ascent`` in far fewer iterations.

    min_Z  τ‖Z‖_* + ½‖Z‖_F²    subject to  Z = B on the known entries,  ‖C_i z‖ ≤ d_i for every i

X and e_i are copies of Z and C_i z, one for the norms and one for the bounds. With a t > 0 and a state v, w of their
sizes, one iteration is

    X = 𝒟_{τt/(1+t)}(v / (1 + t))    e_i = w_i d_i / max(d_i, ‖w_i‖)
    Z = argmin ‖Z − (2X − v)‖² + Σ ‖C_i z − (2e_i − w_i)‖²  with Z = B on the known entries
    v += Z − X    w_i += C_i z − e_i

This is Douglas-Rachford splitting: J. Eckstein, D. P. Bertsekas, 1992, doi:10.1007/BF01581204. It tends to the minimum
for every t; then (v − X) / t and (w − e) / t are the multipliers. Anderson's extrapolation hastens it.
"""

import numpy as np
from scipy.sparse import eye_array
from scipy.sparse.linalg import splu

from mocapclean.arrays import Bools, Floats
from mocapclean.numerics.low_rank.dual_ascent import Edges, Iterate
from mocapclean.numerics.low_rank.extrapolation import Anderson
from mocapclean.numerics.low_rank.shrinkage import shrink_singular_values, singular_values

_STILL = 0.1


class Feasible:
    """The pairs (Z, C z) with Z = B on the known entries, and the nearest of them to a matrix and vectors.

    unknown: (U,) the samples of Z that are free.
    """

    def __init__(self, values: Floats, known: Bools, edges: Edges) -> None:
        self.unknown = np.flatnonzero(~known[:, ::3].ravel())
        self._values, self._fixed = values, edges.differences(values)
        self._inner = edges.columns(self.unknown)
        self._outer = self._inner.T.tocsr()
        n_unknown = len(self.unknown)
        self._system = splu((eye_array(n_unknown) + self._outer @ self._inner).tocsc()) if n_unknown else None

    def nearest(self, matrix: Floats, vectors: Floats) -> tuple[Floats, Floats]:
        """Z (F, n) and C z (N, 3) nearest to a matrix (F, n) and vectors (N, 3)."""
        nearest = self._values.copy()
        if self._system is None:
            return nearest, self._fixed
        pull = matrix.reshape(-1, 3)[self.unknown] + self._outer @ (vectors - self._fixed)
        free = self._system.solve(pull)
        nearest.reshape(-1, 3)[self.unknown] = free
        return nearest, self._fixed + self._inner @ free


def complete(
    values: Floats,
    known: Bools,
    edges: Edges,
    *,
    threshold: float,
    penalty: float,
    memory: int,
    tolerance: float,
    excess_tolerance: float,
    max_iterations: int,
) -> Iterate:
    """Iterate until X and Z agree, on the known and on the unknown entries, and no bound is broken by too much.

    values: (F, n), B where known and 0 elsewhere. penalty: ‖B‖₂ / (τt). memory: that of Anderson's extrapolation.
    tolerance: root mean square of Z − X over the known entries; a tenth of it over the unknown ones, which have farther
    to go. The answer is X.
    """
    feasible = Feasible(values, known, edges)
    step = (float(singular_values(values).max(initial=0.0)) or 1.0) / (penalty * threshold)
    state = np.concatenate([values.ravel(), np.zeros(3 * len(edges.lengths))])
    ahead = Anderson(memory, state.size)
    n_known, mask = max(int(known.sum()), 1), known.astype(float)
    n_unknown = max(known.size - n_known, 1)
    now = Iterate(matrix=np.zeros_like(values))
    while len(now.trace) < max_iterations:
        v, w = state[: values.size].reshape(values.shape), state[values.size :].reshape(-1, 3)
        shrink_singular_values(v / (1.0 + step), threshold * step / (1.0 + step), out=now.matrix)
        held = w * (edges.lengths / np.maximum(edges.lengths, np.linalg.norm(w, axis=1)))[:, None]
        matrix, differences = feasible.nearest(2.0 * now.matrix - v, 2.0 * held - w)
        matrix -= now.matrix
        differences = differences - held
        total, missed = float(np.vdot(matrix, matrix)), float(np.linalg.norm(matrix * mask))
        now.residual = missed / n_known**0.5
        now.excess = edges.excess(edges.differences(now.matrix))
        now.trace.append(now.residual)
        apart = (max(total - missed**2, 0.0) / n_unknown) ** 0.5
        settled = now.residual <= tolerance and apart <= _STILL * tolerance
        if settled and now.excess <= excess_tolerance:
            now.converged = True
            break
        state = ahead.next(state, state + np.concatenate([matrix.ravel(), differences.ravel()]))
    return now
