"""What BVH and AMC share: a kept text in which a table of joint angles stands, its repair, the proof.

A frame of the text is a block of bytes from where it starts to where the next one does. A repair respells some of
its numbers; every other byte of the file, white space between the numbers included, stays as it was.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.errors import FormatError, UsageError
from mocapclean.geometry.inverse_kinematics import fit
from mocapclean.geometry.skeleton import Skeleton, forward
from mocapclean.take import Finding, Take

TRUSTED_MM = 0.1  # a repair moves no trusted joint farther than this
REREAD_MM = 1e-6  # what is read back may differ from what was reported by this
LARGEST = 1e9  # no number of a capture is larger; beyond it forward kinematics has no millimetres left
SPELLING_DEGREES, SPELLING_MM = 1e-6, 1e-4  # repaired numbers are spelled at least this finely
MOST_DECIMALS = 12
CHUNK = 1024  # frames per forward-kinematics call, to bound memory

TOKEN = re.compile(rb"\S+")
NUMBER = re.compile(rb"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan)", re.IGNORECASE)
COMMENT = re.compile(rb"#[^\r\n]*")
MARK = b"\xef\xbb\xbf"
SPACES = bytes.maketrans(b",()", b"   ")


@dataclass(frozen=True, kw_only=True)
class Document:
    """A text file of F frames, kept byte for byte, and the pose table read from it.

    scale: (C,) degrees or millimetres per number of the file. poses: (F, C) degrees and millimetres, NaN where the
    file says so. starts: (F + 1,) bytes at which the frames' blocks start, and the end of the file. places: (F, C)
    which token of its frame's block holds a channel.
    """

    raw: bytes
    skeleton: Skeleton
    scale: Floats
    poses: Floats
    starts: NDArray[np.int64]
    places: NDArray[np.int64]

    def block(self, frame: int) -> bytes:
        """The bytes of one frame."""
        return self.raw[self.starts[frame] : self.starts[frame + 1]]


def load(path: Path) -> bytes:
    """The bytes of a file; FormatError if it cannot be read or is empty."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise FormatError(path, f"the file must be readable. Got {error.strerror}.") from error
    if not raw.strip():
        raise FormatError(path, "the file must not be empty. Got no text in it.")
    return raw


def blank(raw: bytes) -> bytes:
    """The text with spaces for a byte order mark and what Acclaim ignores: comments, commas, brackets."""
    text = raw.translate(SPACES)
    text = b"   " + text[3:] if text.startswith(MARK) else text
    return COMMENT.sub(lambda match: b" " * len(match[0]), text)


def line_at(raw: bytes, byte: int) -> int:
    """The number, from 1, of the line in which a byte stands."""
    return len((raw[:byte] + b".").splitlines())


def decode(text: bytes) -> str:
    """Text of a file that does not name its encoding: UTF-8 if it can be, else Latin-1."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def quote(token: bytes) -> str:
    """A token as errors show it."""
    text = decode(token)
    return repr(text if len(text) <= 40 else text[:40] + "...")


def number(path: Path, token: bytes, line: int) -> float:
    """The value of one number (NaN allowed); FormatError if it is none or is beyond all measure."""
    value = float(token) if NUMBER.fullmatch(token) else np.inf
    if abs(value) > LARGEST:
        message = f"a number must be decimal and at most {LARGEST:g}. Got {quote(token)}."
        raise FormatError(path, message, line=line)
    return value


def numbers(path: Path, rows: Sequence[Sequence[bytes]], lines: Sequence[int]) -> Floats:
    """All values of rows of tokens, in one dimension; ``lines`` are the rows' line numbers."""
    try:
        values = np.fromiter(map(float, chain.from_iterable(rows)), dtype=np.float64)
    except ValueError:
        values = np.array([np.inf])
    # Python reads 1_0 as ten, a capture may not
    if (np.abs(values) > LARGEST).any() or b"_" in b"".join(chain.from_iterable(rows)):
        values = np.array([number(path, t, line) for row, line in zip(rows, lines, strict=True) for t in row])
    return values


def finite(path: Path, tokens: Sequence[bytes], count: int, what: str, line: int) -> list[float]:
    """Exactly ``count`` finite numbers of a header."""
    values = [number(path, token, line) for token in tokens]
    if len(values) != count or not np.isfinite(values).all():
        got = quote(b" ".join(tokens)) if tokens else "none"
        raise FormatError(path, f"{what} must be {count} finite number(s). Got {got}.", line=line)
    return values


def positive(value: float, what: str) -> float:
    """A value that a user gave; UsageError unless it is positive and finite."""
    if not 0 < value < np.inf:
        raise UsageError(f"{what} must be positive and finite. Got {value:g}.")
    return value


def kinematics(skeleton: Skeleton, poses: Floats) -> Floats:
    """Joint positions (F, J, 3) in millimetres of poses (F, C)."""
    found = np.empty((len(poses), len(skeleton.names), 3))
    for start in range(0, len(poses), CHUNK):
        found[start : start + CHUNK] = forward(skeleton, poses[start : start + CHUNK])[0]
    return found


def joints(document: Document) -> tuple[Floats, Bools]:
    """Positions (F, J, 3) in millimetres and trust (F, J).

    A NaN distrusts all that hangs on it; in a root it distrusts the root too.
    """
    positions = kinematics(document.skeleton, document.poses)
    trusted = np.all(np.isfinite(positions), axis=2)
    for index, channel in enumerate(document.skeleton.channels):
        if document.skeleton.parents[channel.joint] < 0:
            trusted[:, channel.joint] &= np.isfinite(document.poses[:, index])
    return np.where(trusted[:, :, None], positions, np.nan), trusted


def write(take: Take, path: Path, *, invalidate: bool = False) -> Take:
    """Write the kept text with the angles of the filled joints fitted to their positions.

    Returns the take as the file holds it: in repaired frames the positions are forward kinematics of the numbers
    as spelled. A joint that cannot be fitted while every trusted joint stays within 0.1 mm is left as it was, no
    longer ``filled``, and told by a finding of rule "fit". Neither BVH nor AMC has a mark for a missing joint, so
    ``invalidate`` changes nothing.
    """
    document = _kept(take)
    frames = np.flatnonzero(take.changed.any(axis=1))
    if not len(frames):
        path.write_bytes(document.raw)
        return take
    wanted, fixed = take.changed[frames], (take.trusted & ~take.changed)[frames]
    before, targets = document.poses[frames], take.positions[frames]
    poses, fitted = _fit(document, take, frames)
    changed = (poses != before) & np.isfinite(poses)
    path.write_bytes(_patch(document, frames, poses, changed))

    untouched = fixed & ~changed.any(axis=1, keepdims=True)
    positions, trusted, done = take.positions.copy(), take.trusted.copy(), np.zeros_like(take.filled)
    reached = kinematics(document.skeleton, poses)
    positions[frames] = np.where(untouched[:, :, None], targets, reached)
    trusted[frames] &= ~wanted | fitted
    done[frames] = fitted
    told = tuple(_unfitted(take, take.changed & ~done))
    filled, moved = take.filled & done, take.moved & done
    return replace(
        take, positions=positions, trusted=trusted, filled=filled, moved=moved, findings=take.findings + told
    )


def _kept(take: Take) -> Document:
    if take.origin is None or not isinstance(take.origin.document, Document):
        raise ValueError("take must have been read from a BVH or AMC file. Got one without its kept text.")
    return take.origin.document


def _fit(document: Document, take: Take, frames: NDArray[np.intp]) -> tuple[Floats, Bools]:
    """The poses (f, C) of some frames as they will be spelled, and the joints (f, J) that they fit.

    The fit sees all frames, because it starts from those around a gap.
    """
    fixed = take.trusted & ~take.changed
    result = fit(document.skeleton, document.poses, take.positions, fixed, take.changed)
    before = document.poses[frames]
    after = _spelled(document, result.poses[frames])
    after = np.where(result.changed[frames] & np.isfinite(after), after, before)
    positions = kinematics(document.skeleton, after)
    held = np.linalg.norm(positions - take.positions[frames], axis=2) <= TRUSTED_MM
    kept = np.all(held | ~fixed[frames], axis=1, keepdims=True)
    fitted = result.fitted[frames] & kept & np.isfinite(positions).all(axis=2)
    return np.where(fitted.any(axis=1, keepdims=True), after, before), fitted


def _unfitted(take: Take, left: Bools) -> list[Finding]:
    return [
        Finding(
            rule="fit",
            level="warning",
            marker=take.markers[joint],
            frames=(start, stop),
            message=f"no joint angles bring it to its filled position and keep all trusted joints within "
            f"{TRUSTED_MM} mm; it is left as it was",
            advice="distrust its neighbours too, or fill with another method",
        )
        for joint, start, stop in column_runs(left)
    ]


def decimals(document: Document) -> NDArray[np.int64]:
    """(C,) decimals of a respelled number: as many as the first frame has, and enough for 0.1 mm."""
    tokens = TOKEN.findall(blank(document.block(0)))
    first = [tokens[place] for place in document.places[0]]
    own = np.array([len(t.partition(b".")[2]) * (b"e" not in t.lower()) for t in first])
    turns = np.array([channel.is_rotation for channel in document.skeleton.channels])
    finest = np.where(turns, SPELLING_DEGREES, SPELLING_MM)
    needed = np.ceil(np.log10(document.scale / finest) - 1e-9)
    of_kind = np.where(turns, max(own[turns], default=0), max(own[~turns], default=0))
    return np.maximum(needed, np.minimum(of_kind, MOST_DECIMALS)).clip(0).astype(np.int64)


def _spelled(document: Document, poses: Floats) -> Floats:
    """Poses as they are after being spelled and read again."""
    values = poses / document.scale
    places = decimals(document)
    columns = [np.char.mod(f"%.{n}f", values[:, c]).astype(np.float64) for c, n in enumerate(places)]
    return np.stack(columns, axis=1) * document.scale


def _patch(document: Document, frames: NDArray[np.intp], poses: Floats, changed: Bools) -> bytes:
    """The kept text with the changed numbers of some frames respelled."""
    spell = [f"%.{n}f" for n in decimals(document)]
    pieces, at = [], 0
    for frame, values, marks in zip(frames, poses / document.scale, changed, strict=True):
        start, places = int(document.starts[frame]), document.places[frame]
        spans = [match.span() for match in TOKEN.finditer(blank(document.block(frame)))]
        for column in sorted(np.flatnonzero(marks), key=places.__getitem__):
            first, last = spans[places[column]]
            pieces += [document.raw[at : start + first], (spell[column] % values[column]).encode()]
            at = start + last
    return b"".join([*pieces, document.raw[at:]])


def prove(take: Take, path: Path, parse: Callable[[bytes], Document]) -> None:
    """Raise FormatError unless a written file is the kept text but for the numbers of the filled frames.

    take: the return of ``write``. Filled joints must lie where the take says within 1e-6 mm, trusted joints where
    they lay within 0.1 mm.
    """
    kept, raw = _kept(take), load(path)
    if raw == kept.raw and not take.changed.any():
        return
    written = parse(raw)
    repaired = np.any(take.changed, axis=1)
    header = slice(0, int(kept.starts[0]))
    if written.poses.shape != kept.poses.shape or written.raw[header] != kept.raw[header]:
        raise FormatError(path, "the header and the table's size must be those of the input. Got others.")
    for frame in range(len(repaired)):
        old, new = kept.block(frame), written.block(frame)
        if old != new and not (repaired[frame] and _respelled(kept, frame, old, new)):
            raise FormatError(
                path,
                "only numbers of repaired frames must differ from the input. Got another difference.",
                frame=take.first_frame + frame,
            )
    frames = np.flatnonzero(repaired)
    after, before = (kinematics(d.skeleton, d.poses[frames]) for d in (written, kept))
    changed = take.changed[frames]
    _close(take, path, frames, after - take.positions[frames], changed, REREAD_MM)
    _close(take, path, frames, after - before, take.trusted[frames] & ~changed, TRUSTED_MM + REREAD_MM)


def _respelled(kept: Document, frame: int, old: bytes, new: bytes) -> bool:
    """Whether two blocks differ in the spelling of channels only."""
    names, values = TOKEN.findall(blank(old)), TOKEN.findall(blank(new))
    if len(names) != len(values) or TOKEN.split(blank(old)) != TOKEN.split(blank(new)):
        return False
    differ = {place for place, pair in enumerate(zip(names, values, strict=True)) if pair[0] != pair[1]}
    return differ <= set(kept.places[frame].tolist())


def _close(take: Take, path: Path, frames: NDArray[np.intp], apart: Floats, where: Bools, most: float) -> None:
    distance = np.linalg.norm(apart, axis=2)
    for row, joint in np.argwhere(where & ~(distance <= most))[:1]:
        raise FormatError(
            path,
            f"the joint must be within {most:g} mm of where it belongs. Got {distance[row, joint]:g} mm.",
            frame=take.first_frame + int(frames[row]),
            marker=take.markers[joint],
        )
