"""Report a take whose size or speed no human body has, as with a wrong unit; distrust samples over 100 km away.

Size: the median distance of a marker to the one a quarter of all markers away. It is 100 to 500 mm for a body, whatever
else is in sight; takes of fewer than ten markers have no size. Speed: the 99th percentile over all samples. Findings
about size and speed concern the whole take and distrust nothing. A sample more than 50 m from the median of all, in
a coordinate, is no measurement but a sentinel or a damaged number: captures reach 5 m. The distance is 30 times the
median one where that is more, as in a take whose unit is wrong. It is distrusted, and the other rules do not use it.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np

from mocapclean.arrays import evenly_spaced
from mocapclean.detection.evidence import FARTHEST, Evidence
from mocapclean.detection.rule import Level, Ruling, Switch, duration, findings
from mocapclean.numerics.robust import median, quantile
from mocapclean.parameters import Field, parameters
from mocapclean.take import Finding, Take

# Chosen by hand; no sweep was kept.
_FEWEST_MARKERS = 10  # markers that a size is measured with
_MOST_FRAMES = 60  # frames that it is measured in, evenly spaced
_BODY_SIZE = 300.0  # mm, typical size of a body: the message compares the take with it
_SPEED_SHARE = 0.99  # quantile of the speeds that is the speed of a take


@parameters
class Params(Switch):
    """The parameters of the rule."""

    replace: Annotated[Level, Field(description="whose findings distrust samples")] = "always"
    smallest: Annotated[float, Field(gt=0, description="mm, least size of a body")] = 70.0
    largest: Annotated[float, Field(gt=0, description="mm, largest size of a body")] = 1200.0
    fastest: Annotated[float, Field(gt=0, description="mm/s, largest speed")] = 30000.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples far from all others, and findings if the take is too small, too large or too fast."""
    take = replace(evidence.take, trusted=evidence.plausible)
    far = evidence.take.trusted & ~evidence.plausible
    texts = []
    size, speed = _size(take), _speed(take)
    if size is not None and not params.smallest <= size <= params.largest:
        texts.append(
            f"has a size of {size:.3g} mm where a body has {params.smallest:g} to {params.largest:g}, as if its unit "
            f"were {_BODY_SIZE / size:.2g} times as long"
        )
    if speed is not None and speed > params.fastest:
        texts.append(f"moves at {speed:.3g} mm/s where {params.fastest:g} is the limit")
    advice = "check the unit (--unit) and the rate (--rate), unless it is a face, a hand or a thing"
    of_take = [Finding(rule="units", level="error", message=f"the take {text}", advice=advice) for text in texts]

    def message(marker: int, start: int, stop: int) -> str:
        return f"more than {FARTHEST / 1e3:.0f} m from the other markers {duration(start, stop)}"

    return far, (*of_take, *findings("units", evidence.take, far, message, "look for what damaged the file"))


def _size(take: Take) -> float | None:
    """Return the size of the take, mm; None if it has too few markers or they all lie in one place."""
    n_frames, n_markers = take.trusted.shape
    if n_markers < _FEWEST_MARKERS:
        return None
    frames = evenly_spaced(n_frames, _MOST_FRAMES)
    known = np.where(take.trusted[frames, :, None], take.positions[frames], np.nan)
    # Distances of each marker, sorted with itself first: column M/4 is the marker a quarter of all markers away.
    distances = np.sort(np.linalg.norm(known[:, :, None] - known[:, None], axis=3), axis=2)[..., n_markers // 4]
    distances = distances[np.isfinite(distances)]
    return median(distances) if distances.size and median(distances) > 0 else None


def _speed(take: Take) -> float | None:
    """Return the speed of the take, mm/s; None if no marker is trusted in two consecutive frames."""
    both = take.trusted[1:] & take.trusted[:-1]
    steps = np.linalg.norm(np.diff(take.positions, axis=0), axis=2)[both]
    return quantile(steps, _SPEED_SHARE) * take.rate if steps.size else None
