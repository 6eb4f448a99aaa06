"""The combination of several predictions that erred least where the truth is known."""

import numpy as np
from scipy.optimize import nnls

from mocapclean.arrays import Floats

_STIFF = 1e3


def stacking_weights(errors: Floats, shrinkage: float) -> Floats:
    """Weights (p,) >= 0 of sum 1 that minimise the mean square of the weighted errors (p, n).

    The errors' covariances are lessened by the share ``shrinkage`` beside their variances, since a few windows tell
    them badly. L. Breiman, 1996, Stacked regressions, doi:10.1007/BF00117832.
    """
    n = len(errors)
    moments = errors @ errors.T
    total = float(np.trace(moments))
    if n == 1 or total <= 0.0:
        return np.full(n, 1.0 / n)
    moments *= (1.0 - shrinkage) * n / total
    moments[np.diag_indices(n)] /= 1.0 - shrinkage
    root = np.linalg.cholesky(moments + 1e-9 * np.eye(n)).T
    weights, _ = nnls(np.vstack([root, np.full((1, n), _STIFF)]), np.append(np.zeros(n), _STIFF))
    found: Floats = weights / weights.sum()
    return found
