"""Other takes of the same subject with the same markers, from which a method learns what a short take does not show."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced

# Chosen by hand, no sweep was kept.
MOST_SECONDS = 30.0  # s, the longest session that is kept; the memory and the time of a fill grow with it
STRETCH = 3.0  # s, the length of the stretches that are kept; gaps of up to about this length find windows in them
POSE_MARKERS = 12  # markers whose distances make up a pose, evenly spaced over the columns
POSES_PER_STRETCH = 4  # poses that stand for a stretch
PAUSE = 1.0  # s, unknown frames between stretches: longer than the reach of any window or bridge over time


class Stretch(NamedTuple):
    """Consecutive frames of one take: positions (F, M, 3), mm, and the samples (F, M) that are trusted."""

    positions: Floats
    trusted: Bools


@dataclass(frozen=True, kw_only=True)
class Session:
    """Stretches of other takes, for the markers of a take and at its frame rate.

    positions: (S, M, 3) mm, read where ``trusted`` (S, M). In the frames of a pause before each stretch nothing is
    trusted, so that no window and no curve over time joins two stretches, or the take and a stretch.
    """

    positions: Floats
    trusted: Bools

    @classmethod
    def of(cls, stretches: Sequence[Stretch], rate: float) -> "Session | None":
        """Return the session of some stretches at a rate, Hz; None where nothing in them is trusted.

        Of more than 30 s, those stretches of 3 s are kept whose poses differ most from each other.
        """
        parts = [part for stretch in stretches for part in _parts(stretch, max(1, round(STRETCH * rate)))]
        kept = _most_different(parts, rate)
        if not kept:
            return None
        n_markers, pause = kept[0].trusted.shape[1], max(1, round(PAUSE * rate))
        gap = Stretch(np.zeros((pause, n_markers, 3)), np.zeros((pause, n_markers), dtype=bool))
        joined = [each for part in kept for each in (gap, part)]
        return cls(
            positions=np.concatenate([np.where(s.trusted[..., None], s.positions, 0.0) for s in joined]),
            trusted=np.concatenate([s.trusted for s in joined]),
        )

    def after(self, positions: Floats, trusted: Bools) -> tuple[Floats, Bools]:
        """Return the positions (F, M, 3) and the trust (F, M) of a take, followed by those of the session."""
        return np.concatenate([positions, self.positions]), np.concatenate([trusted, self.trusted])

    def select(self, columns: Ints) -> "Session":
        """Return the session of these markers alone, by column."""
        return Session(positions=self.positions[:, columns], trusted=self.trusted[:, columns])


def _parts(stretch: Stretch, length: int) -> list[Stretch]:
    """Return a stretch in parts of about ``length`` frames, without those in which nothing is trusted."""
    n_parts = max(1, len(stretch.trusted) // length)
    pairs = zip(np.array_split(stretch.positions, n_parts), np.array_split(stretch.trusted, n_parts), strict=True)
    return [Stretch(*pair) for pair in pairs if pair[1].any()]


def _most_different(parts: list[Stretch], rate: float) -> list[Stretch]:
    """Return the parts, or of more than 30 s those that differ most: farthest-point selection, in their order.

    T. F. Gonzalez, 1985, Clustering to minimize the maximum intercluster distance, doi:10.1016/0304-3975(85)90224-5.
    The distance of a part from those chosen is the largest, over its poses, of the distances from the nearest pose.
    """
    most = MOST_SECONDS * rate
    if sum(len(part.trusted) for part in parts) <= most:
        return parts
    poses = _poses(parts)
    # Begin with the part that is nearest to the mean of all poses.
    mean = poses.mean(axis=(0, 1))
    chosen = [int(np.square(poses - mean).sum(axis=2).max(axis=1).argmin())]
    nearest, length = np.full(poses.shape[:2], np.inf), len(parts[chosen[0]].trusted)
    while length < most and len(chosen) < len(parts):
        to_last = np.square(poses[:, :, None] - poses[chosen[-1]]).sum(axis=3).min(axis=2)
        nearest = np.minimum(nearest, to_last)
        nearest[chosen] = -1.0
        chosen.append(int(nearest.max(axis=1).argmax()))
        length += len(parts[chosen[-1]].trusted)
    return [parts[k] for k in sorted(chosen)]


def _poses(parts: list[Stretch]) -> Floats:
    """Return the poses (parts, 4, pairs) of parts: distances between up to 12 markers, mm.

    The mean over all parts stands for a distance that is not known.
    """
    markers = evenly_spaced(parts[0].trusted.shape[1], POSE_MARKERS)
    first, second = (markers[side] for side in np.triu_indices(len(markers), 1))
    poses = np.empty((len(parts), POSES_PER_STRETCH, len(first)))
    for pose, part in zip(poses, parts, strict=True):
        frames = np.linspace(0, len(part.trusted) - 1, POSES_PER_STRETCH).astype(np.intp)
        offsets = part.positions[frames][:, first] - part.positions[frames][:, second]
        known = part.trusted[frames][:, first] & part.trusted[frames][:, second]
        pose[:] = np.where(known, np.sqrt(np.square(np.where(known[..., None], offsets, 0.0)).sum(axis=2)), np.nan)
    unknown, known_poses = np.isnan(poses), np.nan_to_num(poses)
    mean = known_poses.sum(axis=(0, 1)) / np.maximum((~unknown).sum(axis=(0, 1)), 1)
    return np.where(unknown, mean, known_poses)
