"""The frames used for one part of a gap: training frames, test windows, samples beside it, and its own."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mocapclean.arrays import Bools, Ints

N_FOLDS = 3  # folds of the cross-validation over windows; chosen by hand, no sweep was kept


@dataclass(frozen=True, kw_only=True)
class SamplingPlan:
    """The frames of the take by the purpose that they serve for one gap segment.

    training: (n,) frames to learn from.
    windows: (w, m + s) frames of the windows, each with its m frames inside and s adjacent frames.
    inside, adjacent: (m,) and (s,) the same frames counted from the first frame of a window.
    adjacent_known: (w, s) whether the marker is known in the adjacent frames.
    gap_adjacent: (k,) frames on both sides of the gap in which the marker is known.
    gap: (L,) the frames of the gap segment.
    """

    training: Ints
    windows: Ints
    inside: Ints
    adjacent: Ints
    adjacent_known: Bools
    gap_adjacent: Ints
    gap: Ints

    @property
    def frames(self) -> Ints:
        """All frames in the order training, windows, gap_adjacent, gap."""
        return np.concatenate([self.training, self.windows.ravel(), self.gap_adjacent, self.gap])

    @property
    def parts(self) -> tuple[slice, slice, slice, slice]:
        """The slices of ``frames`` that hold training, windows, gap_adjacent and gap."""
        sizes = [len(self.training), self.windows.size, len(self.gap_adjacent), len(self.gap)]
        a, b, c, d = np.cumsum(sizes).tolist()
        return slice(0, a), slice(a, b), slice(b, c), slice(c, d)

    @cached_property
    def known_patterns(self) -> list[tuple[Ints, Ints]]:
        """The windows (g,) whose adjacent frames are known in one pattern, and the indices (k,) of these frames."""
        windows_of: dict[bytes, list[int]] = {}
        for window, pattern in enumerate(self.adjacent_known):
            windows_of.setdefault(pattern.tobytes(), []).append(window)
        return [(np.array(windows), np.flatnonzero(self.adjacent_known[windows[0]])) for windows in windows_of.values()]

    @property
    def folds(self) -> Ints:
        """The fold (w,) in which each window is held out."""
        return np.arange(len(self.windows)) % N_FOLDS

    def held_out(self, margin: int) -> Bools:
        """Return the training frames (folds, n) within ``margin`` frames of a window of each fold."""
        first, last = self.windows[:, :1] - margin, self.windows[:, len(self.inside) - 1, None] + margin
        within = (self.training >= first) & (self.training <= last)
        return np.stack([within[self.folds == fold].any(axis=0) for fold in range(N_FOLDS)])
