"""Still samples: those that repeat the one before exactly."""

import numpy as np

from mocapclean.arrays import Bools, Floats

# Chosen by hand on the takes of `bench trust`, seeds 0 to 4 (docs/results.md); no sweep was kept.
_STILL = 0.005  # mm per frame, change of a coordinate that counts as none
_MOST_STILL = 0.5  # share of a marker's trusted samples that are still from which on it rests


def still_samples(positions: Floats, trusted: Bools) -> Bools:
    """Return the samples (F, M) of positions (F, M, 3) that repeat the trusted (F, M) sample before."""
    still = np.zeros_like(trusted)
    still[1:] = (np.abs(np.diff(positions, axis=0)) <= _STILL).all(axis=2) & trusted[1:] & trusted[:-1]
    return still


def resting(still: Bools, trusted: Bools) -> Bools:
    """Return the markers (M,) that are still in half of their trusted samples (F, M), and thus at rest."""
    return np.asarray(still.sum(axis=0) >= _MOST_STILL * trusted.sum(axis=0))
