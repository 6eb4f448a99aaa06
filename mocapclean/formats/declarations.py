"""The declarations of all formats, which are needed before the module of any format is."""

from mocapclean.formats.contract import Declaration

AMC_RATE = 120.0
"""Hz: the rate of the CMU motion capture database (mocap.cs.cmu.edu), from which most AMC files come."""
ASF_SUFFIX = ".asf"
"""The ending of the file that holds the skeleton of AMC files."""
CENTIMETRE = 10.0
"""Millimetres: the unit of length of most BVH files, of those without a human body, and of those created here."""

DECLARATIONS: dict[str, Declaration] = {
    "c3d": Declaration(
        suffixes=(".c3d",),
        columns="markers",
        stores="positions",
        marks_missing=True,
        lists_points=True,
        states_events=True,
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
}
"""The declaration of each format, by the name of its module."""
