"""Distrust a marker from the frame at which it shifted, at once or within half a second, to another place on its
segment.

The evidence is a step in the regression of the marker on its partners, made at once or by a slide of up to half a
second. It is fitted by generalised least squares: noise in one direction hides no step in another.

Size: at least 15 mm, and a score of 10 standard errors. A score of 8 is enough if the step explains half of the changes
in the distances to the five closest partners, and the median of their robust SDs is at most 10 mm. A score of 6 is
enough if a rigid pair changes its distance, or the step is a break.

Support: the samples before the step, and those after it, keep a mean weight of 0.4 in the robust fit. The path of the
marker costs no more without the step. A slide with a score below 20 needs two rigid pairs that change, or must explain
a fifth of the changes in the distances.

Rigid pairs: if the marker has any, at least one must change. If only one does, and the other marker may have stepped
too, that marker must have no other pair that changes. Outliers of the marker, or of its partners, may look like a step:
it is judged once they are removed, unless two rigid pairs with other markers change.

Attribution: of partners that step at the same time, the marker with the highest score is at fault, unless its step
vanishes when the step of another is removed.

Samples: those after the step, because the first place is taken to be right; those before it, if they are less than 15 %
of the marker's. The slide is distrusted where the marker has moved 3 mm, and 3 times its median residual, along it.
"""

from typing import Annotated

import numpy as np

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch
from mocapclean.detection.steps import LEAST_SCORE, LEAST_STEP, SLIDE_SECONDS, Step, least_score
from mocapclean.numerics.robust import nan_median
from mocapclean.parameters import Field, parameters
from mocapclean.take import Finding

# Chosen by hand on the takes of `bench trust`, seeds 0 to 4 (docs/results.md); no sweep was kept.
_SHORT_BEGINNING = 15  # % of a marker's samples: if fewer come before a step, they are distrusted
_SLIDE_DISTANCE = 3.0  # mm along a step that a marker must have moved to be part of the slide
_SLIDE_RESIDUALS = 3.0  # median residuals along the step, likewise


@parameters
class Params(Switch):
    """The parameters of the rule."""

    least: Annotated[float, Field(ge=LEAST_STEP, description="mm, size of the step")] = LEAST_STEP
    surely: Annotated[
        float,
        Field(
            ge=LEAST_SCORE,
            description="1, standard errors; 0.8 of it if distances agree, 0.6 if a rigid pair changes or it breaks",
        ),
    ] = LEAST_SCORE


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) after each step, or before it if few samples come before, and their findings."""
    take = evidence.take
    drifted, findings = np.zeros_like(take.trusted), []
    for step in evidence.analysis.steps:
        size, trusted = float(np.linalg.norm(step.offset)), take.trusted[:, step.marker]
        if size < params.least or step.score < least_score(step, params.surely):
            continue
        early = 100 * np.count_nonzero(trusted[: step.start]) < _SHORT_BEGINNING * np.count_nonzero(trusted)
        start, stop = (0, step.start) if early else (_slide_start(evidence, step), len(trusted))
        drifted[start:stop, step.marker] = trusted[start:stop]
        findings.append(
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
    return drifted, tuple(findings)


def _slide_start(evidence: Evidence, step: Step) -> int:
    """Return the frame at which the slide to a step begins, at most half a second before the step."""
    size = float(np.linalg.norm(step.offset))
    along = evidence.analysis.residual[:, step.marker] @ step.offset / size
    first = max(0, step.start - round(SLIDE_SECONDS * evidence.take.rate))
    median = float(nan_median(np.abs(along[:first]))) if first else np.nan
    still = np.flatnonzero(~(along[first : step.start] > np.fmax(_SLIDE_DISTANCE, _SLIDE_RESIDUALS * median)))
    return first + int(still[-1]) + 1 if still.size else first
