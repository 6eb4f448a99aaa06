"""Other takes of the same subject, which a method learns from: read, checked against a take, and given to it."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.geometry.distances import robust_distances
from mocapclean.pipeline.inspection import digest
from mocapclean.pipeline.outcome import LearntFrom
from mocapclean.pipeline.prepare import prepare
from mocapclean.take import Take
from mocapclean.take.names import bare_name
from mocapclean.take.session import Session, Stretch

_FEWEST_FRAMES = 30  # frames in which both markers of a pair must be trusted; that of ``take.bones``
_RIGID = 3.0  # mm, robust SD of a distance in both takes up to which it is compared; that of ``take.bones``
_LONGEST = 800.0  # mm, longest distance that is compared; that of ``take.bones``
_FEWEST_PAIRS = 3  # rigid pairs that two takes must share for their sizes to be compared; chosen by hand
_SAME_SUBJECT = 5.0
"""Largest median difference of the rigid distances of two takes, mm, up to which they are of one subject.

It was at most 2.3 in nine pairs of takes of one subject and in stretches of 300 frames of eight takes, and at least 9.4
in four pairs of takes of different subjects; shared captures, no command.
"""
_SAME_PLACE = 10.0  # mm, the same for one marker's distances, beyond which it was placed anew; chosen by hand
_MOST_NAMED = 5  # names of a list that a message gives; chosen by hand
_SAME_RATE = 1e-3  # relative difference of frame rates up to which they are equal; chosen by hand
_SAME_SAMPLES = 0.5  # share of equal samples from which two takes are one capture; chosen by hand


@dataclass(frozen=True, kw_only=True)
class SessionTake:
    """A take to learn from after detection: its file and hash, and its markers that have a label."""

    path: Path
    sha256: str
    take: Take


def read_session(paths: Iterable[Path], settings: Settings) -> tuple[SessionTake, ...]:
    """Return the takes of some files after detection, as for any take; a capture once, the first file of it.

    Raises FormatError for a file that cannot be read, UsageError for one that has joints instead of markers.
    """
    settings = settings.but(gaps=None, markers=(), exclude=(), fix_swaps=False, skeleton=None, frames=None, events=None)
    found: dict[str, SessionTake] = {}
    for path in paths:
        take = prepare(path, settings).selected
        sha256 = digest(path)
        if sha256 not in found:
            if take.poses is not None:
                raise UsageError(f"{path}: --learn-from must name takes of markers. This one has joints.")
            take = replace(take.select(np.flatnonzero(~take.detached)), findings=())
            if not any(_is_same_capture(each.take, take, _columns(each.take, take)) for each in found.values()):
                found[sha256] = SessionTake(path=path, sha256=sha256, take=take)
    return tuple(found.values())


def save_session(path: Path, takes: Sequence[SessionTake]) -> None:
    """Write takes to learn from into a file, for the processes of a run."""
    facts: list[list[Any]] = []
    arrays: dict[str, Any] = {}
    for k, each in enumerate(takes):
        first, rate, markers = each.take.first_frame, each.take.rate, each.take.markers
        facts.append([str(each.path), each.sha256, rate, first, markers])
        arrays |= {f"positions{k}": each.take.positions, f"trusted{k}": each.take.trusted}
    with path.open("wb") as file:
        np.savez(file, facts=np.array(json.dumps(facts)), **arrays)


@lru_cache(maxsize=1)
def load_session(path: Path) -> tuple[SessionTake, ...]:
    """Return the takes that ``save_session`` wrote; read once by each process."""
    with np.load(path, allow_pickle=False) as arrays:
        return tuple(
            SessionTake(
                path=Path(name),
                sha256=sha256,
                take=Take(
                    positions=arrays[f"positions{k}"],
                    trusted=arrays[f"trusted{k}"],
                    markers=tuple(markers),
                    rate=rate,
                    first_frame=first,
                ),
            )
            for k, (name, sha256, rate, first, markers) in enumerate(json.loads(str(arrays["facts"])))
        )


def with_session(
    take: Take, source: Path, sha256: str, session: Sequence[SessionTake]
) -> tuple[Take, tuple[LearntFrom, ...]]:
    """Return a take with what it can learn from the takes of a session, and the files that it learns from.

    A take never learns from itself: from its own file, from an equal one, or from one with the same samples, such as an
    earlier repair. Raises UsageError, naming files, markers and distances, unless all others have its markers, its
    sizes and its frame rate or a multiple.
    """
    if not session:
        return take, ()
    if take.poses is not None:
        raise UsageError(f"{source}: --learn-from must go with takes of markers (C3D). This one has joints.")
    faults: list[str] = []
    stretches: list[Stretch] = []
    learnt: list[LearntFrom] = []
    for each in session:
        columns = _columns(take, each.take)
        missing = [name for name, column in zip(take.markers, columns, strict=True) if column < 0]
        missing = [name for name in missing if not take.detached[take.markers.index(name)]]
        if sha256 == each.sha256 or (not missing and _is_same_capture(take, each.take, columns)):
            continue
        step = round(each.take.rate / take.rate)
        if missing:
            faults.append(f"{each.path} lacks {_listed(missing)}")
        elif step < 1 or abs(each.take.rate / take.rate - step) > _SAME_RATE * step:
            faults.append(f"{each.path} has {each.take.rate:g} Hz for {take.rate:g} Hz")
        else:
            stretch = _stretch(each.take, columns, step)
            fault, moved = _compared(take, stretch)
            faults += [f"{each.path} {fault}"] if fault else []
            stretch.trusted[:, moved] = False
            stretches.append(stretch)
            names = tuple(take.markers[k] for k in moved)
            learnt.append(LearntFrom(path=each.path, sha256=each.sha256, moved=names))
    if faults:
        raise UsageError(
            f"{source}: takes to learn from must have the same subject, markers and frame rate. {'; '.join(faults)}. "
            "Leave these files out of --learn-from."
        )
    return replace(take, session=Session.of(stretches, take.rate)), tuple(learnt)


def _columns(take: Take, other: Take) -> Ints:
    """Return the column (M,) of each marker of a take in another one, by its name without the subject; -1 for none.

    The full name decides where several subjects have the bare one. Detached columns have none.
    """
    full = {name: column for column, name in enumerate(other.markers)}
    own, bare = list(map(bare_name, take.markers)), list(map(bare_name, other.markers))

    def column(name: str, bare_one: str) -> int:
        if own.count(bare_one) == 1 and bare.count(bare_one) == 1:
            return bare.index(bare_one)
        return full.get(name, -1)

    found = [column(*names) for names in zip(take.markers, own, strict=True)]
    return np.where(take.detached, -1, np.array(found, dtype=np.intp))


def _stretch(other: Take, columns: Ints, step: int) -> Stretch:
    """Return every ``step``-th frame of these columns of another take; column -1 is never trusted."""
    positions = np.where((columns >= 0)[:, None], other.positions[::step][:, columns], 0.0)
    return Stretch(positions, np.asarray(other.trusted[::step][:, columns] & (columns >= 0), dtype=bool))


def _is_same_capture(take: Take, other: Take, columns: Ints) -> bool:
    """Whether half of the samples that two takes have in the same frames are equal."""
    first = max(take.first_frame, other.first_frame)
    own, there = slice(first - take.first_frame, None), slice(first - other.first_frame, None)
    positions, trusted = _stretch(other, columns, 1)
    n_frames = min(len(take.trusted[own]), len(trusted[there]))
    both = take.trusted[own][:n_frames] & trusted[there][:n_frames]
    equal = (take.positions[own][:n_frames] == positions[there][:n_frames]).all(axis=2) & both
    return bool(equal.sum() > _SAME_SAMPLES * both.sum())


def _compared(take: Take, other: Stretch) -> tuple[str, list[int]]:
    """Return why another take is not of the same subject, or "", and the markers (columns) placed elsewhere there.

    Only pairs of markers are compared whose distance is constant in both takes.
    """
    lengths, there = _rigid_lengths(take.positions, take.trusted), _rigid_lengths(*other)
    differences = np.abs(lengths - there)
    pairs = np.argwhere(np.triu(np.isfinite(differences), 1))
    if len(pairs) < _FEWEST_PAIRS:
        return "shares no pairs of markers at constant distances, so that its size cannot be compared", []
    if np.median(differences[tuple(pairs.T)]) > _SAME_SUBJECT:
        largest = sorted(pairs.tolist(), key=lambda pair: -differences[pair[0], pair[1]])
        named = [
            f"{take.markers[a]}-{take.markers[b]} {there[a, b]:.0f} for {lengths[a, b]:.0f} mm" for a, b in largest
        ]
        return f"has other distances between markers: {_listed(named)}", []
    compared = np.flatnonzero(np.isfinite(differences).any(axis=0))
    return "", [int(k) for k in compared if np.nanmedian(differences[k]) > _SAME_PLACE]


def _rigid_lengths(positions: Floats, trusted: Bools) -> Floats:
    """Return the median distances (M, M) of markers at constant distances, mm; NaN for all others."""
    length, spread = robust_distances(positions, trusted, _FEWEST_FRAMES)
    return np.where((spread <= _RIGID) & (length > 0.0) & (length <= _LONGEST), length, np.nan)


def _listed(names: Sequence[str]) -> str:
    """Return the first names as text, and the number of the others."""
    others = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {others} more" if others > 0 else "")
