"""Distrust two markers whose labels are exchanged for a time.

Where the labels change, the path of each marker continues in the other with a third of the error. Exchanged back, both
are nearer to their normal distances from rigid partners (``mocapclean.detection.exchanges``). With ``fix_swaps`` the
labels are exchanged back instead: every number stays as it is in the file, and the samples count as moved.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np

from mocapclean.arrays import runs
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.exchanges import Exchange, exchange
from mocapclean.detection.rule import Ruling, Switch, duration
from mocapclean.parameters import Field, parameters
from mocapclean.take import Exchanged, Finding, Take


@parameters
class Params(Switch):
    """The parameters of the rule."""

    shortest: Annotated[int, Field(ge=1, description="frames")] = 1


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) of both markers of each swap, and their findings."""
    swapped = np.zeros_like(evidence.take.trusted)
    findings: list[Finding] = []
    for swap in _swaps(evidence, params):
        swapped[swap.frames, swap.first] = swapped[swap.frames, swap.second] = True
        findings += _findings(evidence.take, swap, "exchange the two labels (--fix-swaps)")
    return swapped, tuple(findings)


def undo(evidence: Evidence, params: Params) -> Take:
    """Return the take with swapped labels corrected; these samples stay trusted and are marked as moved at the user's
    request.
    """
    take, swaps = evidence.take, tuple(_swaps(evidence, params))
    moved, findings, exchanged = take.moved.copy(), list[Finding](), list(take.exchanged)
    for swap in swaps:
        moved[swap.frames, swap.first] = moved[swap.frames, swap.second] = True
        findings += _findings(take, swap, "exchanged back, as asked")
        pair = take.markers[swap.first], take.markers[swap.second]
        exchanged += [Exchanged(*pair, int(start), int(stop)) for start, stop in runs(swap.frames)]
    positions = exchange(take.positions, swaps)
    findings = [*take.findings, *findings]
    return replace(take, positions=positions, moved=moved, exchanged=tuple(exchanged), findings=tuple(findings))


def _swaps(evidence: Evidence, params: Params) -> list[Exchange]:
    """Return the exchanges that last long enough."""
    return [swap for swap in evidence.exchanges if swap.frames.sum() >= params.shortest]


def _findings(take: Take, swap: Exchange, advice: str) -> list[Finding]:
    """Return a finding for each marker and each run of exchanged frames."""
    names = take.markers[swap.first], take.markers[swap.second]
    return [
        Finding(
            rule="swap",
            level="warning",
            marker=name,
            frames=(int(start), int(stop)),
            message=f"carries the label of {other} {duration(start, stop)}: distances to rigid partners are "
            f"{swap.before:.1f} robust SDs off, exchanged back {swap.after:.1f}",
            advice=advice,
        )
        for start, stop in runs(swap.frames)
        for name, other in (names, names[::-1])
    ]
