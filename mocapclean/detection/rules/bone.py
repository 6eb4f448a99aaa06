"""Distrust a sample whose distances to most rigid partners, and position relative to its prediction, are far from
normal.

A partner is rigid if the robust SD of its distance is at most 4 mm. A distance is out of range if it is 20 mm from its
median and beyond its noise: an exponential tail through the median and the 95th percentile, exceeded once in a million.
At least two distances must be out of range, and more than half of those to partners in sight and on their own paths.
Then the marker is at fault, and not one of its partners. The marker must also lie 10 mm from its predicted position:
when a limb moves that was at rest for most of the take, distances change and the predicted positions follow.
"""

from typing import Annotated

import numpy as np

from mocapclean.detection.breaks import noise_tail
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, duration, findings
from mocapclean.numerics.robust import nan_median
from mocapclean.parameters import Field, parameters

_FEWEST_DISTANCES = 2  # distances out of range: a single one may be the partner's fault


@parameters
class Params(Switch):
    """The parameters of the rule."""

    rigid: Annotated[float, Field(gt=0, description="mm, largest robust SD of a rigid distance")] = 4.0
    least: Annotated[float, Field(gt=0, description="mm from the median distance")] = 20.0
    beside: Annotated[float, Field(ge=0, description="mm from the predicted position")] = 10.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) out of range of most of their rigid partners, and their findings."""
    take, rigid = evidence.take, evidence.rigid
    positions = np.where(evidence.plausible[..., None], take.positions, np.nan)
    beside = np.asarray(np.linalg.norm(evidence.analysis.residual, axis=2) > params.beside)
    broken = np.zeros_like(take.trusted)
    largest = np.zeros(take.trusted.shape)
    for marker in np.flatnonzero(evidence.analysis.predicted & beside.any(axis=0)).tolist():
        partners = [p for p in rigid.partners(marker)[0] if rigid.spread[marker, p] <= params.rigid]
        if len(partners) < _FEWEST_DISTANCES:
            continue
        distances = np.linalg.norm(positions[:, partners] - positions[:, [marker]], axis=2)
        error = np.abs(distances - nan_median(distances))
        # A partner that has left its own path says nothing about this marker.
        error[evidence.analysis.deviation[:, partners] > 0] = np.nan
        # Where too few distances are that far from their medians, the noise need not be known.
        if not ((error > params.least).sum(axis=1)[beside[:, marker]] >= _FEWEST_DISTANCES).any():
            continue
        n_out = (error > np.maximum(params.least, noise_tail(error)[1])).sum(axis=1)
        n_seen = np.isfinite(error).sum(axis=1)
        broken[:, marker] = (n_out >= _FEWEST_DISTANCES) & (2 * n_out > n_seen) & beside[:, marker]
        largest[:, marker] = np.nan_to_num(error).max(axis=1)

    def message(marker: int, start: int, stop: int) -> str:
        most = largest[start:stop, marker].max()
        return f"distances to rigid partners are up to {most:.0f} mm off {duration(start, stop)}"

    return broken, tuple(findings("bone", take, broken, message, "look at these frames; the marker may be mislabelled"))
