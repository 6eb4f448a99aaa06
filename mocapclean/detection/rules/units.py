"""Units: the size or the speed of the take cannot be a body's in the unit that is stated.

The size is the median distance of a marker to the one a quarter of all markers away, 100 to 500 mm for a body whatever
is in sight with it; the speed is the 99th percentile over all samples. These findings are about the whole take, and
distrust nothing. A sample more than 100 km from the others is no measurement in any unit, and is distrusted.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import evenly_spaced
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, findings, lasting
from mocapclean.parameters import STRICT
from mocapclean.take import Finding, Take

_FEWEST = 10
_SAMPLE = 60
_BODY = 300.0


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of the rule."""

    smallest: Annotated[float, Field(gt=0, description="mm, least size of a body")] = 70.0
    largest: Annotated[float, Field(gt=0, description="mm, largest size of a body")] = 1200.0
    fastest: Annotated[float, Field(gt=0, description="mm/s, largest speed")] = 30000.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples far from all others, and a finding when the take is too small, too large or too fast for a body."""
    take = replace(evidence.take, trusted=evidence.near)
    far = evidence.take.trusted & ~evidence.near
    told = []
    size, speed = _size(take), _speed(take)
    if size is not None and not params.smallest <= size <= params.largest:
        told.append(
            f"is of size {size:.3g} mm where a body has {params.smallest:g} to {params.largest:g}, as if its unit "
            f"were {_BODY / size:.2g} times as long"
        )
    if speed is not None and speed > params.fastest:
        told.append(f"moves at {speed:.3g} mm/s where {params.fastest:g} is the limit")
    advice = "check the unit (--unit) and the rate (--rate), unless it is a face, a hand or a thing"
    of_take = [Finding(rule="units", level="error", message=f"the take {text}", advice=advice) for text in told]

    def message(marker: int, start: int, stop: int) -> str:
        return f"more than 100 km from the other markers {lasting(start, stop)}"

    return far, (*of_take, *findings("units", evidence.take, far, message, "look for what damaged the file"))


def _size(take: Take) -> float | None:
    n_frames, n_markers = take.trusted.shape
    if n_markers < _FEWEST:
        return None
    frames = evenly_spaced(n_frames, _SAMPLE)
    known = np.where(take.trusted[frames, :, None], take.positions[frames], np.nan)
    apart = np.sort(np.linalg.norm(known[:, :, None] - known[:, None], axis=3), axis=2)[..., n_markers // 4]
    apart = apart[np.isfinite(apart)]
    return float(np.median(apart)) if apart.size and np.median(apart) > 0 else None


def _speed(take: Take) -> float | None:
    both = take.trusted[1:] & take.trusted[:-1]
    steps = np.linalg.norm(np.diff(take.positions, axis=0), axis=2)[both]
    return float(np.quantile(steps, 0.99) * take.rate) if steps.size else None
