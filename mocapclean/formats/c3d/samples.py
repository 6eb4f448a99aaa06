"""The samples of a C3D file, and what their values and residuals are marks of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mocapclean.arrays import Bools, Floats, Ints, evenly_spaced
from mocapclean.formats.c3d.document import RESIDUAL, C3dDocument
from mocapclean.formats.c3d.words import located
from mocapclean.numerics.robust import quantile
from mocapclean.take import Finding

LEAST_REPEATS = 5
"""Samples with exactly the same coordinate from which on it can be a mark for missing. Chosen by hand."""
TIMES_FARTHER = 5.0
"""So many times farther from the origin than every other coordinate is a mark for missing. Chosen by hand: no
coordinate of the shared captures that is seen is farther than 5 m, where marks are from 10 m to 10 km."""
BEYOND_ANY_VOLUME = 1e5
"""mm; from here on one coordinate that repeats is a mark, below it all three must be equal. Chosen by hand: no capture
volume is 100 m from its origin."""
TRIED_FRAMES = 300
"""Frames from which the usual distance from the origin is computed. Chosen for speed."""
USUAL = 0.1
"""Quantile that is the usual distance from the origin, so that marks may be nine of ten samples. Chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class Samples:
    """The samples of some points.

    positions: (F, M, 3) millimetres, 0 where a coordinate is not finite. trusted: (F, M), those that are present.
    n_zero, n_positive: (M,), present samples with a residual of 0, and of more. n_denied: (M,), samples with
    coordinates whose residual is negative.
    """

    positions: Floats
    trusted: Bools
    n_zero: Ints
    n_positive: Ints
    n_denied: Ints

    def select(self, keep: Bools) -> "Samples":
        """Return the samples of some of the points (M,); without a copy if these are all."""
        if keep.all():
            return self
        return Samples(
            positions=self.positions[:, keep],
            trusted=self.trusted[:, keep],
            n_zero=self.n_zero[keep],
            n_positive=self.n_positive[keep],
            n_denied=self.n_denied[keep],
        )


def read_samples(document: C3dDocument) -> Samples:
    """Return the samples of the markers of a document."""
    n_markers = len(document.marker_points())
    positions = np.empty((document.n_frames, n_markers, 3))
    trusted = np.empty((document.n_frames, n_markers), dtype=bool)
    n_zero, n_positive, n_denied = np.zeros((3, n_markers), dtype=np.intp)
    with document.path.open("rb") as file, np.errstate(invalid="ignore"):
        for start, stop in document.spans():
            samples = document.samples(document.load(file, start, stop))
            has_place, residual = located(samples), samples[..., RESIDUAL]
            chunk = positions[start:stop]
            for axis in range(3):
                chunk[..., axis] = samples[..., axis]
            # A coordinate that is no number has no meaning, and would warn in every sum.
            chunk[~np.isfinite(chunk).all(axis=2)] = 0.0
            if document.factor != 1.0:
                chunk *= document.factor
            trusted[start:stop] = has_place & ~(residual < 0)
            n_zero += (trusted[start:stop] & (residual == 0)).sum(axis=0)
            n_positive += (trusted[start:stop] & (residual > 0)).sum(axis=0)
            n_denied += (has_place & (residual < 0)).sum(axis=0)
    return Samples(positions=positions, trusted=trusted, n_zero=n_zero, n_positive=n_positive, n_denied=n_denied)


def distrust_marks(samples: Samples) -> list[Finding]:
    """Lower, in place, the trust of samples that hold a far number in the place of a missing one; return a finding.

    Programs write 9999999, 1e6 or the like for a marker that is not seen. Such a coordinate repeats exactly in many
    samples and is far from all others.
    """
    marks = _marks(samples.positions, samples.trusted)
    if not len(marks):
        return []
    is_mark = np.zeros_like(samples.trusted)
    for axis in range(3):
        for mark in marks:
            is_mark |= samples.trusted & (np.abs(samples.positions[..., axis]) == mark)
    samples.trusted[is_mark] = False
    n_markers = int(is_mark.any(axis=0).sum())
    values = ", ".join(f"{mark:.10g}" for mark in marks)
    message = (
        f"{_count(int(is_mark.sum()), 'sample')} of {_count(n_markers, 'marker')} hold {values} mm, exactly repeated "
        "and far from all others, and are read as missing"
    )
    return [Finding(rule="marks", level="warning", message=message)]


def _marks(positions: Floats, trusted: Bools) -> NDArray[np.float64]:
    """Return the magnitudes, mm, that are marks for missing samples in positions (F, M, 3) with trust (F, M)."""
    if not trusted.any():
        return np.zeros(0)
    some = evenly_spaced(len(trusted), TRIED_FRAMES)
    reach = np.abs(positions[some]).max(axis=2)[trusted[some]]
    least = TIMES_FARTHER * quantile(reach, USUAL) if reach.size else 0.0
    if max(positions.max(), -positions.min()) < least:
        return np.zeros(0)
    # Of the samples that are far, those with a coordinate that repeats are marks if they are far from the others.
    is_far = np.zeros_like(trusted)
    for axis in range(3):
        is_far |= trusted & ((positions[..., axis] >= least) | (positions[..., axis] <= -least))
    if not is_far.any():
        return np.zeros(0)
    far = np.abs(positions[is_far])
    triples = far[(far == far[:, :1]).all(axis=1), 0]
    beyond = _repeated(far[far >= BEYOND_ANY_VOLUME])
    beyond = np.array([value for value in beyond if (far == value).any(axis=1).sum() >= LEAST_REPEATS])
    marks = np.union1d(beyond, _repeated(triples))
    farthest = np.where(np.isin(far, marks), 0.0, far).max(initial=least / TIMES_FARTHER)
    return np.asarray(marks[marks >= TIMES_FARTHER * farthest])


def _repeated(values: Floats) -> Floats:
    """Return the values that are there often enough for a mark."""
    distinct, counts = np.unique(values, return_counts=True)
    return distinct[counts >= LEAST_REPEATS]


def residual_findings(samples: Samples) -> list[Finding]:
    """Return findings where no sample is trusted, and where another program has filled some."""
    n_denied, n_all = int(samples.n_denied.sum()), samples.trusted.size
    if not samples.trusted.any() and n_denied:
        message = (
            f"all residuals are negative, the mark of a missing sample, but {n_denied} of {n_all} samples have "
            "coordinates; none is trusted"
        )
        advice = "if the coordinates are right, export the file again, or set its residuals to 0"
        return [Finding(rule="residuals", level="warning", message=message, advice=advice)]
    if not samples.trusted.any():
        message = f"all {n_all} samples are marked missing, so there is nothing to trust"
        return [Finding(rule="missing", level="warning", message=message)]
    both = (samples.n_zero > 0) & (samples.n_positive > 0)
    if not both.any():
        return []
    message = (
        f"{_count(int(samples.n_zero[both].sum()), 'sample')} of {_count(int(both.sum()), 'marker')} have residual 0, "
        "the mark of an interpolated sample: another program has filled them"
    )
    return [Finding(rule="interpolated", message=message)]


def _count(number: int, word: str) -> str:
    """Return a number with its noun, in the plural but for 1."""
    return f"{number} {word}{'' if number == 1 else 's'}"
