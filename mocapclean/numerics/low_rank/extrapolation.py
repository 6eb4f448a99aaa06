"""Anderson's extrapolation of a fixed-point iteration v ← T(v)."""

import numpy as np

from mocapclean.arrays import Floats

_RIDGE = 1e-10
_WORSE = 2.0
_HISTORY = 2**25  # entries of all remembered states: 256 MB, and as much for their residuals


class Anderson:
    """The next state from the last few states' images and residuals T(v) − v.

    The affine combination of the images whose combined residuals are least: D. G. Anderson, 1965,
    doi:10.1145/321296.321305; H. F. Walker, P. Ni, 2011, doi:10.1137/10078356X; for the splitting here A. Fu,
    J. Zhang, S. Boyd, 2020, doi:10.1137/19M1290097. Where the residual comes to be twice the least one so far, the
    state is replaced by the image of the last one taken and the memory is cleared. Memory 0 is the plain iteration.
    Cost per step: 6 · memory flops and 2 · memory reads for each entry of the state.
    """

    def __init__(self, memory: int, size: int) -> None:
        """Remember ``memory`` differences of states of so many entries, or as many as take 512 MB."""
        memory = min(memory, _HISTORY // max(size, 1))
        self.memory, self._size, self.restarts = memory, size, 0
        self._images = np.empty((memory, size))
        self._residuals = np.empty((memory, size))
        self._gram = np.zeros((memory, memory))
        self._forget()

    def _forget(self) -> None:
        self._count, self._least = 0, np.inf
        self._last: tuple[Floats, Floats] | None = None

    def next(self, state: Floats, image: Floats) -> Floats:
        """The state to try after ``image`` = T(state); both (size,) or of any shape with that many entries."""
        if not self.memory:
            return image
        residual = (image - state).ravel()
        norm = float(np.linalg.norm(residual))
        if norm > _WORSE * self._least and self._last is not None:
            safe = self._last[0].reshape(image.shape)
            self.restarts += 1
            self._forget()
            return safe
        self._least = min(self._least, norm)
        flat = image.ravel()
        if self._last is not None:
            self._remember(flat - self._last[0], residual - self._last[1])
        self._last = flat, residual
        n_kept = min(self._count, self.memory)
        if not n_kept:
            return image
        gram = self._gram[:n_kept, :n_kept]
        ridge = _RIDGE * np.trace(gram) + np.finfo(np.float64).tiny
        weights = np.linalg.solve(gram + ridge * np.eye(n_kept), self._residuals[:n_kept] @ residual)
        extrapolated: Floats = flat - weights @ self._images[:n_kept]
        return extrapolated.reshape(image.shape)

    def _remember(self, image_step: Floats, residual_step: Floats) -> None:
        place = self._count % self.memory
        self._images[place], self._residuals[place] = image_step, residual_step
        self._count += 1
        n_kept = min(self._count, self.memory)
        products = self._residuals[:n_kept] @ residual_step
        self._gram[place, :n_kept] = self._gram[:n_kept, place] = products
