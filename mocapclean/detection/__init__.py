"""Detection of samples that cannot be trusted: rules that lower trust, and never raise it.

A rule is a module in ``rules`` and a line in ``RULES``, or a module of another package with an entry point of the group
``mocapclean.rules`` (docs/own_methods.md), which runs where it is named. The module has:

- ``Params``: a frozen dataclass of its parameters, with their defaults; ``replace`` is its level (``levels``);
- ``examine(evidence, params)``: returns the samples (F, M) that the rule doubts, and its Findings;
- ``AFTER_OTHERS = True``, if the rule must see only the samples that the other rules do not doubt;
- ``COLUMNS``: the takes that it judges, a tuple of "markers" and "joints" (takes with poses); markers without it.

``detect`` runs the rules on the same evidence and unites their results. A finding acts or is a suspicion. A sample of a
finding that acts is not trusted; those of a suspicion stay trusted. Where several rules find the same span, one finding
stays, that of the first in ``RULES`` that acts, and names the others.
"""

import dataclasses
from collections import defaultdict
from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Any

import numpy as np

from mocapclean import logs
from mocapclean.arrays import Bools
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.excursions import with_one_boundary
from mocapclean.detection.levels import REPLACE, Found, levelled
from mocapclean.detection.rule import Ruling
from mocapclean.errors import UsageError
from mocapclean.parameters import fault_of
from mocapclean.registry import Modules
from mocapclean.take import Finding, Take, require_take

RULES: Modules[ModuleType] = Modules(
    f"{__name__}.rules",
    (
        "missing",
        "units",
        "swap",
        "frozen",
        "drift",
        "flicker",
        "spike",
        "jump",
        "bone",
        "predict",
        "tdd",
        "outlier",
        "pop",
        "hold",
        "splice",
    ),
    group="mocapclean.rules",
    needs=("Params", "examine"),
    fault=lambda rule: fault_of(rule.Params),
)


def detect(
    take: Take,
    rules: Mapping[str, Any] | None = None,
    *,
    also: Sequence[str] = (),
    fix_swaps: bool = False,
    replace: str = "sure",
) -> Take:
    """Return a take in which the samples that a rule distrusts are untrusted, with the findings of the rules.

    rules: name -> ``Params`` of the rules to run, unless they are not ``enabled``; None runs all of ``RULES`` with
    their defaults. also: names of further rules to run with their defaults, such as those of other packages.
    fix_swaps: exchange swapped labels back (``moved``) instead of reporting them. replace: "sure"
    distrusts the samples of findings that the level of their rule lets act, "suspicious" those of all findings, and
    "missing" none. Raises UsageError for a name that is not in ``RULES``, or another choice.
    """
    require_take(take, "detect")
    if replace not in REPLACE:
        raise UsageError(f"replace must be one of {', '.join(REPLACE)}. Got {replace!r}.")
    with logs.timed("detected") as values:
        found = _detected(take, rules, also, fix_swaps, replace)
        findings = found.findings[len(take.findings) :]
        values |= {"distrusted": int((take.trusted & ~found.trusted).sum()), "findings": len(findings)}
        values["suspicious"] = int(found.suspicious.sum())
    for finding in findings if logs.details_are_wanted() else ():
        first, last = take.numbers(*finding.frames) if finding.frames else (None, None)
        logs.detail(
            "finding", rule=finding.rule, marker=finding.marker, first=first, last=last, message=finding.message
        )
    return found


def _detected(take: Take, rules: Mapping[str, Any] | None, also: Sequence[str], fix_swaps: bool, replace: str) -> Take:
    """Return the take that ``detect`` returns."""
    params = _of_kind(with_one_boundary(_enabled(rules, also)), "markers" if take.poses is None else "joints")
    if fix_swaps and "swap" in params:
        take = RULES["swap"].undo(Evidence(take), params.pop("swap"))
    # Within the rules every doubt counts, so that those that look after the others find what they leave.
    evidence, found = Evidence(take), list[Found]()
    for last in (False, True):
        given = _after(evidence, found) if last else evidence
        for name in params:
            if getattr(RULES[name], "AFTER_OTHERS", False) == last:
                with RULES.blamed(name):
                    found.append(Found(params[name], *_sound(RULES[name].examine(given, params[name]), take)))
    found = levelled(found, evidence, replace)
    findings = _united([finding for each in found for finding in each.findings])
    found_take = dataclasses.replace(take, findings=(*take.findings, *findings))
    if take.known is not None:
        return found_take.with_known(take.known & ~_named_channels(take, findings))
    return dataclasses.replace(found_take, trusted=_after(evidence, found).take.trusted)


def _sound(ruling: Ruling, take: Take) -> Ruling:
    """Return the result of a rule; raise ValueError unless it has samples of the take and findings."""
    doubted, told = ruling
    if not isinstance(doubted, np.ndarray) or (doubted.dtype, doubted.shape) != (np.dtype(bool), take.trusted.shape):
        raise ValueError(f"examine must return bool samples of the shape {take.trusted.shape}")
    if not all(isinstance(each, Finding) for each in told):
        raise ValueError("examine must return findings of the type Finding")
    return doubted, tuple(told)


def _of_kind(params: Mapping[str, Any], kind: str) -> dict[str, Any]:
    """Return the parameters of the rules that judge takes of this kind of columns."""
    return {name: own for name, own in params.items() if kind in getattr(RULES[name], "COLUMNS", ("markers",))}


def _named_channels(take: Take, findings: Sequence[Finding]) -> Bools:
    """Return the channels (F, C) that findings of rules distrust; a finding without channels concerns all of a joint.

    Gaps of the file are left out: their missing channels are unknown already, and the others of the joint are good.
    """
    owners, mask = take.owners, np.zeros_like(take.known)
    columns = {name: column for column, name in enumerate(take.markers)}
    for finding in findings:
        if finding.suspicion or finding.rule == "missing" or finding.marker not in columns or not finding.frames:
            continue
        channels = list(finding.channels) or np.flatnonzero(owners == columns[finding.marker])
        mask[slice(*finding.frames), channels] = True
    return mask


def _after(evidence: Evidence, found: Sequence[Found]) -> Evidence:
    """Return the evidence of the samples that no finding doubts."""
    trusted = evidence.take.trusted.copy()
    for each in found:
        trusted &= ~each.doubted
    return Evidence(dataclasses.replace(evidence.take, trusted=trusted))


def _enabled(rules: Mapping[str, Any] | None, also: Sequence[str]) -> dict[str, Any]:
    """Return the parameters of the rules that are enabled, in the order of ``RULES``, then those of other packages."""
    for name in (*(rules or ()), *also):
        if name not in RULES:
            known = ", ".join((*RULES, *RULES.installed()))
            raise UsageError(f"a trust rule must be one of {known}. Got {name!r}.")
    params = {name: module.Params() for name, module in RULES.items()} if rules is None else {**rules}
    params |= {name: RULES[name].Params() for name in also if name not in params}
    order = dict.fromkeys((*RULES, *params))
    return {name: params[name] for name in order if name in params and getattr(params[name], "enabled", True)}


def _united(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings in which those about the same span of a marker are one, that of the first rule.

    Findings that act come first, and a suspicion does not add its frames to them.
    """
    united: list[Finding] = []
    of_marker = defaultdict[str | None, list[int]](list)
    for finding in sorted(findings, key=lambda finding: finding.suspicion):
        for index in of_marker[finding.marker]:
            earlier = united[index]
            frames = _common_span(finding, earlier) if finding.rule != earlier.rule else None
            if frames:
                message = f"{earlier.message}; also found by {finding.rule}"
                frames = frames if finding.suspicion == earlier.suspicion else earlier.frames
                united[index] = dataclasses.replace(earlier, frames=frames, message=message)
                break
        else:
            of_marker[finding.marker].append(len(united))
            united.append(finding)
    return united


def _common_span(one: Finding, other: Finding) -> tuple[int, int] | None:
    """Return the span of both findings, if they concern one marker and share more than half of the longer one.

    A gap of the file is no doubt, and is united with none.
    """
    if one.marker is None or one.marker != other.marker or one.frames is None or other.frames is None:
        return None
    if "missing" in (one.rule, other.rule):
        return None
    (a, b), (c, d) = one.frames, other.frames
    shared = min(b, d) - max(a, c)
    return (min(a, c), max(b, d)) if 2 * shared > max(b - a, d - c) else None
