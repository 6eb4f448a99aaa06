"""Anderson acceleration of a fixed-point iteration v ← T(v).

D. G. Anderson, 1965, doi:10.1145/321296.321305; H. F. Walker, P. Ni, 2011, doi:10.1137/10078356X; for operator
splitting A. Fu, J. Zhang, S. Boyd, 2020, doi:10.1137/19M1290097.
"""

import numpy as np

from mocapclean.arrays import Floats

# Ridge of the least squares for the weights, relative to the trace of its Gram matrix; chosen by hand, it keeps the
# system regular where residuals are nearly parallel.
_RIDGE = 1e-10
# A residual that exceeds the least one so far by this factor restarts the acceleration; chosen by hand.
_RESTART_FACTOR = 2.0
# Most entries of all stored image differences: 256 MB, and as much for the residual differences. Chosen for memory.
_MOST_STORED_ENTRIES = 2**25


class AndersonAcceleration:
    """The states that accelerate one iteration, from its last images T(v) and residuals T(v) − v.

    The next state is the affine combination of the last images whose combined residual has the least norm. Where the
    residual becomes twice the least so far, the state goes back to the last image and the memory is cleared. Cost per
    step: 6 · memory floating-point operations and 2 · memory reads for each entry of the state.

    memory: differences that are stored; 0 leaves the iteration as it is. restarts: how often the memory was cleared.
    """

    def __init__(self, memory: int, size: int) -> None:
        """Store up to ``memory`` differences of states with ``size`` entries, or as many as take 512 MB."""
        memory = min(memory, _MOST_STORED_ENTRIES // max(size, 1))
        self.memory, self._size, self.restarts = memory, size, 0
        self._image_steps = np.empty((memory, size))
        self._residual_steps = np.empty((memory, size))
        self._gram = np.zeros((memory, memory))  # of the residual differences
        self._clear()

    def _clear(self) -> None:
        self._n_stored, self._least_norm = 0, np.inf
        self._last: tuple[Floats, Floats] | None = None

    def next_state(self, state: Floats, image: Floats) -> Floats:
        """Return the state that follows, given ``image`` = T(state); both of any shape with ``size`` entries."""
        if not self.memory:
            return image
        residual = (image - state).ravel()
        norm = float(np.linalg.norm(residual))
        if norm > _RESTART_FACTOR * self._least_norm and self._last is not None:
            last_image = self._last[0].reshape(image.shape)
            self.restarts += 1
            self._clear()
            return last_image
        self._least_norm = min(self._least_norm, norm)
        flat = image.ravel()
        if self._last is not None:
            self._store(flat - self._last[0], residual - self._last[1])
        self._last = flat, residual
        n_kept = min(self._n_stored, self.memory)
        if not n_kept:
            return image
        # γ = argmin ‖r − γ ΔR‖², v = T(v) − γ ΔT: the affine combination, written with differences
        gram = self._gram[:n_kept, :n_kept]
        ridge = _RIDGE * np.trace(gram) + np.finfo(np.float64).tiny
        weights = np.linalg.solve(gram + ridge * np.eye(n_kept), self._residual_steps[:n_kept] @ residual)
        accelerated: Floats = flat - weights @ self._image_steps[:n_kept]
        return accelerated.reshape(image.shape)

    def _store(self, image_step: Floats, residual_step: Floats) -> None:
        """Store one pair of differences over the oldest one, and update the Gram matrix."""
        row = self._n_stored % self.memory
        self._image_steps[row], self._residual_steps[row] = image_step, residual_step
        self._n_stored += 1
        n_kept = min(self._n_stored, self.memory)
        products = self._residual_steps[:n_kept] @ residual_step
        self._gram[row, :n_kept] = self._gram[:n_kept, row] = products
