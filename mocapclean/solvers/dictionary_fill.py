"""A take in the body coordinates of a dictionary, and the Solution from an estimate in them; for llc and srmmp."""

from collections.abc import Iterator, Mapping

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.dictionaries.body_parts import PARTS
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.numerics import interpolation
from mocapclean.numerics.smoothness import smooth
from mocapclean.take import Solution, Take

_DIFFERENCE_ORDER = 2  # second differences, whose squares the parameter ``denoise`` weighs


class BodyTake:
    """A take in the marker order and the body coordinates of a dictionary.

    trusted: (F, M). local: (F, M, 3) millimetres in the coordinates that travel with the body, 0 where untrusted. The
    columns of both are the dictionary's.
    """

    def __init__(self, take: Take, dictionary: Dictionary) -> None:
        """Raise UsageError where the dictionary is of other markers or another rate."""
        self.dictionary, self._columns = dictionary, dictionary.columns(take)
        self.trusted = take.trusted[:, self._columns]
        positions = np.where(self.trusted[..., None], take.positions[:, self._columns], 0.0)
        self._frames = dictionary.frames(positions, self.trusted)
        self.local = np.where(self.trusted[..., None], self._frames.to_local(positions), 0.0)

    def interpolated(self) -> Floats:
        """Return straight lines across the gaps in body coordinates, (F, M, 3)."""
        return interpolation.linear(self.local, self.trusted)

    def parts(self) -> Iterator[tuple[str, Ints]]:
        """Yield the parts of the body that have markers, and the columns of these."""
        names = self.dictionary.markers
        for part in PARTS:
            members = self.dictionary.parts.parts[part]
            if members:
                yield part, np.array([names.index(name) for name in members], dtype=np.intp)

    def blended(self, estimate: Floats) -> Floats:
        """Return the estimate (F, M, 3) plus its residual on trusted samples, interpolated across the gaps."""
        return estimate + interpolation.linear(self.local - estimate, self.trusted)

    def to_world(self, local: Floats) -> Floats:
        """Return positions (F, M, 3) in the marker order and coordinates of the take."""
        positions = np.empty_like(local)
        positions[:, self._columns] = self._frames.to_world(local)
        return positions


def solution_of(
    take: Take,
    body: BodyTake,
    estimate: Floats,
    fillable: Bools,
    *,
    blend: bool,
    denoise: float,
    facts: Mapping[str, float | int | str],
) -> Solution:
    """Return the Solution for an estimate (F, M, 3) in body coordinates.

    blend: whether the residual on the samples adjacent to a gap is carried into it. denoise: the weight of squared
    second differences, 0 for none; with it all trusted samples are ``moved``.
    """
    positions = body.to_world(body.blended(estimate) if blend else estimate)
    moved = None
    if denoise:
        noisy = np.where(take.trusted[..., None], take.positions, positions).reshape(len(positions), -1)
        positions = smooth(noisy, denoise, _DIFFERENCE_ORDER, flat_ends=False).reshape(positions.shape)
        moved = take.trusted.copy()
    return Solution(positions=positions, filled=fillable, facts=facts, moved=moved)
