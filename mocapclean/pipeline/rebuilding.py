"""Views of takes from a report: its row, the input and the output that it names, and the sidecar if there is one."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mocapclean import formats
from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.errors import FormatError, UsageError
from mocapclean.pipeline.view import View, view
from mocapclean.take import Finding, Take
from mocapclean.take.names import matching_columns
from mocapclean.take.status import Codes, Status, detected, leave_outside
from mocapclean.units import MILLIMETRES

_EXPECTED_PER_SD = 3**0.5  # the expected 3D error of a gap over the sd of a coordinate
_ROUNDING = 0.005  # mm, the largest difference that the digits of a file explain; chosen by hand
_BY_CODE = {status.code: status for status in Status}


def rebuilt_view(
    row: Mapping[str, Any], config: Mapping[str, Any], source: Path, output: Path | None, sidecar: Path | None
) -> View:
    """Return the view of a take from its row of a report.

    config: the configuration of the report. Where there is no sidecar, the status of a sample is that of its gap, and
    the bar of a filled one is the gap's expected error over √3. Raises FormatError or UsageError when the files are
    not those of the report.
    """
    whole = _read(source, config)
    columns = _columns(whole, row, config)
    before = _judged(whole.select(columns), row)
    written = _read(output, config, beside=source) if output else whole
    if len(written.trusted) != len(whole.trusted) or written.markers != whole.markers:
        raise UsageError(f"{output}: the output must have the frames and markers of {source}. It has others.")
    after = written.select(columns)
    stored = _from_sidecar(sidecar, before) if sidecar else None
    codes, sd = stored if stored else _from_row(row, before, after)
    if judged := row.get("judged_frames"):
        inside = np.zeros(len(codes), dtype=bool)
        inside[slice(*_span(judged, before))] = True
        leave_outside(codes, inside)
    supplied = (codes == Status.FILLED) | (codes == Status.REPLACED)
    after = replace(after, trusted=before.trusted, filled=supplied & ~before.trusted)
    return view(whole, before, written, after, codes, sd, invalidated=bool(config.get("invalidate")))


def _read(path: Path, config: Mapping[str, Any], beside: Path | None = None) -> Take:
    """Return a take, read with the options of the report's configuration.

    beside: the file by which a skeleton in a file of its own lies, where that is not ``path``.
    """
    unit: Any = config.get("unit")
    given = config.get("format")
    options: dict[str, Any] = {"rate": config.get("rate"), "unit": MILLIMETRES.get(unit, unit), "format": given}
    if formats.needs_skeleton(path, given):
        options["skeleton"] = config.get("skeleton") or formats.companion(beside or path)
    take = formats.read(path, **options)
    others = [name for name in config.get("markers", ()) if name not in take.markers]
    if others and formats.lists_points(path, given):
        try:
            return formats.read(path, points=others, **options)
        except UsageError:  # patterns of markers, and no names of points
            return take
    return take


def _columns(whole: Take, row: Mapping[str, Any], config: Mapping[str, Any]) -> Ints:
    """Return the columns of the markers of a row: all but those that were excluded."""
    keep = np.ones(len(whole.markers), dtype=bool)
    for pattern in config.get("exclude", ()):
        keep[matching_columns(pattern, whole.markers)] = False
    if keep.sum() != row["markers"]:
        raise FormatError(Path(row["source"]), "the file must have the markers of the report. It has others.")
    return np.flatnonzero(keep)


def _judged(take: Take, row: Mapping[str, Any]) -> Take:
    """Return a take with the findings and the trust of a row."""
    if len(take.trusted) != row["frames"]:
        message = f"the file must have the {row['frames']} frames of the report. It has {len(take.trusted)}."
        raise FormatError(Path(row["source"]), message)
    findings = tuple(
        Finding(
            rule=each["rule"],
            message=each["message"],
            level=each["level"],
            marker=each["marker"],
            frames=None if each["first"] is None else _span(each, take),
            advice=each["advice"],
            suspicion=each["suspicion"],
        )
        for each in row["findings"]
    )
    if "gaps" not in row:  # a verdict, whose findings name all samples that are not trusted
        rules = {finding.rule for finding in findings if not finding.suspicion}
        judged = replace(take, findings=findings)
        distrusted = [judged.distrusted_by(rule) for rule in rules]
        return replace(judged, trusted=~np.any(distrusted, axis=0) if distrusted else np.ones_like(take.trusted))
    trusted = np.ones_like(take.trusted)
    for column, start, stop in _gaps(row, take):
        trusted[start:stop, column] = False
    return replace(take, trusted=trusted, findings=findings)


def _span(place: Mapping[str, Any], take: Take) -> tuple[int, int]:
    """Return the half-open span of indices of a place in a report."""
    return place["first"] - take.first_frame, place["last"] + 1 - take.first_frame


def _gaps(row: Mapping[str, Any], take: Take) -> list[tuple[int, int, int]]:
    """Return column, start and stop of the gaps of a row."""
    columns = {name: column for column, name in enumerate(take.markers)}
    return [(columns[gap["marker"]], *_span(gap, take)) for gap in row.get("gaps", ()) if gap["marker"] in columns]


def _from_sidecar(path: Path, take: Take) -> tuple[Codes, Floats | None] | None:
    """Return the codes and bars of a sidecar, or None if it is not that of the take."""
    try:
        with np.load(path, allow_pickle=False) as arrays:
            names, codes = arrays["status_names"].tolist(), arrays["status"]
            sd = arrays["sd"]
    except (OSError, ValueError, KeyError):
        return None
    if codes.shape != take.trusted.shape or any(name not in _BY_CODE for name in names):
        return None
    numbers = np.array([_BY_CODE[name] for name in names], dtype=np.uint8)
    return numbers[codes], None if np.isnan(sd).all() else sd


def _from_row(row: Mapping[str, Any], before: Take, after: Take) -> tuple[Codes, Floats | None]:
    """Return codes and bars by the gaps of a row."""
    if "gaps" not in row:
        return detected(before), None
    missing = before.distrusted_by("missing")
    codes = np.where(before.suspicious, Status.SUSPICIOUS, Status.MEASURED).astype(np.uint8)
    sd = np.full(codes.shape, np.nan)
    changed = _changed(before, after)
    if row["counts"]["moved"]:
        codes[changed & before.trusted] = Status.MOVED
    for gap, (column, start, stop) in zip(row.get("gaps", ()), _gaps(row, before), strict=False):
        span = (slice(start, stop), column)
        codes[span] = _BY_CODE[gap["status"]]
        supplied = changed[span] if gap["samples_filled"] < gap["length"] else np.full(stop - start, True)
        if gap["samples_filled"]:
            answer = np.where(missing[span], Status.FILLED, Status.REPLACED)
            codes[span] = np.where(supplied, answer, codes[span])
            if gap["expected_3d"] is not None:
                sd[span] = np.where(supplied, gap["expected_3d"] / _EXPECTED_PER_SD, np.nan)
    return codes, None if np.isnan(sd).all() else sd


def _changed(before: Take, after: Take) -> Bools:
    """Return the samples (F, M) in which two takes differ; samples that neither has do not."""
    near = np.abs(before.positions - after.positions) <= _ROUNDING
    neither = np.isnan(before.positions) & np.isnan(after.positions)
    return np.asarray(~(near | neither).all(axis=2))
