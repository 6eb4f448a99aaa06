"""What BVH and AMC share: a text kept byte for byte, the table of poses in it, its repair and the proof.

A frame of the text is a block of bytes: from the start of the frame to the start of the next. A repair respells some of
the block's numbers. Every other byte of the file stays as it was, white space between the numbers included.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.errors import FormatError, UsageError
from mocapclean.formats.text import TOKEN, WORD, blank, is_missing, is_number, load, value_of
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Take
from mocapclean.take.posed import joint_positions, posed, with_poses

REREAD = 1e-9
"""Degrees or millimetres between a channel as reported and as read back: the rounding of float64 alone. By hand."""
CREATED_MM = 0.01
"""Millimetres between a joint of a take and of the new file made from it. Six decimals a number, in degrees and units
of some millimetres, and bvhio's 32-bit offsets leave less than a thousandth on a body. Chosen by hand."""
FINEST_DEGREES = 1e-6
"""Degrees: repaired angles are spelled at least this finely, 2e-5 mm at the end of a limb of a metre."""
FINEST_MM = 1e-4
"""Millimetres: repaired lengths are spelled at least this finely, a thousandth of the tolerance of trusted joints."""
MOST_DECIMALS = 12
"""Decimals beyond which the file's own spelling is not followed: a float64 angle holds no more. Chosen by hand."""
COMPARED_BYTES = 1 << 20
"""Bytes of two texts that are compared at once, which bounds the memory for them. Chosen by hand."""
ROUNDING_SLACK = 1e-9
"""Decimals: keeps the logarithm of an exact power of ten from being rounded up to one decimal more."""


@dataclass(frozen=True, kw_only=True)
class PoseDocument:
    """A text file of F frames, kept byte for byte, and the table of poses read from it.

    raw: the bytes of the file. scale: (C,) degrees or millimetres per number of the file. poses: (F, C) degrees and
    millimetres, NaN where the file has NaN. starts: (F + 1,) bytes at which the frames' blocks start, and the end of
    the file. places: (F, C) index of the channel's token among the tokens of its frame's block.
    """

    raw: bytes
    skeleton: Skeleton
    scale: Floats
    poses: Floats
    starts: NDArray[np.int64]
    places: NDArray[np.int64]

    @property
    def others(self) -> tuple[str, ...]:
        """What the file has beside its poses, in words: nothing."""
        return ()

    def block(self, frame: int) -> bytes:
        """Return the bytes of one frame."""
        return self.raw[self.starts[frame] : self.starts[frame + 1]]

    def decimals(self) -> NDArray[np.int64]:
        """Return the decimals (C,) of a respelled number: as many as in the first frame, and enough for 0.1 mm."""
        tokens = TOKEN.findall(blank(self.block(0)))
        first = [tokens[place] for place in self.places[0]]
        # Decimals as the file spells them; a number with an exponent, or a missing one, shows no habit.
        habits = [b"" if b"e" in token.lower() or is_missing(token) else token for token in first]
        own = np.array([len(token.partition(b".")[2]) for token in habits])
        turns = np.array([channel.is_rotation for channel in self.skeleton.channels])
        finest = np.where(turns, FINEST_DEGREES, FINEST_MM)
        needed = np.ceil(np.log10(self.scale / finest) - ROUNDING_SLACK)
        habit = np.where(turns, max(own[turns], default=0), max(own[~turns], default=0))
        return np.maximum(needed, np.minimum(habit, MOST_DECIMALS)).clip(0).astype(np.int64)

    def spelled(self, poses: Floats) -> Floats:
        """Return poses (f, C) as they are after being spelled in this file and read again."""
        values = poses / self.scale
        decimals = self.decimals()
        columns = [np.char.mod(f"%.{n}f", values[:, c]).astype(np.float64) for c, n in enumerate(decimals)]
        return np.stack(columns, axis=1) * self.scale

    def patched(self, poses: Floats, changed: Bools) -> bytes:
        """Return the text with the changed numbers (F, C) respelled."""
        spelling = [f"%.{n}f" for n in self.decimals()]
        text, at = [], 0
        for frame in map(int, np.flatnonzero(changed.any(axis=1))):
            start, places, values = int(self.starts[frame]), self.places[frame], poses[frame] / self.scale
            spans = [match.span() for match in TOKEN.finditer(blank(self.block(frame)))]
            for channel in sorted(np.flatnonzero(changed[frame]), key=places.__getitem__):
                first, stop = spans[places[channel]]
                text += [self.raw[at : start + first], (spelling[channel] % values[channel]).encode()]
                at = start + stop
        return b"".join([*text, self.raw[at:]])


def write(take: Take, path: Path, *, invalidate: bool = False) -> Take:
    """Write the kept text with the numbers of the take's poses where they differ; return the take.

    The returned take has the poses as spelled, and the positions that follow. Neither BVH nor AMC has a mark for a
    missing joint, so ``invalidate`` changes nothing.
    """
    document, poses = kept_document(take), take.poses
    if poses is None or poses.shape != document.poses.shape:
        raise UsageError(f"{path}: a take must keep the poses of its file to be written into a copy of it.")
    changed = (poses != document.poses) & np.isfinite(poses)
    frames = np.flatnonzero(changed.any(axis=1))
    spelled = np.where(np.isfinite(poses), poses, document.poses)
    spelled[frames] = np.where(changed[frames], document.spelled(poses[frames]), spelled[frames])
    path.write_bytes(document.patched(spelled, changed))
    return with_poses(take, spelled)


def kept_document(take: Take) -> PoseDocument:
    """Return the document that a take was read with; raise UsageError if it has none of this kind."""
    document = take.origin.document if take.origin else None
    if not isinstance(document, PoseDocument):
        raise UsageError("a take must come from a BVH or AMC file to be written into a copy of it. Got another.")
    return document


def prove(take: Take, path: Path) -> None:
    """Raise FormatError unless a written file is the kept text but for the numbers of the take that differ.

    take: the return of ``write``. All numbers must be those of its poses. The file is read again; of its numbers only
    those are parsed that differ, because equal bytes between equal bytes mean the same.
    """
    kept, raw = kept_document(take), load(path)
    assert take.poses is not None
    frames = np.flatnonzero(((take.poses != kept.poses) & np.isfinite(take.poses)).any(axis=1))
    # 1. All bytes are equal, but for the spelling of channels in repaired frames.
    written = _Comparison(take, path, kept, raw).poses(frames)
    # 2. The numbers of these frames are those of the take.
    expected = take.poses[frames]
    same = (np.abs(written - expected) <= REREAD) | (np.isnan(written) & np.isnan(expected))
    for row, channel in np.argwhere(~same)[:1]:
        raise FormatError(
            path,
            f"a channel must be {expected[row, channel]:g}, as repaired. Got {written[row, channel]:g}.",
            frame=take.first_frame + int(frames[row]),
            marker=take.markers[kept.skeleton.channels[channel].joint],
        )


class _Comparison:
    """A written text beside the kept one, compared from the start to the end.

    old, new: the bytes up to which both were compared.
    """

    def __init__(self, take: Take, path: Path, kept: PoseDocument, raw: bytes) -> None:
        self.take, self.path, self.kept, self.raw = take, path, kept, raw
        self.old = self.new = 0

    def poses(self, frames: Ints) -> Floats:
        """Return the written poses (f, C) of some frames; raise FormatError if the rest of the file differs."""
        poses = self.kept.poses[frames]
        for frame, pose in zip(map(int, frames), poses, strict=True):
            self._equal(int(self.kept.starts[frame]))
            self._read(frame, pose)
        self._equal(len(self.kept.raw))
        if self.new != len(self.raw):
            raise self._difference()
        return poses

    def _equal(self, stop: int) -> None:
        """Pass the bytes up to ``stop`` of the kept text; raise FormatError where the written ones differ."""
        while self.old < stop:
            size = min(stop - self.old, COMPARED_BYTES)
            if self.raw[self.new : self.new + size] != self.kept.raw[self.old : self.old + size]:
                raise self._difference()
            self.old, self.new = self.old + size, self.new + size

    def _read(self, frame: int, pose: Floats) -> None:
        """Pass the block of a repaired frame, and set in a pose (C,) the channels that are spelled differently."""
        channels = dict(zip(self.kept.places[frame].tolist(), range(len(pose)), strict=True))
        start, ahead = self.old, self.new - self.old
        for place, match in enumerate(TOKEN.finditer(blank(self.kept.block(frame)))):
            if (channel := channels.get(place)) is None:
                continue
            at = start + match.start()
            spelled = WORD.match(self.raw, at + ahead)
            if spelled and spelled[0] != match[0] and is_number(spelled[0]):
                self._equal(at)
                pose[channel] = value_of(spelled[0]) * self.kept.scale[channel]
                self.old, self.new = at + len(match[0]), spelled.end()
                ahead = self.new - self.old
        self._equal(int(self.kept.starts[frame + 1]))

    def _difference(self) -> FormatError:
        """Return an error for a difference soon after the bytes that were compared last."""
        pairs = zip(self.kept.raw[self.old : self.old + COMPARED_BYTES], self.raw[self.new :], strict=False)
        at = self.old + next((index for index, (old, new) in enumerate(pairs) if old != new), 0)
        frame = int(np.searchsorted(self.kept.starts, at, side="right")) - 1
        if frame < 0:
            return FormatError(self.path, "the header must be that of the input. Got another.")
        return FormatError(
            self.path,
            "only numbers of repaired frames must differ from the input. Got another difference.",
            frame=self.take.first_frame + min(frame, len(self.kept.poses) - 1),
        )


def prove_created(take: Take, path: Path, poses: Floats, skeleton: Skeleton) -> None:
    """Raise FormatError unless the skeleton and poses (F, C) read from a new file put all joints where the take does.

    The channels of the file may come in another order than those of the take, so joint positions are compared: by
    name, but for the root, which a format may rename.
    """
    own, all_poses = posed(take)
    expected = joint_positions(own, all_poses)
    columns = [
        skeleton.parents.index(-1) if parent < 0 else skeleton.names.index(name) if name in skeleton.names else -1
        for name, parent in zip(own.names, own.parents, strict=True)
    ]
    if -1 in columns or len(skeleton.names) != len(own.names) or len(poses) != len(expected):
        raise FormatError(path, "a new file must have the frames and joints of the take. Got others.")
    apart = joint_positions(skeleton, poses)[:, columns] - expected
    known = np.asarray(np.isfinite(expected).all(axis=2))
    _check_within(take, path, np.arange(len(expected)), apart, known, CREATED_MM)


def _check_within(take: Take, path: Path, frames: Ints, apart: Floats, where: Bools, most: float) -> None:
    """Raise FormatError, with frame and joint, for a difference (f, J, 3) of more than ``most`` mm where it counts."""
    distance = np.linalg.norm(apart, axis=2)
    for row, joint in np.argwhere(where & ~(distance <= most))[:1]:
        raise FormatError(
            path,
            f"the joint must be within {most:g} mm of where it belongs. Got {distance[row, joint]:g} mm.",
            frame=take.first_frame + int(frames[row]),
            marker=take.markers[joint],
        )
