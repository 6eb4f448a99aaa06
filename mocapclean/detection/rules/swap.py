"""Swaps: two markers bear each other's name for a time.

The path of each goes on in the other, at a third of the error, at the first frame and after the last one; exchanged
back, both are nearer to their distances from rigid partners (``detection/exchanges.py``). With ``fix_swaps`` the
names are exchanged back, every number as it is in the file, and the samples count as moved; otherwise they are
distrusted.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import runs
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.exchanges import Exchange, exchange
from mocapclean.detection.rule import Ruling, Switch, lasting
from mocapclean.parameters import STRICT
from mocapclean.take import Finding, Take


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    shortest: Annotated[int, Field(ge=1, description="frames")] = 1


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) of both markers of each swap."""
    swapped = np.zeros_like(evidence.take.trusted)
    told: list[Finding] = []
    for found in _long(evidence, params):
        swapped[found.frames, found.first] = swapped[found.frames, found.second] = True
        told += _findings(evidence.take, found, "exchange the two labels (--fix-swaps)")
    return swapped, tuple(told)


def put_back(evidence: Evidence, params: Params) -> Take:
    """The take with the names of swapped markers exchanged back; these samples stay trusted and count as moved."""
    take, found = evidence.take, tuple(_long(evidence, params))
    moved, told = take.moved.copy(), []
    for one in found:
        moved[one.frames, one.first] = moved[one.frames, one.second] = True
        told += _findings(take, one, "exchanged back, as asked")
    return replace(take, positions=exchange(take.positions, found), moved=moved, findings=(*take.findings, *told))


def _long(evidence: Evidence, params: Params) -> list[Exchange]:
    return [found for found in evidence.exchanges if found.frames.sum() >= params.shortest]


def _findings(take: Take, found: Exchange, advice: str) -> list[Finding]:
    names = take.markers[found.first], take.markers[found.second]
    return [
        Finding(
            rule="swap",
            level="warning",
            marker=name,
            frames=(int(start), int(stop)),
            message=f"bears the name of {other} {lasting(start, stop)}: distances to rigid partners are "
            f"{found.before:.1f} robust SDs off, exchanged {found.after:.1f}",
            advice=advice,
        )
        for start, stop in runs(found.frames)
        for name, other in (names, names[::-1])
    ]
