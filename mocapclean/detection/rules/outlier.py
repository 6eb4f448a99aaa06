"""Distrust samples with a large sparse error in a low-rank and smooth model of the take (``tsmc`` or ``trnn``).

The model explains a sample by the rest of the take, less a sparse error; a large error is distrusted. The rule costs as
much as a fill by that method, and is off by default. It runs after the other rules, on the samples that they trust.
"""

from typing import Annotated, Literal

import numpy as np

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Level, Ruling, Switch, duration, findings
from mocapclean.parameters import Field, parameters
from mocapclean.solvers import SOLVERS

AFTER_OTHERS = True


@parameters
class Params(Switch):
    """The parameters of the rule."""

    replace: Annotated[Level, Field(description="whose findings distrust samples")] = "always"
    enabled: Annotated[bool, Field(description="whether the rule runs")] = False
    method: Annotated[Literal["tsmc", "trnn"], Field(description="method whose sparse part counts")] = "tsmc"
    sparsity: Annotated[float, Field(gt=0, description="λ √max(F, 3M), 1, weight of the sparse part")] = 100.0
    least: Annotated[float, Field(gt=0, description="mm, sparse part of a sample")] = 10.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) whose sparse part exceeds ``least``, and their findings."""
    take, method = evidence.take, params.method
    from mocapclean.solvers.running import run_method  # the rule is off by default, and its defaults need no method

    noise = run_method(method, take, SOLVERS[method].Params(denoise=True, sparsity=params.sparsity)).outliers
    size = np.zeros(take.trusted.shape) if noise is None else np.linalg.norm(noise, axis=2)
    outliers = np.asarray(take.trusted & (size > params.least))

    def message(marker: int, start: int, stop: int) -> str:
        largest = size[start:stop, marker].max()
        return f"up to {largest:.0f} mm of sparse noise by {params.method} {duration(start, stop)}"

    return outliers, tuple(findings("outlier", take, outliers, message, "look at these frames"))
