"""Rules that lower trust. A rule never raises it.

A rule module has ``Params`` (its parameters) and ``examine(evidence, params)``, which returns the samples it distrusts
as an (F, M) bool mask and its Findings. ``detect`` runs rules on the same evidence and makes one decision of them: what
any of them distrusts is not trusted, and where several say the same of a span, the first in ``RULES`` says it. The
rules ``AFTERWARDS`` cannot tell a fault from what comes before or after it; they see only what the others trust.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

from mocapclean.detection.evidence import Evidence
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

AFTERWARDS = {"tdd", "outlier"}


def detect(take: Take, rules: Mapping[str, Any] | None = None, *, fix_swaps: bool = False) -> Take:
    """Run trust rules over a take and return it with less trust and more findings.

    rules: rule name -> its ``Params``; None runs all of ``RULES`` with their defaults. Rules that are not ``enabled``
    are passed over. fix_swaps: exchange the names of swapped markers back (``moved``) instead of distrusting them.
    Raises UsageError for a name that is not in ``RULES``.
    """
    chosen = {name: module.Params() for name, module in RULES.items()} if rules is None else dict(rules)
    for name in chosen:
        if name not in RULES:
            raise UsageError(f"a trust rule must be one of {', '.join(RULES)}. Got {name!r}.")
    chosen = {name: chosen[name] for name in RULES if name in chosen and getattr(chosen[name], "enabled", True)}
    if fix_swaps and "swap" in chosen:
        take = swap.put_back(Evidence(take), chosen.pop("swap"))
    findings = list[Finding]()
    trusted = take.trusted
    for names in (RULES.keys() - AFTERWARDS, AFTERWARDS):
        evidence = Evidence(replace(take, trusted=trusted))
        for name in (name for name in chosen if name in names):
            distrusted, told = RULES[name].examine(evidence, chosen[name])
            trusted = trusted & ~distrusted
            findings += told
    return replace(take, trusted=trusted, findings=(*take.findings, *_united(findings)))


def _united(findings: Sequence[Finding]) -> list[Finding]:
    """The findings without those about a span that an earlier one is about as well, which names their rules."""
    united: list[Finding] = []
    places = defaultdict[str | None, list[int]](list)
    for finding in findings:
        for place in places[finding.marker]:
            earlier = united[place]
            frames = _common(finding, earlier) if finding.rule != earlier.rule else None
            if frames:
                message = f"{earlier.message}; so says {finding.rule}"
                united[place] = replace(earlier, frames=frames, message=message)
                break
        else:
            places[finding.marker].append(len(united))
            united.append(finding)
    return united


def _common(one: Finding, other: Finding) -> tuple[int, int] | None:
    """The frames of both findings together, if they are about one marker and share more than half of the longer's."""
    if one.marker is None or one.marker != other.marker or one.frames is None or other.frames is None:
        return None
    (a, b), (c, d) = one.frames, other.frames
    shared = min(b, d) - max(a, c)
    return (min(a, c), max(b, d)) if 2 * shared > max(b - a, d - c) else None
