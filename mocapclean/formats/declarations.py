"""The declarations of all formats, which are needed before the module of any format is."""

from mocapclean.formats.contract import Declaration

AMC_RATE = 120.0
"""Hz: the rate of the CMU motion capture database (mocap.cs.cmu.edu), from which most AMC files come."""
ASF_SUFFIX = ".asf"
"""The ending of the file that holds the skeleton of AMC files."""
FIRST_FRAME = 1
"""The lowest number of a first frame in a C3D file (C3D user guide, header)."""
CENTIMETRE = 10.0
"""Millimetres: the unit of length of most BVH files, of those without a human body, and of those created here."""


def _table(*suffixes: str, states_events: bool = False, default_unit: float | None = None) -> Declaration:
    """Return the declaration of a format that is a table of markers."""
    return Declaration(
        suffixes=suffixes,
        columns="markers",
        stores="positions",
        marks_missing=True,
        lists_points=True,
        states_events=states_events,
        precision="six decimals of a millimetre",
        default_unit=default_unit,
    )


DECLARATIONS: dict[str, Declaration] = {
    "c3d": Declaration(
        suffixes=(".c3d",),
        columns="markers",
        stores="positions",
        marks_missing=True,
        lists_points=True,
        states_events=True,
        precision="numbers of 32 bits, seven digits",
        lowest_frame=FIRST_FRAME,
    ),
    "bvh": Declaration(
        suffixes=(".bvh",), columns="joints", stores="poses", marks_missing=False, default_unit=CENTIMETRE
    ),
    "amc": Declaration(
        suffixes=(".amc",),
        columns="joints",
        stores="poses",
        marks_missing=False,
        skeleton_suffix=ASF_SUFFIX,
        default_rate=AMC_RATE,
    ),
    "trc": _table(".trc"),
    "qualisys": _table(".tsv", states_events=True),
    "csv": _table(".csv", ".tsv", default_unit=1.0),
    "motive": _table(".csv"),
    "nexus": _table(".csv", states_events=True),
}
"""The declaration of each format, by the name of its module.

Where several have a suffix, the content of a file decides; a new file gets the first of them."""
