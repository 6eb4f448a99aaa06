"""Bones: the distances of a marker to its rigid partners leave their range.

A partner is rigid when their distance keeps a robust SD of 4 mm. Where at least two of them, and more than half of
those in sight, are 20 mm from their median distance, and farther than an exponential tail through the median and the
95th percentile allows once in a million, the marker is distrusted, unless it is within 10 mm of where the markers
around it say: one that is itself at fault breaks with all its partners, one of its partners with it alone, and a limb
that was at rest for most of the take is where they say.
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.paths import tail
from mocapclean.detection.rule import Ruling, Switch, findings, lasting
from mocapclean.numerics.robust import nan_median
from mocapclean.parameters import STRICT


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    rigid: Annotated[float, Field(gt=0, description="mm, largest robust SD of a rigid distance")] = 4.0
    least: Annotated[float, Field(gt=0, description="mm from the median distance")] = 20.0
    beside: Annotated[float, Field(ge=0, description="mm from where the markers around it say")] = 10.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) that break with most of their rigid partners."""
    take, rigid = evidence.take, evidence.rigid
    known = np.where(take.trusted[..., None], take.positions, np.nan)
    residual = np.linalg.norm(evidence.study.residual, axis=2)
    broken = np.zeros_like(take.trusted)
    worst = np.zeros(take.trusted.shape)
    for marker in range(len(take.markers)):
        partners = [p for p in rigid.partners(marker)[0] if rigid.spread[marker, p] <= params.rigid]
        if len(partners) < 2:
            continue
        apart = np.linalg.norm(known[:, partners] - known[:, [marker]], axis=2)
        away = np.abs(apart - nan_median(apart))
        off = (away > np.maximum(params.least, tail(away)[1])).sum(axis=1)
        seen = np.isfinite(away).sum(axis=1)
        broken[:, marker] = (off >= 2) & (2 * off > seen) & (residual[:, marker] > params.beside)
        worst[:, marker] = np.nan_to_num(away).max(axis=1)

    def message(marker: int, start: int, stop: int) -> str:
        most = worst[start:stop, marker].max()
        return f"up to {most:.0f} mm from its distances to rigid partners {lasting(start, stop)}"

    return broken, tuple(findings("bone", take, broken, message, "look at these frames; the marker may be mislabelled"))
