"""Pairs of markers at known distances, and the correction of filled samples towards these distances."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.bone_projection import project_to_bone_lengths
from mocapclean.numerics.robust import median
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from mocapclean.take import Take
from mocapclean.take.bones import known_bones, rigid_pairs

# Chosen by hand, to keep the weights below finite; no sweep was kept.
MIN_SAMPLE_SD = 1e-3  # of the median SD of all filled samples, the least SD of a sample
MIN_BONE_SD = 1e-6  # of the same median, the least SD of a bone


@dataclass(frozen=True)
class Bones:
    """Pairs of markers whose distance is known: the bones of the skeleton and the most rigid pairs of the take.

    ends: (E, 2) columns of the markers. lengths: (E,) mm. spreads: (E,) mm, SDs of the lengths, 0 for the skeleton's.
    """

    ends: Ints
    lengths: Floats
    spreads: Floats

    @classmethod
    def of_take(cls, take: Take, max_spread: float, distances: NeighbourDistances) -> "Bones":
        """Return the skeleton's bones, and the rigid pairs whose distance has an SD of at most ``max_spread`` mm.

        distances: those that tell neighbours; a pair of which one is computed from the other is no bone.
        """
        columns = {name: column for column, name in enumerate(take.markers)}
        known = known_bones(take.markers, take.skeleton) if take.skeleton else ()
        neighbours = np.isfinite(distances.variance)
        measured = [
            bone
            for bone in rigid_pairs(take)
            if bone.spread <= max_spread and neighbours[columns[bone.start], columns[bone.end]]
        ]
        # The skeleton's length replaces a measured one of the same pair.
        bones = {frozenset((bone.start, bone.end)): bone for bone in (*measured, *known)}.values()
        ends = np.array([(columns[bone.start], columns[bone.end]) for bone in bones], dtype=np.intp).reshape(-1, 2)
        return cls(ends, np.array([bone.length for bone in bones]), np.array([bone.spread for bone in bones]))

    def restored(self, positions: Floats, sd: Floats, trusted: Bools) -> Floats:
        """Return positions (F, M, 3) with filled samples moved towards the bone lengths by weighted least squares.

        sd: (F, M) mm, NaN where nothing is filled. Samples with a large SD move most.
        """
        filled = np.isfinite(sd)
        if not len(self.ends) or not filled.any():
            return positions
        # min Σ p |y - t|² + Σ w (length error)²: p = m / sd², w = m / spread², m the median variance.
        median_variance = median(sd[filled]) ** 2
        median_sd = np.sqrt(median_variance)
        precision = median_variance / np.where(filled, np.maximum(sd, MIN_SAMPLE_SD * median_sd), 1.0) ** 2
        weights = median_variance / np.maximum(self.spreads, MIN_BONE_SD * median_sd) ** 2
        return project_to_bone_lengths(positions, filled, trusted, self.ends, self.lengths, weights, precision)[0]
