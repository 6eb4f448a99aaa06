"""Outliers: the sparse part of a low-rank and smooth model of the whole take (``tsmc`` or ``trnn``).

It costs as much as filling by that method, and is off unless asked for.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, findings
from mocapclean.parameters import STRICT
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The parameters of the rule."""

    enabled: Annotated[bool, Field(description="whether the rule runs")] = False
    method: Annotated[Literal["tsmc", "trnn"], Field(description="whose sparse part counts")] = "tsmc"
    sparsity: Annotated[float, Field(gt=0, description="λ √max(F, 3M), 1, weight of the sparse part")] = 100.0
    least: Annotated[float, Field(gt=0, description="mm of a sample that are sparse")] = 10.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) whose sparse noise in the model is longer than ``least``."""
    take, method = evidence.take, params.method
    noise = run_method(method, take, SOLVERS[method].Params(denoise=True, sparsity=params.sparsity)).outliers
    size = np.zeros(take.trusted.shape) if noise is None else np.linalg.norm(noise, axis=2)
    outliers = np.asarray(take.trusted & (size > params.least))

    def message(marker: int, start: int, stop: int) -> str:
        return (
            f"{size[start:stop, marker].max():.0f} mm of it are sparse noise by {params.method}, {stop - start} frames"
        )

    return outliers, tuple(findings("outlier", take, outliers, message, "look at these frames"))
