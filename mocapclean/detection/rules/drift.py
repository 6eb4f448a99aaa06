"""Drift: from some frame on a marker sits elsewhere in its segment, because it slid or was put back.

A step is added to the regression of the marker on those around it, at once or with up to half a second of sliding left
out, by generalised least squares: noise in one direction hides no step in another. It must be 15 mm and 10 standard
errors; 8 where it explains half of how the distances to the five closest partners change, most of which keep theirs to
10 mm, and 6 where it bends a bone or is a break. Most of what comes before and after it must agree with it, and the
path of the marker must not cost more without it. Below 20 standard errors a slide must also bend two bones, or explain
a fifth of the changed distances. Where bones hold the marker, one must bend, and if it is but one, no other of a
marker at its other end that may have stepped as well. What strays of a marker, or of those around it, makes a step
wait for the next round, unless it bends two bones to others; what strays only while a sure step is in the path is
kept. Of partners that step at the same time, as their bones allow, the one with the surest step is at fault. What
comes after the step is distrusted, for the first place is taken for the right one, unless less than 15 % of the
marker's frames come before it; so is the slide that leads to it, while the marker is 3 mm, and 3 times what is usual
for it, on its way.
"""

from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.detection.evidence import LEAST_SCORE, LEAST_STEP, SLIDE_SECONDS, Evidence, surely
from mocapclean.detection.rule import Ruling, Switch
from mocapclean.detection.steps import Step
from mocapclean.numerics.robust import nan_median
from mocapclean.parameters import STRICT
from mocapclean.take import Finding

_FIRST = 15
_SLID, _CALM = 3.0, 3.0


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    least: Annotated[float, Field(ge=LEAST_STEP, description="mm that it moved in its segment")] = LEAST_STEP
    surely: Annotated[
        float,
        Field(
            ge=LEAST_SCORE,
            description="1, that over its standard error; 0.8 of it if distances agree, 0.6 if a bone bends or a break",
        ),
    ] = LEAST_SCORE


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) after the steps."""
    take = evidence.take
    drifted, told = np.zeros_like(take.trusted), []
    for step in evidence.study.steps:
        size, seen = float(np.linalg.norm(step.offset)), take.trusted[:, step.marker]
        if size >= params.least and step.score >= surely(step, params.surely):
            early = 100 * np.count_nonzero(seen[: step.start]) < _FIRST * np.count_nonzero(seen)
            start, stop = (0, step.start) if early else (_begun(evidence, step), len(seen))
            drifted[start:stop, step.marker] = seen[start:stop]
            told.append(
                Finding(
                    rule="drift",
                    level="warning",
                    marker=take.markers[step.marker],
                    frames=(start, stop),
                    message=f"sits {size:.0f} mm ({step.score:.0f} standard errors) from its place in its segment "
                    f"{'up to here' if early else 'from here on'}",
                    advice="if this place is the right one, switch trust.drift off and distrust the others (--gaps)",
                )
            )
    return drifted, tuple(told)


def _begun(evidence: Evidence, step: Step) -> int:
    """The frame from which on a marker slides to where it sits after a step, at most half a second before it."""
    size = float(np.linalg.norm(step.offset))
    along = evidence.study.residual[:, step.marker] @ step.offset / size
    first = max(0, step.start - round(SLIDE_SECONDS * evidence.take.rate))
    usual = float(nan_median(np.abs(along[:first]))) if first else np.nan
    still = np.flatnonzero(~(along[first : step.start] > np.fmax(_SLID, _CALM * usual)))
    return first + int(still[-1]) + 1 if still.size else first
