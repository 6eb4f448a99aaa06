"""Gap-filling methods: one module per algorithm, one literal registry.

A method module has

- ``REFERENCE``: authors, year, title and DOI in one line;
- ``Params``: a frozen dataclass whose fields have a range, a default and the description "symbol, unit, what";
  a field in millimetres says so as its unit;
- ``solve(take, params, library=None)``: the Solution; ``library`` is the trained Dictionary, for the methods that
  learn from other takes.

``ERROR_BARS`` names the methods whose Solution has ``sd`` with their default parameters. ``GAPWISE`` names those that
take ``wanted``, samples (F, M), and need not answer for gaps without any.

A method never reads an untrusted sample, never answers for a marker or a frame in which nothing is trusted, and
knows no file, clock, terminal or global random state.
"""

from types import ModuleType

from mocapclean.solvers import (
    bolero,
    dynammo,
    ialm,
    kalman,
    kriging,
    linear,
    llc,
    pca,
    pma,
    psvt,
    scsvt,
    spline,
    srmmp,
    svt,
    tnnr,
    trnn,
    trnn2,
    tsmc,
)

SOLVERS: dict[str, ModuleType] = {
    "kriging": kriging,
    "linear": linear,
    "spline": spline,
    "trnn2": trnn2,
    "trnn": trnn,
    "tsmc": tsmc,
    "dynammo": dynammo,
    "bolero": bolero,
    "pca": pca,
    "pma": pma,
    "kalman": kalman,
    "svt": svt,
    "scsvt": scsvt,
    "ialm": ialm,
    "psvt": psvt,
    "tnnr": tnnr,
    "srmmp": srmmp,
    "llc": llc,
}

ERROR_BARS = ("kriging", "dynammo", "kalman")
GAPWISE = ("kriging",)
