"""Split a gap into as few parts as keep half of the neighbour weight throughout each."""

from itertools import pairwise

import numpy as np

from mocapclean.arrays import Bools, Floats

# The constants below were chosen by hand on the captures of `mocapclean bench markers`; no sweep was kept.
N_HEAVIEST = 8  # neighbours whose presence decides where a gap is split
MIN_SHARED_WEIGHT = 0.5  # of the weight of the known neighbours, that all frames of a segment have in common


def split_gap(known: Bools, weights: Floats, start: int, stop: int) -> list[tuple[int, int]]:
    """Return the parts (first frame, frame after the last) of a gap, grown while common neighbours keep half of the
    weight.

    known: (F, M) whether samples are known. weights: (M,) of the neighbours of the gap's marker.
    """
    heaviest = np.argsort(-weights, kind="stable")[:N_HEAVIEST]
    present = known[start:stop, heaviest]
    changes = np.flatnonzero((present[1:] != present[:-1]).any(axis=1)) + 1
    edges = np.concatenate([[0], changes, [stop - start]])
    segments: list[tuple[int, int]] = []
    common = np.zeros(len(heaviest), dtype=bool)
    # Extend the last segment while the neighbours known in all of it weigh enough; else begin a new one.
    for first, last in pairwise(edges.tolist()):
        here = present[first]
        shared = common & here
        least = MIN_SHARED_WEIGHT * max(weights[heaviest] @ common, weights[heaviest] @ here)
        if segments and weights[heaviest] @ shared >= least:
            segments[-1], common = (segments[-1][0], start + last), shared
        else:
            segments.append((start + first, start + last))
            common = here
    return segments
