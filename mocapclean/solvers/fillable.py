"""The untrusted samples that a method may fill."""

import numpy as np

from mocapclean.arrays import Bools


def fillable(trusted: Bools) -> Bools:
    """Return the untrusted samples (F, M) of markers trusted in some frame, in frames with some trusted marker."""
    return ~trusted & trusted.any(axis=0) & trusted.any(axis=1, keepdims=True)


def enclosed(trusted: Bools) -> Bools:
    """Return the untrusted samples (F, M) with a trusted sample of the same marker before and after them."""
    before = np.maximum.accumulate(trusted, axis=0)
    after = np.maximum.accumulate(trusted[::-1], axis=0)[::-1]
    return ~trusted & before & after
