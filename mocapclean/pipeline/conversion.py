"""Conversion of a take into a new file of another format, with an account of what the new file does not have."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mocapclean import formats
from mocapclean.config.settings import Settings
from mocapclean.errors import UsageError
from mocapclean.formats.declarations import DECLARATIONS
from mocapclean.pipeline.prepare import matching, read_take
from mocapclean.take import Finding, Take


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """The record of a converted take.

    read_as, written_as: names of formats. missing: samples that are missing, in both files. not_carried: what the new
    file does not have, in words. findings: of the reader.
    """

    source: Path
    output: Path
    read_as: str
    written_as: str
    n_markers: int
    n_frames: int
    first_frame: int
    rate: float
    missing: int
    not_carried: tuple[str, ...]
    findings: tuple[Finding, ...]


def convert(source: Path, output: Path, settings: Settings, to: str | None = None) -> Conversion:
    """Convert a file into a new one; ``to``: the name of its format, else by the suffix of ``output``.

    Of a skeleton the positions of the joints are written, unless the new format stores poses too. Only the markers that
    ``settings.markers`` names are written, if it names some. Raises UsageError for a format that is not known or cannot
    hold the take, FormatError for a file that cannot be read or written.
    """
    name = to or formats.formats_with(output)[0]
    suffixes = formats.declaration(output, name).suffixes
    if output.suffix.lower() not in suffixes:
        raise UsageError(f"{output}: a file of format {name} must end in {' or '.join(suffixes)}.")
    whole = read_take(source, settings)
    read_as = whole.origin.format if whole.origin else ""
    take = _chosen(whole, settings)
    if take.poses is not None and DECLARATIONS[name].stores == "positions":
        take = replace(take.as_markers(), skeleton=None)
    if read_as != name and take.origin is None:
        take = replace(take, origin=whole.origin)  # for the events of the file
    written = formats.write(take, output, format=name, overwrite=settings.overwrite)
    return Conversion(
        source=source,
        output=output,
        read_as=read_as,
        written_as=name,
        n_markers=len(written.markers),
        n_frames=len(written.trusted),
        first_frame=max(written.first_frame, DECLARATIONS[name].lowest_frame or written.first_frame),
        rate=written.rate,
        missing=int((~take.trusted).sum()),
        not_carried=formats.not_carried(whole, name),
        findings=whole.findings,
    )


def _chosen(take: Take, settings: Settings) -> Take:
    """Return a take with the markers alone that the settings name; the whole take if they name none."""
    if not settings.markers:
        return take
    columns = {column for pattern in settings.markers for column in matching(pattern, take, "--markers")}
    return take if len(columns) == len(take.markers) else take.select(np.array(sorted(columns)))
