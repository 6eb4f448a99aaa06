"""Distrust a sample far from its predicted position, relative to the marker's own noise and its partners' residuals.

The predicted position is a regression on the marker's partners. The residual must exceed three limits: 30 mm; the
marker's own noise (an exponential tail through the median and the 95th percentile, exceeded once in a million); twice
the residuals of its five closest partners. The third limit protects a limb that moves as never before in the take: all
of its markers are then far from their predicted positions. Unlike ``jump``, the rule needs no break. A frame in which
partners with less than half of the weight are in sight and on their own paths is not judged.
"""

from typing import Annotated

import numpy as np

from mocapclean.detection.breaks import noise_tail
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, duration, findings
from mocapclean.parameters import Field, parameters

# Chosen by hand on the takes of `bench trust`, seeds 0 to 4 (docs/results.md); no sweep was kept.
_CLOSEST_PARTNERS = 5  # partners whose residuals a limb is recognised by
_RESIDUAL_RATIO = 2.0  # times the largest of their residuals
_LEAST_WEIGHT = 0.5  # share of the weight of all partners that must be in sight and on their paths


@parameters
class Params(Switch):
    """The parameters of the rule."""

    least: Annotated[float, Field(gt=0, description="mm from the predicted position")] = 30.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) far from their predicted positions, and their findings."""
    analysis = evidence.analysis
    distance = np.linalg.norm(analysis.residual, axis=2)
    far = np.asarray(analysis.predicted & (distance > params.least))
    some = far.any(axis=0)
    far[:, some] &= distance[:, some] > noise_tail(distance[:, some])[1]
    reliable = evidence.plausible & (analysis.deviation == 0)
    for marker in np.flatnonzero(far.any(axis=0)).tolist():
        partners, weights = evidence.rigid.partners(marker)
        far[:, marker] &= reliable[:, partners] @ weights >= _LEAST_WEIGHT * weights.sum()
        closest = distance[:, partners[:_CLOSEST_PARTNERS]]
        far[:, marker] &= distance[:, marker] > _RESIDUAL_RATIO * np.nan_to_num(closest).max(axis=1, initial=0.0)

    def message(marker: int, start: int, stop: int) -> str:
        largest = np.nanmax(distance[start:stop, marker])
        return f"up to {largest:.0f} mm from its predicted position {duration(start, stop)}"

    return far, tuple(findings("predict", evidence.take, far, message, "look at these frames"))
