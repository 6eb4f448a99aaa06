"""Graduation: values that follow given ones and have small second differences.

    min Σ w_t |x_t − y_t|² + λ Σ |x_{t-1} − 2 x_t + x_{t+1}|²

E. T. Whittaker, 1923, On a new method of graduation, doi:10.1017/S0013091500077853.
"""

import numpy as np

from mocapclean.arrays import Floats


def graduated(values: Floats, weights: Floats, strength: float) -> Floats:
    """Return the x (n, d) for values y (n, d), their weights w (n,), positive, and the strength λ."""
    from scipy.linalg import solveh_banded  # long to load, and the help of the commands needs the callers

    n = len(values)
    if n < 3:
        return values
    # The diagonals of D²ᵀ D², from the second above the main one to the main one.
    bands = np.array([1.0, -4.0, 6.0])[:, None] * np.ones(n)
    bands[1, [1, -1]], bands[2, [0, -1]] = -2.0, 1.0
    bands[2, [1, -2]] = 5.0 if n > 3 else 4.0
    bands *= strength
    bands[2] += weights
    return np.asarray(solveh_banded(bands, weights[:, None] * values))
