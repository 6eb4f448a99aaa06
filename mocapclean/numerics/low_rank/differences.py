"""Differences over frames, D x = x_t − x_{t+1}, and their banded normal equations.

D is (F − 1, F): the zero last row of the papers' square D is left out. With ``keep_end`` the last row of D is e_F, as
in the last row but one of the square D² of I. Imamura, M. Okuda (2018).
"""

from itertools import pairwise

import numpy as np
import scipy

from mocapclean.arrays import Bools, Floats, Ints

# Chosen for speed: a product with an inverse of 64 rows costs as much as half of a banded solve.
_LONGEST_INVERSE = 64  # samples of a block whose inverse is multiplied
_FEWEST_ALIKE = 8  # equal blocks that an inverse is worth


def difference(values: Floats, *, keep_end: bool = False, out: Floats | None = None) -> Floats:
    """Return D applied to values (F, n): (F − 1, n), or (F, n) with ``keep_end``; F may be 0."""
    n_rows = len(values) if keep_end else max(len(values) - 1, 0)
    result = np.empty((n_rows, values.shape[1])) if out is None else out
    np.subtract(values[:-1], values[1:], out=result[: max(len(values) - 1, 0)])
    if keep_end and n_rows:
        result[-1] = values[-1]
    return result


def add_adjoint(target: Floats, rows: Floats, *, keep_end: bool = False) -> None:
    """Add Dᵀ rows to target (F, n) in place, for rows and ``keep_end`` as in ``difference``."""
    inner = rows[: max(len(target) - 1, 0)]
    target[:-1] += inner
    target[1:] -= inner
    if keep_end and len(target):
        target[-1] += rows[-1]


def normal_bands(n_frames: int, identity: float, first: float, second: float, *, keep_end: bool = False) -> Floats:
    """Return the lower bands (3, F) of identity·I + first·DᵀD + second·(DD)ᵀDD; ``keep_end`` is that of the outer D."""
    bands = np.zeros((3, n_frames))
    bands[0] = identity
    n_first, n_second = max(n_frames - 1, 0), max(n_frames - 2, 0)
    # Each first difference (1, −1) adds [[1, −1], [−1, 1]].
    bands[0, :n_first] += first
    bands[0, 1 : n_first + 1] += first
    bands[1, :n_first] -= first
    # Each second difference (1, −2, 1) adds its outer product with itself.
    for shift, weight in enumerate((1.0, 4.0, 1.0)):
        bands[0, shift : shift + n_second] += weight * second
    for shift in (0, 1):
        bands[1, shift : shift + n_second] -= 2.0 * second
    bands[2, :n_second] += second
    if keep_end and n_frames > 1:
        bands[0, -2:] += second
        bands[1, -2] -= second
    return bands


def times_bands(bands: Floats, values: Floats) -> Floats:
    """Return the product of the symmetric matrix of lower bands (3, F) with values (F, n)."""
    product = bands[0, :, None] * values
    for k in range(1, min(len(bands), len(values))):
        product[k:] += bands[k, :-k, None] * values[:-k]
        product[:-k] += bands[k, :-k, None] * values[k:]
    return product


class FreeSystem:
    """The pentadiagonal system H[u, u] x[u] = b[u] of the free samples u of each marker; all others are fixed.

    Without the rows and columns of fixed samples, H keeps its bandwidth of 2. So the free samples of all markers, one
    marker after another, form one block-diagonal pentadiagonal system: a block for each gap, where fewer than two
    fixed samples are no end of it. Gaps of one length have the same block but at the ends of a take. Where many short
    gaps share a block, its inverse is multiplied with all of them at once. One Cholesky factorisation (LAPACK pbtrf)
    and one solve serve the others. O(number of free samples).

    places: (N,) indices into the samples of an (F, M) array in C order: block by block, those that share one first.
    """

    def __init__(self, bands: Floats, free: Bools) -> None:
        """Factor the system of lower bands (3, F), which must be positive definite, on free (F, M)."""
        markers, frames = np.nonzero(free.T)
        packed = np.zeros((3, len(frames)))
        packed[0] = bands[0, frames]
        # Neighbours in the packed system that are 1 or 2 frames apart share that band of H; others share none (3).
        for k in (1, 2):
            gap = np.where(markers[k:] == markers[:-k], frames[k:] - frames[:-k], 3)[: len(frames)]
            near = np.flatnonzero(gap <= 2)
            packed[k, near] = bands[gap[near], frames[near]]
        # A block ends where the next sample shares no band with it.
        ends = np.flatnonzero(packed[1] == 0.0) + 1
        alike: dict[bytes, list[tuple[int, int]]] = {}
        for start, stop in pairwise([0, *ends.tolist()]):
            key = packed[:, start:stop].tobytes() if stop - start <= _LONGEST_INVERSE else b""
            alike.setdefault(key, []).append((start, stop))
        order: list[Ints] = []
        self._inverses: list[tuple[slice, Floats]] = []
        rest, n_placed = alike.pop(b"", []), 0
        for blocks in alike.values():
            if len(blocks) < _FEWEST_ALIKE:
                rest += blocks
                continue
            # Rows of one frame of all gaps, so that the inverse multiplies one matrix
            length = blocks[0][1] - blocks[0][0]
            starts = np.array([start for start, _ in blocks])
            order.append((np.arange(length)[:, None] + starts).ravel())
            factor = _factored(packed[:, blocks[0][0] : blocks[0][1]])
            here = slice(n_placed, n_placed + order[-1].size)
            self._inverses.append(
                (here, np.ascontiguousarray(scipy.linalg.lapack.dpbtrs(factor, np.eye(length), lower=1)[0]))
            )
            n_placed = here.stop
        order += [np.arange(start, stop) for start, stop in sorted(rest)]
        sequence = np.concatenate(order) if order else np.zeros(0, dtype=np.intp)
        self.places = (frames * free.shape[1] + markers)[sequence]
        self._rest = slice(n_placed, None)
        self._factor = _factored(packed[:, sequence[self._rest]])

    def solve(self, packed: Floats) -> Floats:
        """Return the solution (N, d) of the system for right-hand sides (N, d) in the order of ``places``."""
        solution = np.empty_like(packed)
        for here, inverse in self._inverses:
            np.matmul(inverse, packed[here].reshape(len(inverse), -1), out=solution[here].reshape(len(inverse), -1))
        if len(packed[self._rest]):
            solution[self._rest] = scipy.linalg.lapack.dpbtrs(self._factor, packed[self._rest], lower=1)[0]
        return solution


def _factored(bands: Floats) -> Floats:
    """Return the Cholesky factor of a matrix of lower bands (3, n)."""
    factor, failed = scipy.linalg.lapack.dpbtrf(bands, lower=1)
    if failed:
        raise np.linalg.LinAlgError("The banded matrix must be positive definite.")
    return np.asarray(factor)
