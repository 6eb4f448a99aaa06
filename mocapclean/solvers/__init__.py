"""Gap-filling methods: one module per algorithm, one literal registry.

A method module has

- ``REFERENCE``: authors, year, title and DOI in one line;
- ``Params``: a frozen dataclass whose fields have a range, a default and the description "symbol, unit, what";
  a field in millimetres says so as its unit;
- ``solve(take, params, library=())``: the Solution; ``library`` is clean training takes for the methods that
  learn from others.

A method never reads an untrusted sample, never answers for a marker or a frame in which nothing is trusted, and
knows no file, clock, terminal or global random state.
"""

from types import ModuleType

from mocapclean.solvers import linear, spline, trnn2

SOLVERS: dict[str, ModuleType] = {"linear": linear, "spline": spline, "trnn2": trnn2}
