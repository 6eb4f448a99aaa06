"""What the methods that learn from a dictionary share: the body in its own frame, and the way back."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Floats
from mocapclean.dictionaries.body_parts import PARTS
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics import interpolation
from mocapclean.numerics.smoothness import smooth
from mocapclean.solvers.fillable import fillable
from mocapclean.take import Solution, Take


class Body:
    """A take in the order and the frame of a dictionary.

    trusted: (F, M); local: (F, M, 3), 0 where untrusted; the columns are the dictionary's.
    """

    def __init__(self, take: Take, dictionary: Dictionary) -> None:
        """Raise UsageError when the dictionary is of other markers or another rate."""
        self.dictionary, self._columns = dictionary, dictionary.columns(take)
        self.trusted = take.trusted[:, self._columns]
        positions = np.where(self.trusted[..., None], take.positions[:, self._columns], 0.0)
        self._frames = dictionary.frames(positions, self.trusted)
        self.local = np.where(self.trusted[..., None], self._frames.to_local(positions), 0.0)

    def interpolated(self) -> Floats:
        """Straight lines in the frame of the body, (F, M, 3)."""
        return interpolation.linear(self.local, self.trusted)

    def parts(self) -> Iterator[tuple[str, NDArray[np.intp]]]:
        """The parts that have markers, and their columns."""
        names = self.dictionary.markers
        for part in PARTS:
            members = self.dictionary.parts.parts[part]
            if members:
                yield part, np.array([names.index(name) for name in members], dtype=np.intp)

    def blended(self, estimate: Floats) -> Floats:
        """The estimate (F, M, 3) with its error on trusted samples carried linearly across the gaps."""
        return estimate + interpolation.linear(self.local - estimate, self.trusted)

    def to_world(self, local: Floats) -> Floats:
        """Positions (F, M, 3) in the take's order and frame."""
        positions = np.empty_like(local)
        positions[:, self._columns] = self._frames.to_world(local)
        return positions


def finish(
    take: Take,
    body: Body,
    estimate: Floats,
    *,
    blend: bool,
    denoise: float,
    facts: Mapping[str, float | int | str],
) -> Solution:
    """The Solution for an estimate (F, M, 3) in the frame of the body."""
    positions = body.to_world(body.blended(estimate) if blend else estimate)
    moved = None
    if denoise:
        noisy = np.where(take.trusted[..., None], take.positions, positions).reshape(len(positions), -1)
        positions = smooth(noisy, denoise, 2, flat_ends=False).reshape(positions.shape)
        moved = take.trusted.copy()
    return Solution(positions=positions, filled=fillable(take.trusted), facts=facts, moved=moved)
