"""Prediction: a marker is not where the markers around it say, far beyond what is usual for it.

The residual of the regression in its segment's frame exceeds 30 mm; an exponential tail through its own median and 95th
percentile, where that is exceeded once in a million; and twice the residuals of its five closest partners, for a whole
limb is where it was never seen before when it moves as never before. Unlike ``jump`` the rule needs no sharp edge.
Where less than half of what is said of a marker is said by partners in sight, the rule says nothing.
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.paths import tail
from mocapclean.detection.rule import Ruling, Switch, findings, lasting
from mocapclean.parameters import STRICT

_CLOSEST, _ALONE, _IN_SIGHT = 5, 2.0, 0.5


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    least: Annotated[float, Field(gt=0, description="mm from where it is expected")] = 30.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) that are far from where they are expected."""
    study = evidence.study
    away = np.linalg.norm(study.residual, axis=2)
    limit = np.maximum(params.least, tail(away)[1])
    far = np.asarray(study.known & (away > limit))
    for marker in np.flatnonzero(far.any(axis=0)).tolist():
        partners, weights = evidence.rigid.partners(marker)
        far[:, marker] &= evidence.near[:, partners] @ weights >= _IN_SIGHT * weights.sum()
        closest = away[:, partners[:_CLOSEST]]
        far[:, marker] &= away[:, marker] > _ALONE * np.nan_to_num(closest).max(axis=1, initial=0.0)

    def message(marker: int, start: int, stop: int) -> str:
        most = np.nanmax(away[start:stop, marker])
        return f"up to {most:.0f} mm from where the markers around it say, {lasting(start, stop)}"

    return far, tuple(findings("predict", evidence.take, far, message, "look at these frames"))
