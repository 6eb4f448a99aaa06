"""Gap-filling methods: one module per algorithm, one literal registry.

A method module has

- ``REFERENCE``: authors, year, title and DOI in one line;
- ``TRAITS``: the ``Traits``, its needs and its results;
- ``Params``: a frozen dataclass whose fields have a range, a default and an ``About``;
- ``solve(take, params, fillable, ...)``: the Solution. fillable: (F, M) bool, the untrusted samples that the method may
  fill. According to the traits there follow ``wanted`` (F, M) bool and the Solution to begin with or None, the trained
  Dictionary, and the KnownBones.

``running.run_method`` calls ``solve``, with at least one fillable sample unless trusted samples are to be corrected.

A package of its own adds a method by an entry point of the group ``mocapclean.methods`` (docs/own_methods.md).

A method never reads an untrusted sample and fills nothing but fillable ones. It has no access to files, the clock, the
terminal or a global random state.
"""

from mocapclean.registry import Modules
from mocapclean.solvers.method import Method, fault_of

SOLVERS: Modules[Method] = Modules(
    __name__,
    (
        "kriging",
        "linear",
        "spline",
        "trnn2",
        "trnn",
        "tsmc",
        "dynammo",
        "bolero",
        "pca",
        "pma",
        "kalman",
        "svt",
        "scsvt",
        "ialm",
        "psvt",
        "tnnr",
        "srmmp",
        "llc",
    ),
    group="mocapclean.methods",
    needs=("REFERENCE", "TRAITS", "Params", "solve"),
    fault=fault_of,
)

AUTO_CANDIDATES = ("kriging", "pca", "pma", "kalman", "spline", "linear")
"""The candidates of method auto by default, in the order in which they are tried. The others are too slow for it."""
