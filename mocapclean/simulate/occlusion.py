"""Lost samples: occlusions as cameras produce them, and the protocols by which papers remove samples.

The masks returned here are ``missing``, (F, M) bool, True where a sample is lost.
"""

from dataclasses import replace

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.simulate.bounds import require_between, require_whole
from mocapclean.take import Take
from mocapclean.take.names import bare_name

# The stochastic model of ``occlude``; all values are chosen by hand, no sweep was kept.
# How often a marker is lost, relative to the others; names with or without their side.
_EXPOSURE = {
    **dict.fromkeys(("WRA", "WRB", "FIN", "FWT", "HEE", "MT5", "STRN"), 2.0),
    **dict.fromkeys(("LFRM", "RFRM", "TOE", "ANK", "ELB", "THI", "CLAV"), 1.5),
    **dict.fromkeys(("FHD", "BHD", "C7", "T10", "SHO"), 0.5),
}
_CROWDED_DISTANCE = 180.0  # mm, distance to a marker of another segment below which a marker is crowded
_SEGMENT_SD = 25.0  # mm, largest SD of the distance of two markers of one segment
_CROWDED_EXPOSURE = 1.5  # additional exposure of crowded markers
_MEDIAN_SECONDS = 0.15  # median length of a gap
_LOG_SD = 1.0  # SD of the logarithm of the length
_SHORTEST_SECONDS = 0.025  # of a gap
_LONGEST_SECONDS = 1.25  # of a gap
_JOINT_LOSS = 0.25  # share of gaps in which the nearest markers of the segment are lost too
_NEIGHBOURS = 2  # number of these markers
_AT_END = 0.04  # share of gaps at the first or the last frame of the take
_LARGEST_LOSS = 0.8  # largest share of a marker's samples that are lost
_LARGEST_SHARE = 0.3  # of all samples, largest that is accepted
_LEAST_SUCCESS = 0.9  # least part of the wanted share that gaps must reach
_DISTANCE_FRAMES = 4000  # most frames of the distances, about; for speed

_SINGLE_GAP_MARGIN = 10  # frames between a gap of ``single_gaps`` and the ends of the take; chosen by hand


def occlude(take: Take, rng: np.random.Generator, share: float = 0.05) -> Bools:
    """Return missing samples (F, M), about ``share`` of all, in the pattern of self-occlusions.

    The stochastic model is this project's own. Gaps are likelier for markers of hands, feet, hips and belly than for
    those of head and shoulders (by name; unknown names are alike), and in frames in which markers of other segments are
    within 180 mm. Lengths are log-normal with a median of 0.15 s, from 0.025 to 1.25 s (3 to 150 frames at 120 Hz), at
    least one frame. In one gap of four, the two nearest markers of the segment are lost too, for about as long. One gap
    of 25 is at an end of the take. Gaps of a marker are at least a frame apart and leave a fifth of its samples. Only
    trusted positions are read. Raises UsageError unless 0 <= share <= 0.3, and when the take is too short for that
    share of gaps.
    """
    require_between("The share of missing samples", share, 0.0, _LARGEST_SHARE)
    n_frames, n_markers = take.trusted.shape
    missing = np.zeros((n_frames, n_markers), dtype=bool)
    if not missing.size:
        return missing
    neighbours, crowded = _neighbours(take)
    exposure = np.array([_exposure(name) for name in take.markers]) * (1.0 + _CROWDED_EXPOSURE * crowded)
    cumulative = np.cumsum(exposure.ravel())
    low, high = (max(1, round(seconds * take.rate)) for seconds in (_SHORTEST_SECONDS, _LONGEST_SECONDS))
    wanted, lost = share * missing.size, 0
    for _ in range(100 + int(20 * wanted / low)):
        if lost >= wanted:
            break
        # The middle frame and the marker, drawn in proportion to exposure
        drawn = int(np.searchsorted(cumulative, rng.random() * cumulative[-1], side="right"))
        middle, marker = divmod(min(drawn, missing.size - 1), n_markers)
        length = int(np.clip(np.exp(rng.normal(np.log(_MEDIAN_SECONDS * take.rate), _LOG_SD)), low, high))
        start = 0 if rng.random() < 0.5 else n_frames
        if rng.random() >= _AT_END:
            start = middle - length // 2
        group = [marker, *neighbours[marker]] if rng.random() < _JOINT_LOSS else [marker]
        for member in group:
            later, shorter = rng.integers(0, length // 3 + 1, 2) if member != marker else (0, 0)
            lost += _lose(missing[:, member], start + int(later), max(low, length - int(later + shorter)))
    if lost < _LEAST_SUCCESS * wanted:
        raise UsageError(
            f"The share of missing samples must fit the take of {n_frames} frames. Got {share}; ask for less."
        )
    return missing


def _exposure(marker: str) -> float:
    """Return the exposure of a marker by its name, with or without its side."""
    name = bare_name(marker)
    return _EXPOSURE.get(name, _EXPOSURE.get(name[1:], 1.0))


def _lose(column: Bools, start: int, length: int) -> int:
    """Set ``length`` frames of a marker's column (F,) missing; return their number.

    It is 0 where they would touch another gap, or leave too few samples.
    """
    length = min(length, len(column))
    start = min(max(start, 0), len(column) - length)
    if column[max(0, start - 1) : start + length + 1].any() or column.sum() + length > _LARGEST_LOSS * len(column):
        return 0
    column[start : start + length] = True
    return length


def _neighbours(take: Take) -> tuple[list[list[int]], Floats]:
    """Return the two nearest markers of each marker's segment, and 1 (F, M) where a marker of another one is close."""
    n_frames, n_markers = take.trusted.shape
    step = 1 + n_frames // _DISTANCE_FRAMES
    positions, trusted = take.positions[::step], take.trusted[::step]
    nearest: list[list[int]] = []
    crowded = np.zeros(trusted.shape)
    for marker in range(n_markers):
        both = trusted & trusted[:, [marker]]
        distance = np.linalg.norm(positions - positions[:, [marker]], axis=2)
        count = np.maximum(both.sum(axis=0), 1)
        mean = np.sum(distance, axis=0, where=both) / count
        other_segment = np.sqrt(np.sum((distance - mean) ** 2, axis=0, where=both) / count) > _SEGMENT_SD
        order = [int(i) for i in np.argsort(mean) if i != marker and not other_segment[i] and both[:, i].any()]
        nearest.append(order[:_NEIGHBOURS])
        crowded[:, marker] = (both & other_segment & (distance < _CROWDED_DISTANCE)).any(axis=1)
    return nearest, np.repeat(crowded, step, axis=0)[:n_frames]


def hide(take: Take, missing: Bools) -> Take:
    """Return the take with ``missing`` samples (F, M) untrusted and at the origin, without their true positions."""
    return replace(take, positions=np.where(missing[..., None], 0.0, take.positions), trusted=take.trusted & ~missing)


def random_loss(n_frames: int, n_markers: int, ratio: float, rng: np.random.Generator) -> Bools:
    """Return missing samples (F, M): round(ratio M) random markers in each frame.

    The random loss of W. Hu et al., "Motion capture data completion via truncated nuclear norm regularization"
    (2017), and of Imamura and Okuda (2018), with ratios 0.2 to 0.6. Raises UsageError unless 0 <= ratio <= 1 and
    the counts are whole numbers of at least 1.
    """
    _require_sizes(n_frames, n_markers)
    require_between("The ratio of missing markers", ratio, 0.0, 1.0)
    ranks = rng.random((n_frames, n_markers)).argsort(axis=1)
    return np.asarray(ranks < round(ratio * n_markers))


def block_loss(n_frames: int, n_markers: int, length: int, n_out: int, rng: np.random.Generator) -> Bools:
    """Return missing samples (F, M): ``n_out`` random markers in each block of ``length`` frames.

    C.-H. Tan, J. Hou, L.-P. Chau, 2015, doi:10.1007/s00371-014-1031-5: n_out 3 or 6 of 31 joints, length 15 to 120 at
    60 Hz, the take first cropped to a multiple of length. With n_out 10 and length 20 to 60 it is a reading of the
    continuous loss of Hu et al. and of Imamura and Okuda. Here a shorter last block loses markers too.
    Raises UsageError unless all are whole numbers, n_out at most M and the rest at least 1.
    """
    _require_sizes(n_frames, n_markers)
    require_whole("The length of a block in frames", length, 1)
    require_whole("The number of markers out", n_out, 0, n_markers)
    blocks = rng.random((-(-n_frames // length), n_markers)).argsort(axis=1) < n_out
    return np.asarray(blocks[np.arange(n_frames) // length])


def single_gaps(n_frames: int, n_markers: int, n_out: int, length: int, rng: np.random.Generator) -> Bools:
    """Return missing samples (F, M): ``n_out`` markers with one gap of ``length`` frames each, 10 frames off the ends.

    The markers are one draw without replacement; then each gap's start is one draw, in their order. Raises UsageError
    when the numbers are not whole or the take is not longer than length + 20 frames.
    """
    _require_sizes(n_frames, n_markers)
    require_whole("The number of markers out", n_out, 0, n_markers)
    require_whole("The length of a gap in frames", length, 1)
    missing = np.zeros((n_frames, n_markers), dtype=bool)
    least = length + 2 * _SINGLE_GAP_MARGIN
    if n_frames <= least:
        raise UsageError(f"The number of frames must be more than {least}. Got {n_frames}.")
    for marker in rng.choice(n_markers, n_out, replace=False):
        start = rng.integers(_SINGLE_GAP_MARGIN, n_frames - length - _SINGLE_GAP_MARGIN)
        missing[start : start + length, marker] = True
    return missing


def _require_sizes(n_frames: int, n_markers: int) -> None:
    """Raise UsageError unless there are frames and markers."""
    require_whole("The number of frames", n_frames, 1)
    require_whole("The number of markers", n_markers, 1)


def lose_channels(
    skeleton: Skeleton,
    poses: Floats,
    rng: np.random.Generator,
    n_spans: int = 4,
    shortest: int = 20,
    longest: int = 60,
) -> Floats:
    """Return the poses (F, C) with NaN for rotations at the ends of limbs, as of an unsolved chain of joints.

    In ``n_spans`` spans of ``shortest`` to ``longest`` frames, a joint and all joints below it lose their rotations. At
    most one joint with rotations is below it. Spans may overlap. Raises UsageError when the numbers are not whole or
    the take is shorter than ``longest``.
    """
    require_whole("The number of lost spans", n_spans, 0)
    require_whole("The shortest span in frames", shortest, 1, len(poses))
    require_whole("The longest span in frames", longest, shortest, len(poses))
    below = _joints_below(skeleton)
    broken = poses.copy()
    rotating = {c.joint for c in skeleton.channels if c.is_rotation}
    ends = [joint for joint in sorted(rotating) if len(below[joint] & rotating) <= 2]
    for joint in rng.choice(ends, n_spans):
        length = int(rng.integers(shortest, longest + 1))
        start = int(rng.integers(0, len(poses) - length + 1))
        columns = [i for i, c in enumerate(skeleton.channels) if c.is_rotation and c.joint in below[int(joint)]]
        broken[start : start + length, columns] = np.nan
    return broken


def _joints_below(skeleton: Skeleton) -> list[set[int]]:
    """Return, for each joint, the joints that it moves, itself among them."""
    below = [{joint} for joint in range(len(skeleton.names))]
    for joint in reversed(range(len(skeleton.names))):
        if skeleton.parents[joint] >= 0:
            below[skeleton.parents[joint]] |= below[joint]
    return below
