"""Limits of ``mocapclean check`` for a purpose: the presets of ``check.preset``, by the names of the limits."""

from typing import Any

PRESETS: dict[str, dict[str, Any]] = {
    "gait-lab": {"longest_inner_gap": 0.2, "missing": 10.0, "replaced": 0.1, "swaps": 0, "bone_deviation": 40.0},
    "film": {"longest_inner_gap": 0.5, "missing": 20.0, "replaced": 0.5, "swaps": 0, "bone_deviation": 60.0},
    "game": {"longest_inner_gap": 1.0, "missing": 40.0, "replaced": 1.0, "swaps": 0, "bone_deviation": 120.0},
}
"""The limits of each preset, the strictest first; units as in ``settings.TakeLimits``.

Sources: up to 0.2 s Howarth & Callaghan (2010, doi:10.1080/10255841003664701) found splines the best of
three interpolations. At 0.5 and 1 s the default method has the errors of docs/results.md, `bench markers`. The other
limits are chosen on one half of real captures, by percentiles of what is found there. docs/check.md has these, and how
many captures pass on both halves.
"""


def with_preset(limits: Any) -> Any:
    """Return limits with those of their preset in the places that they leave open; no mapping is returned as it is."""
    preset = limits.get("preset") if isinstance(limits, dict) else None
    return {**PRESETS[preset], **limits} if isinstance(preset, str) and preset in PRESETS else limits
