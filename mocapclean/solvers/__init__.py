"""Gap-filling methods: one module per algorithm, one literal registry.

A method module has

- ``REFERENCE``: authors, year, title and DOI in one line;
- ``TRAITS``: the ``Traits``, its needs and its results;
- ``Params``: a frozen dataclass whose fields have a range, a default and an ``About``;
- ``solve(take, params, fillable, ...)``: the Solution. fillable: (F, M) bool, the untrusted samples that the method may
  fill. According to the traits there follow ``wanted`` (F, M) bool and the Solution to begin with or None, the trained
  Dictionary, and the KnownBones.

``running.run_method`` calls ``solve``, with at least one fillable sample unless trusted samples are to be corrected.

A method never reads an untrusted sample and fills nothing but fillable ones. It has no access to files, the clock, the
terminal or a global random state.
"""

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
from mocapclean.solvers.method import Method

SOLVERS: dict[str, Method] = {
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

AUTO_CANDIDATES = tuple(
    sorted(
        (name for name, module in SOLVERS.items() if module.TRAITS.auto_place is not None),
        key=lambda name: SOLVERS[name].TRAITS.auto_place or 0,
    )
)
"""The candidates of method auto by default, in the order in which they are tried."""
