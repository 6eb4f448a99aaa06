"""A trained dictionary of a body: short movements (atoms) of its parts and poses of all markers, and its file."""

import hashlib
import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats
from mocapclean.dictionaries.body_parts import PARTS, BodyParts, distinct_bare_names, from_mapping
from mocapclean.dictionaries.landmarks import place_landmarks, plane_frames
from mocapclean.errors import FormatError, MocapcleanError, UsageError
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.take import Take

SCHEMA = 1  # version of the file's header
# Largest relative difference between the frame rates of a take and of a dictionary; chosen by hand.
RATE_TOLERANCE = 0.01


@dataclass(frozen=True, kw_only=True)
class Dictionary:
    """A trained dictionary, in millimetres and in the frame of reference that moves with the body (``BodyParts``).

    parts: the markers of each part. rate: Hz, of the takes it was learned from. window: L, frames in an atom. atoms:
    for each part (K, L·3m), windows of its m markers. poses: (P, M, 3), of all markers in the order of
    ``parts.markers``. parameters: those of the training.
    """

    parts: BodyParts
    rate: float
    window: int
    atoms: Mapping[str, Floats]
    poses: Floats
    parameters: Mapping[str, Any]

    @property
    def markers(self) -> tuple[str, ...]:
        """The names of its markers, part after part."""
        return self.parts.markers

    @cached_property
    def sha256(self) -> str:
        """The hash of its header and arrays."""
        digest = hashlib.sha256(self._header().encode())
        for array in self._arrays().values():
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()

    def columns(self, take: Take) -> NDArray[np.intp]:
        """Return the take's column of each marker; raise UsageError unless names and rate are the same.

        Names are compared without subjects (``Subject:NAME``).
        """
        names = distinct_bare_names(take.markers)
        extra, lacking = sorted({*names} - {*self.markers}), sorted({*self.markers} - {*names})
        if extra or lacking:
            raise UsageError(
                "the dictionary must be of the take's markers. "
                + "; ".join(
                    f"only the {side} has {', '.join(some)}"
                    for side, some in (("take", extra), ("dictionary", lacking))
                    if some
                )
                + ". Train one on takes with these markers, or --exclude what it does not have."
            )
        if abs(take.rate - self.rate) > RATE_TOLERANCE * self.rate:
            raise UsageError(f"the dictionary must be of the take's {take.rate:g} Hz. Got {self.rate:g} Hz.")
        column_of = {name: column for column, name in enumerate(names)}
        return np.array([column_of[name] for name in self.markers], dtype=np.intp)

    def frames(self, positions: Floats, trusted: Bools) -> BodyFrames:
        """Return the frames of reference of the body for positions (F, M, 3) in the order of ``markers``."""
        return body_frames(self.parts, positions, trusted, self.poses)

    def save(self, path: Path) -> None:
        """Write the dictionary as .npz without compression or pickles; equal dictionaries give equal bytes."""
        header = np.frombuffer(self._header().encode(), dtype=np.uint8)
        with path.open("wb") as file:
            np.savez(file, header=header, **self._arrays())  # type: ignore[arg-type]

    def _arrays(self) -> dict[str, Floats]:
        return {"poses": self.poses, **{f"atoms_{part}": self.atoms[part] for part in PARTS if part in self.atoms}}

    def _header(self) -> str:
        content = {
            "schema": SCHEMA,
            "parts": self.parts.as_mapping(),
            "rate": self.rate,
            "window": self.window,
            "parameters": dict(self.parameters),
        }
        return json.dumps(content, sort_keys=True)


def body_frames(parts: BodyParts, positions: Floats, trusted: Bools, model: Floats) -> BodyFrames:
    """Return the body's frames for positions (F, M, 3) of ``parts.markers``; model: poses (P, M, 3) in such frames."""
    column_of = {name: column for column, name in enumerate(parts.markers)}
    groups = [np.array([column_of[name] for name in group]) for group in parts.landmarks]
    torso = np.array([column_of[name] for name in parts.torso])
    return plane_frames(place_landmarks(positions, trusted, groups, torso, model))


def load(path: Path) -> Dictionary:
    """Return the dictionary of a file from ``save``; raise FormatError for any other or damaged file."""
    try:
        with zipfile.ZipFile(path) as archive:
            stored = {entry.filename.removesuffix(".npy"): _array(archive, entry) for entry in archive.infolist()}
        header = json.loads(stored.pop("header").tobytes())
        if header.get("schema") != SCHEMA:
            raise ValueError(f"its schema must be {SCHEMA}, got {header.get('schema')!r}")
        dictionary = Dictionary(
            parts=from_mapping(header["parts"], "body parts"),
            rate=float(header["rate"]),
            window=int(header["window"]),
            atoms={name.removeprefix("atoms_"): array for name, array in stored.items() if name != "poses"},
            poses=stored["poses"],
            parameters=header["parameters"],
        )
        _check(dictionary)
    except OSError as fault:
        raise FormatError(path, f"cannot be read: {fault.strerror or fault}.") from None
    except (ValueError, KeyError, TypeError, AttributeError, zipfile.BadZipFile, MocapcleanError) as fault:
        raise FormatError(path, f"is not a dictionary of 'mocapclean train': {fault}.") from None
    return dictionary


def _array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> NDArray[Any]:
    """Return one array of the file; its declared size must equal its stored bytes before memory is allocated."""
    if entry.compress_type != zipfile.ZIP_STORED:
        raise ValueError(f"{entry.filename} must not be compressed")
    with archive.open(entry) as file:
        shape, dtype = _declared(file)
        start = file.tell()
        if dtype.hasobject or int(np.prod(shape, dtype=object)) * dtype.itemsize != entry.file_size - start:
            raise ValueError(f"{entry.filename} must hold the numbers it declares")
        return np.frombuffer(file.read(), dtype=dtype).reshape(shape)


def _declared(file: BinaryIO | Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and type that the header of an .npy file declares."""
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("its arrays must be of npy version 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
    if fortran:
        raise ValueError("its arrays must be in C order")
    return shape, dtype


def _check(dictionary: Dictionary) -> None:
    """Raise ValueError unless shapes and types agree and all numbers are finite."""
    n_markers, parts = len(dictionary.markers), dictionary.parts.parts
    widths = {part: dictionary.window * 3 * len(parts[part]) for part in PARTS if parts[part]}
    if not (dictionary.rate > 0 and dictionary.window > 0):
        raise ValueError("rate and window must be positive")
    if set(dictionary.atoms) != set(widths):
        raise ValueError(f"atoms must be of {', '.join(widths)}, got {', '.join(dictionary.atoms)}")
    for name, array in dictionary._arrays().items():
        if array.dtype != np.float64 or not len(array) or not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite numbers in double precision")
    if dictionary.poses.shape[1:] != (n_markers, 3):
        raise ValueError(f"poses must be (P, {n_markers}, 3), got {dictionary.poses.shape}")
    for part, width in widths.items():
        if dictionary.atoms[part].ndim != 2 or dictionary.atoms[part].shape[1] != width:
            raise ValueError(f"the atoms of {part} must be (K, {width}), got {dictionary.atoms[part].shape}")


def require_dictionary(library: object) -> Dictionary:
    """Return the library as a Dictionary; raise UsageError when it is none."""
    if not isinstance(library, Dictionary):
        raise UsageError("this method needs a trained dictionary. Give --dictionary; 'mocapclean train' makes one.")
    return library
