"""Loss: occlusions as cameras make them, and the protocols by which papers remove samples.

Everything here returns ``missing``, (F, M) bool, True where a sample is lost.
"""

from dataclasses import replace

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.simulate.bounds import whole, within
from mocapclean.take import Take

_EXPOSED = {
    **dict.fromkeys(("WRA", "WRB", "FIN", "FWT", "HEE", "MT5", "STRN"), 2.0),
    **dict.fromkeys(("LFRM", "RFRM", "TOE", "ANK", "ELB", "THI", "CLAV"), 1.5),
    **dict.fromkeys(("FHD", "BHD", "C7", "T10", "SHO"), 0.5),
}
_CLOSE = 180.0
_LOOSE = 25.0
_CROWD = 1.5
_MEDIAN_SECONDS = 0.15
_SPREAD = 1.0
_SHORTEST, _LONGEST = 0.025, 1.25
_TOGETHER = 0.25
_AT_EDGE = 0.04
_MOST = 0.8
_LOOKS = 4000


def occlude(take: Take, rng: np.random.Generator, share: float = 0.05) -> Bools:
    """Missing samples (F, M), about ``share`` of all, as self-occlusion leaves them.

    A stochastic model of our own. A gap is likelier for markers of hands, feet, hips and belly than for those of
    head and shoulders (known by name, others alike), and in frames where markers of other segments come within 180
    mm. Lengths are log-normal, median 0.15 s, from 0.025 to 1.25 s (3 to 150 frames at 120 Hz), at least one frame;
    one gap in four takes the two nearest markers of the segment along, about as long; one in 25 lies at an end of
    the take. Gaps of one marker stay at least a frame apart and leave a fifth of it. Only the trusted positions of
    ``take`` are looked at. Raises UsageError unless 0 <= share <= 0.3, and when the take is too short to be given
    such a share of gaps.
    """
    within("The share of missing samples", share, 0.0, 0.3)
    n_frames, n_markers = take.trusted.shape
    missing = np.zeros((n_frames, n_markers), dtype=bool)
    if not missing.size:
        return missing
    near, crowded = _neighbours(take)
    exposure = np.array([_exposed(name) for name in take.markers]) * (1.0 + _CROWD * crowded)
    chances = np.cumsum(exposure.ravel())
    low, high = (max(1, round(seconds * take.rate)) for seconds in (_SHORTEST, _LONGEST))
    wanted, lost = share * missing.size, 0
    for _ in range(100 + int(20 * wanted / low)):
        if lost >= wanted:
            break
        pick = int(np.searchsorted(chances, rng.random() * chances[-1], side="right"))
        middle, marker = divmod(min(pick, missing.size - 1), n_markers)
        length = int(np.clip(np.exp(rng.normal(np.log(_MEDIAN_SECONDS * take.rate), _SPREAD)), low, high))
        start = 0 if rng.random() < 0.5 else n_frames
        if rng.random() >= _AT_EDGE:
            start = middle - length // 2
        group = [marker, *near[marker]] if rng.random() < _TOGETHER else [marker]
        for member in group:
            later, shorter = rng.integers(0, length // 3 + 1, 2) if member != marker else (0, 0)
            lost += _lose(missing[:, member], start + int(later), max(low, length - int(later + shorter)))
    if lost < 0.9 * wanted:
        raise UsageError(
            f"The share of missing samples must fit the take of {n_frames} frames. Got {share}; ask for less."
        )
    return missing


def _exposed(name: str) -> float:
    plain = name.rsplit(":", 1)[-1]
    return _EXPOSED.get(plain, _EXPOSED.get(plain[1:], 1.0))


def _lose(column: Bools, start: int, length: int) -> int:
    """Hide ``length`` frames unless they touch a gap or are too many; how many were hidden."""
    length = min(length, len(column))
    start = min(max(start, 0), len(column) - length)
    if column[max(0, start - 1) : start + length + 1].any() or column.sum() + length > _MOST * len(column):
        return 0
    column[start : start + length] = True
    return length


def _neighbours(take: Take) -> tuple[list[list[int]], Floats]:
    """For each marker the two nearest of its segment, and (F, M) whether a marker of another one is close."""
    n_frames, n_markers = take.trusted.shape
    step = 1 + n_frames // _LOOKS
    positions, trusted = take.positions[::step], take.trusted[::step]
    near: list[list[int]] = []
    crowded = np.zeros(trusted.shape)
    for marker in range(n_markers):
        both = trusted & trusted[:, [marker]]
        distance = np.linalg.norm(positions - positions[:, [marker]], axis=2)
        count = np.maximum(both.sum(axis=0), 1)
        mean = np.sum(distance, axis=0, where=both) / count
        loose = np.sqrt(np.sum((distance - mean) ** 2, axis=0, where=both) / count) > _LOOSE
        order = [int(i) for i in np.argsort(mean) if i != marker and not loose[i] and both[:, i].any()]
        near.append(order[:2])
        crowded[:, marker] = (both & loose & (distance < _CLOSE)).any(axis=1)
    return near, np.repeat(crowded, step, axis=0)[:n_frames]


def hide(take: Take, missing: Bools) -> Take:
    """The take without its ``missing`` samples (F, M): untrusted, and at the origin so that no truth leaks."""
    return replace(take, positions=np.where(missing[..., None], 0.0, take.positions), trusted=take.trusted & ~missing)


def random_loss(n_frames: int, n_markers: int, ratio: float, rng: np.random.Generator) -> Bools:
    """Missing samples (F, M): in each frame round(ratio M) markers, chosen afresh.

    The random loss of W. Hu et al., "Motion capture data completion via truncated nuclear norm regularization"
    (2017), and of Imamura and Okuda (2018), with ratios 0.2 to 0.6. Raises UsageError unless 0 <= ratio <= 1 and
    the counts are whole numbers of at least 1.
    """
    _sizes(n_frames, n_markers)
    within("The ratio of missing markers", ratio, 0.0, 1.0)
    ranks = rng.random((n_frames, n_markers)).argsort(axis=1)
    return np.asarray(ranks < round(ratio * n_markers))


def block_loss(n_frames: int, n_markers: int, length: int, n_out: int, rng: np.random.Generator) -> Bools:
    """Missing samples (F, M): the take cut into blocks of ``length`` frames, ``n_out`` random markers out in each.

    C.-H. Tan, J. Hou and L.-P. Chau, "Motion capture data recovery using skeleton constrained singular value
    thresholding", Vis. Comput. 31 (2015) 1521, doi:10.1007/s00371-014-1031-5: n_out 3 or 6 of 31 joints, length 15
    to 120 at 60 Hz, the take first cut to a multiple of length. With n_out 10 and length 20 to 60 it is our reading
    of the continuous loss of Hu et al. and of Imamura and Okuda. Here a shorter last block loses markers as well.
    Raises UsageError unless all are whole numbers, n_out at most M and the rest at least 1.
    """
    _sizes(n_frames, n_markers)
    whole("The length of a block in frames", length, 1)
    whole("The number of markers out", n_out, 0, n_markers)
    blocks = rng.random((-(-n_frames // length), n_markers)).argsort(axis=1) < n_out
    return np.asarray(blocks[np.arange(n_frames) // length])


def single_gaps(n_frames: int, n_markers: int, n_out: int, length: int, rng: np.random.Generator) -> Bools:
    """Missing samples (F, M): ``n_out`` markers with one gap of ``length`` frames each, 10 frames off the ends.

    The markers are one draw without replacement, then each gap's start is one draw, in the order of the markers
    drawn. Raises UsageError when the numbers are not whole or the take is not longer than length + 20 frames.
    """
    _sizes(n_frames, n_markers)
    whole("The number of markers out", n_out, 0, n_markers)
    whole("The length of a gap in frames", length, 1)
    missing = np.zeros((n_frames, n_markers), dtype=bool)
    if n_frames - length <= 20:
        raise UsageError(f"The number of frames must be more than {length + 20}. Got {n_frames}.")
    for marker in rng.choice(n_markers, n_out, replace=False):
        start = rng.integers(10, n_frames - length - 10)
        missing[start : start + length, marker] = True
    return missing


def _sizes(n_frames: int, n_markers: int) -> None:
    whole("The number of frames", n_frames, 1)
    whole("The number of markers", n_markers, 1)


def lose_channels(
    skeleton: Skeleton,
    poses: Floats,
    rng: np.random.Generator,
    n_spans: int = 4,
    shortest: int = 20,
    longest: int = 60,
) -> Floats:
    """A copy of the poses (F, C) with NaN where a limb's end was lost, as a solver writes an unsolved chain.

    ``n_spans`` times a joint near the end of its chain (at most one turning joint hangs on it) loses its rotations,
    and all below it theirs, for ``shortest`` to ``longest`` frames. Spans may meet. Raises UsageError when the
    numbers are not whole or the take is shorter than ``longest``.
    """
    whole("The number of lost spans", n_spans, 0)
    whole("The shortest span in frames", shortest, 1, len(poses))
    whole("The longest span in frames", longest, shortest, len(poses))
    below = _chains(skeleton)
    broken = poses.copy()
    turning = {c.joint for c in skeleton.channels if c.is_rotation}
    ends = [joint for joint in sorted(turning) if len(below[joint] & turning) <= 2]
    for joint in rng.choice(ends, n_spans):
        length = int(rng.integers(shortest, longest + 1))
        start = int(rng.integers(0, len(poses) - length + 1))
        columns = [i for i, c in enumerate(skeleton.channels) if c.is_rotation and c.joint in below[int(joint)]]
        broken[start : start + length, columns] = np.nan
    return broken


def _chains(skeleton: Skeleton) -> list[set[int]]:
    """For each joint the joints that move with it, itself among them."""
    below = [{joint} for joint in range(len(skeleton.names))]
    for joint in reversed(range(len(skeleton.names))):
        if skeleton.parents[joint] >= 0:
            below[skeleton.parents[joint]] |= below[joint]
    return below
