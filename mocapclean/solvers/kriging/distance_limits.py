"""Nearly rigid pairs of markers: the least and largest distance that a take shows, within which filled samples stay."""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.geometry.bone_projection import project_to_bone_lengths
from mocapclean.numerics.robust import MAD_TO_SD, median
from mocapclean.solvers.kriging.frame_selection import spread_out
from mocapclean.solvers.kriging.neighbours import MAX_DISTANCE_FRAMES, NeighbourDistances

LARGEST_SPREAD = 1.5
"""Times the rigidity parameter, the SD (3 mm) up to which the distance of a pair has limits.

With 2.5 times (5 mm) the errors were equal.
"""
MOST_PARTNERS = 6  # most rigid partners of a marker that limit it; chosen by hand, no sweep was kept
FARTHEST = 5.0  # robust SDs from the median distance, beyond which no limit is; chosen by hand, no sweep was kept
LEAST_SPREAD = 0.5  # times the rigidity parameter, the least robust SD (1 mm) that counts there; chosen by hand
LEAST_EXCESS = 0.05  # times the rigidity parameter, the excess over a limit (0.1 mm) up to which nothing moves; by hand
ROUNDS = 4  # times that moves are made and smoothed; chosen by hand, no sweep was kept
SMOOTHING = 0.03
"""SD, s, of the Gaussian by which the moves are smoothed.

Chosen among 0.015, 0.03 and 0.06 s: rigid pairs deviated as little as with the first, and fewer markers stepped too far
(``benchmarks/natural_gaps.py``).
"""
CONTRADICTION = 3.0  # SDs, and expected errors in space, beyond which a distance is no chance: the three-sigma rule
TOLERANCE = 1e-5  # of the longest distance, the residual of least squares: a few µm, below marker noise; by hand
MIN_SAMPLE_SD = 1e-3  # of the median SD of all filled samples, the least SD of a sample; keeps the weights finite


@dataclass(frozen=True)
class DistanceLimits:
    """Pairs of markers with the limits of their distance.

    ends: (E, 2) columns of the markers. least, middle, largest: (E,) mm, the limits and the median. spreads: (E,) SD of
    the distance, mm. excess: mm, beyond a limit up to which nothing moves.
    """

    ends: Ints
    least: Floats
    middle: Floats
    largest: Floats
    spreads: Floats
    excess: float

    @classmethod
    def measured(cls, positions: Floats, trusted: Bools, distances: NeighbourDistances) -> "DistanceLimits":
        """Return the limits of the most rigid pairs, over up to 300 frames in which both are trusted (F, M)."""
        # Each row of the variances is over the frames of its marker: a pair has two, of which one may be infinite.
        spread = np.sqrt(np.minimum(distances.variance, distances.variance.T))
        np.fill_diagonal(spread, np.inf)
        pairs = set()
        for marker, row in enumerate(spread):
            nearest = np.argsort(row, kind="stable")[:MOST_PARTNERS]
            rigid = nearest[row[nearest] <= LARGEST_SPREAD * distances.rigidity].tolist()
            pairs |= {(min(marker, other), max(marker, other)) for other in rigid}
        ends = np.array(sorted(pairs), dtype=np.intp).reshape(-1, 2)
        least, middle, largest = np.zeros(len(ends)), np.full(len(ends), np.nan), np.full(len(ends), np.inf)
        for k, (a, b) in enumerate(ends):
            frames = spread_out(np.flatnonzero(trusted[:, a] & trusted[:, b]), MAX_DISTANCE_FRAMES, 1)
            if len(frames):
                lengths = np.linalg.norm(positions[frames, a] - positions[frames, b], axis=1)
                # Frames with a wrong label are no evidence of a distance.
                middle[k] = median(lengths)
                robust_sd = MAD_TO_SD * median(np.abs(lengths - middle[k]))
                far = FARTHEST * max(robust_sd, LEAST_SPREAD * distances.rigidity)
                least[k], largest[k] = max(lengths.min(), middle[k] - far), min(lengths.max(), middle[k] + far)
        return cls(ends, least, middle, largest, spread[ends[:, 0], ends[:, 1]], LEAST_EXCESS * distances.rigidity)

    def restored(self, positions: Floats, sd: Floats, fixed: Bools, rate: float) -> tuple[Floats, Floats]:
        """Return positions (F, M, 3) and SD (F, M), mm, with filled samples moved towards the limits of all pairs.

        Samples with a large SD move most. The moves are smoothed over time, each in units of the SD, so that the path
        stays smooth; this is repeated. The variance of a sample grows by the mean square of its move, and where it
        still contradicts a fixed partner. fixed: (F, M) samples that stay; those that contradict most of their partners
        hold no other sample.
        """
        filled = np.isfinite(sd) & ~fixed
        moved, limits = positions, (self.least, self.largest)
        for _ in range(ROUNDS):
            offsets = self._offsets(moved, sd, filled, fixed, limits)
            if not offsets.any():
                break
            if moved is positions:
                # Least squares leave a part of what is beyond the limits; later rounds do not ask for more.
                reached = self._lengths(positions + offsets)
                limits = np.minimum(self.least, reached), np.maximum(self.largest, reached)
            columns = np.flatnonzero(offsets.any(axis=(0, 2)))
            scale = np.where(filled, sd, 0.0)[:, columns, None]
            relative = offsets[:, columns] / np.where(scale > 0.0, scale, 1.0)
            moved = moved.copy()
            moved[:, columns] += scale * _smoothed(relative, SMOOTHING * rate)
        if moved is not positions:
            squares = np.square(moved - positions).mean(axis=2)
            sd = np.where(filled, np.sqrt(np.square(sd) + squares), sd)
        return moved, np.maximum(sd, self._least_sd(moved, filled, fixed))

    def _least_sd(self, positions: Floats, filled: Bools, fixed: Bools) -> Floats:
        """Return the least SD (F, M), mm, of filled samples that contradict a fixed partner; 0 for all others.

        A distance farther from its median than three times its SD is at most three times the expected error in space.
        """
        least = np.zeros(filled.shape)
        deviations = np.abs(self._lengths(positions) - self.middle)
        far = deviations > CONTRADICTION * self.spreads
        for k in np.flatnonzero(far.any(axis=0)):
            for own, partner in (self.ends[k], self.ends[k][::-1]):
                frames = far[:, k] & filled[:, own] & fixed[:, partner]
                bound = deviations[frames, k] / (CONTRADICTION * np.sqrt(3.0))
                least[frames, own] = np.maximum(least[frames, own], bound)
        return least

    def _lengths(self, positions: Floats) -> Floats:
        """Return the distances (F, E) of the pairs, mm."""
        a, b = self.ends.T
        return np.asarray(np.linalg.norm(positions[:, a] - positions[:, b], axis=2))

    def _offsets(
        self, positions: Floats, sd: Floats, filled: Bools, fixed: Bools, limits: tuple[Floats, Floats]
    ) -> Floats:
        """Return the offsets (F, M, 3), mm, of filled samples to where the pairs of a frame are within their limits.

        They are those of weighted least squares, in which pairs within their limits keep their distance. They are zero
        in frames in which all pairs are. limits: two of (E,) or (F, E), mm.
        """
        lengths = self._lengths(positions)
        wanted = np.clip(lengths, *limits)
        excess = np.abs(lengths - wanted)
        fixed = fixed & ~self._in_doubt(excess, filled, fixed)
        counting = (filled | fixed)[:, self.ends].all(axis=2) & filled[:, self.ends].any(axis=2)
        frames = np.flatnonzero((counting & (excess > self.excess)).any(axis=1))
        offsets = np.zeros_like(positions)
        if len(frames):
            # min Σ p |y - t|² + Σ w (length error)²: p = m / sd², w = m / spread², m the median variance.
            median_sd = median(sd[filled])
            least_sd = np.maximum(sd, MIN_SAMPLE_SD * median_sd)
            precision = np.square(median_sd / np.where(filled, least_sd, 1.0))[frames]
            weights = np.square(median_sd / np.maximum(self.spreads, self.excess))
            projected = project_to_bone_lengths(
                positions[frames],
                filled[frames],
                fixed[frames],
                self.ends,
                wanted[frames],
                weights,
                precision,
                TOLERANCE,
            )[0]
            offsets[frames] = projected - positions[frames]
        return offsets

    def _in_doubt(self, excess: Floats, filled: Bools, fixed: Bools) -> Bools:
        """Return the fixed samples (F, M) that are beyond their limits with more than half of their partners.

        They may belong to another marker. Partners that are fixed count, and filled ones within the limits of a fixed
        one. excess: (F, E) beyond the limits of pairs, mm.
        """
        a, b = self.ends.T
        markers = np.arange(fixed.shape[1])
        of_a, of_b = (side[:, None] == markers for side in (a, b))
        far = excess > self.spreads
        counting = fixed | (filled & ((fixed[:, b] & ~far) @ of_a | (fixed[:, a] & ~far) @ of_b))
        partners, beyond = (
            (counting[:, b] & pairs) @ of_a.astype(float) + (counting[:, a] & pairs) @ of_b.astype(float)
            for pairs in (np.ones_like(far), far)
        )
        return np.asarray(fixed & (2.0 * beyond > partners), dtype=bool)


def _smoothed(values: Floats, sigma: float) -> Floats:
    """Return values (n, m, 3), 0 beyond both ends, convolved over time with a Gaussian of this SD, cut off at 4 SD.

    ``numerics.gaussian`` loads a library that takes longer to load than most takes to fill.
    """
    reach = int(4.0 * sigma) + 1
    kernel = np.exp(-0.5 * np.square(np.arange(-reach, reach + 1) / sigma))
    whole = np.apply_along_axis(np.convolve, 0, values, kernel / kernel.sum())
    return np.asarray(whole[reach : reach + len(values)], dtype=np.float64)
