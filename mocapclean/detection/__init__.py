"""Detection of samples that cannot be trusted: rules that lower trust, and never raise it.

A rule is a module in ``rules`` and a line in ``RULES``. The module has:

- ``Params``: a frozen dataclass of its parameters, with their defaults;
- ``examine(evidence, params)``: returns the samples (F, M) that the rule distrusts, and its Findings;
- ``AFTER_OTHERS = True``, if the rule must see only the samples that the other rules trust.

``detect`` runs the rules on the same evidence and unites their results. A sample that any rule distrusts is not
trusted. Where several rules find the same span, the finding of the first in ``RULES`` stays and names the others.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace as dc_replace
from types import ModuleType
from typing import Any

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.excursions import with_one_boundary
from mocapclean.detection.rules import (
    bone,
    drift,
    flicker,
    frozen,
    jump,
    missing,
    outlier,
    predict,
    spike,
    swap,
    tdd,
    units,
)
from mocapclean.errors import UsageError
from mocapclean.take import Finding, Take

RULES: dict[str, ModuleType] = {
    "missing": missing,
    "units": units,
    "swap": swap,
    "frozen": frozen,
    "drift": drift,
    "flicker": flicker,
    "spike": spike,
    "jump": jump,
    "bone": bone,
    "predict": predict,
    "tdd": tdd,
    "outlier": outlier,
}


def detect(
    take: Take, rules: Mapping[str, Any] | None = None, *, fix_swaps: bool = False, replace: str = "sure"
) -> Take:
    """Return a take in which the samples that a rule distrusts are untrusted, with the findings of the rules.

    rules: name -> ``Params`` of the rules to run, unless they are not ``enabled``; None runs all of ``RULES`` with
    their defaults. fix_swaps: exchange swapped labels back (``moved``) instead of distrusting the samples. Raises
    UsageError for a name that is not in ``RULES``.
    """
    params = with_one_boundary(_enabled(rules))
    if fix_swaps and "swap" in params:
        take = swap.undo(Evidence(take), params.pop("swap"))
    trusted, findings = take.trusted, list[Finding]()
    for last in (False, True):
        evidence = Evidence(dc_replace(take, trusted=trusted))
        for name in params:
            if getattr(RULES[name], "AFTER_OTHERS", False) == last:
                distrusted, of_rule = RULES[name].examine(evidence, params[name])
                trusted = trusted & ~distrusted
                findings += of_rule
    return dc_replace(take, trusted=trusted, findings=(*take.findings, *_united(findings)))


def _enabled(rules: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the parameters of the rules that are enabled, in the order of ``RULES``."""
    params = {name: module.Params() for name, module in RULES.items()} if rules is None else rules
    for name in params:
        if name not in RULES:
            raise UsageError(f"a trust rule must be one of {', '.join(RULES)}. Got {name!r}.")
    return {name: params[name] for name in RULES if name in params and getattr(params[name], "enabled", True)}


def _united(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings in which those about the same span of a marker are one, that of the first rule."""
    united: list[Finding] = []
    of_marker = defaultdict[str | None, list[int]](list)
    for finding in findings:
        for index in of_marker[finding.marker]:
            earlier = united[index]
            frames = _common_span(finding, earlier) if finding.rule != earlier.rule else None
            if frames:
                message = f"{earlier.message}; also found by {finding.rule}"
                united[index] = dc_replace(earlier, frames=frames, message=message)
                break
        else:
            of_marker[finding.marker].append(len(united))
            united.append(finding)
    return united


def _common_span(one: Finding, other: Finding) -> tuple[int, int] | None:
    """Return the span of both findings, if they concern one marker and share more than half of the longer one."""
    if one.marker is None or one.marker != other.marker or one.frames is None or other.frames is None:
        return None
    (a, b), (c, d) = one.frames, other.frames
    shared = min(b, d) - max(a, c)
    return (min(a, c), max(b, d)) if 2 * shared > max(b - a, d - c) else None
