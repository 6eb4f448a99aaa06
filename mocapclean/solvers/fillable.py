"""Which untrusted samples a method may answer for."""

import numpy as np

from mocapclean.arrays import Bools


def fillable(trusted: Bools) -> Bools:
    """Untrusted samples (F, M) whose marker is trusted in some frame and whose frame has some trusted marker."""
    return ~trusted & trusted.any(axis=0) & trusted.any(axis=1, keepdims=True)


def enclosed(trusted: Bools) -> Bools:
    """Fillable samples (F, M) with a trusted sample of the same marker before and after them."""
    before = np.maximum.accumulate(trusted, axis=0)
    after = np.maximum.accumulate(trusted[::-1], axis=0)[::-1]
    return fillable(trusted) & before & after
