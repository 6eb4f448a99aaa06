"""Samples that the file itself calls missing: each gap becomes a finding; no trust is lowered."""

import numpy as np
from pydantic.dataclasses import dataclass

from mocapclean.parameters import STRICT
from mocapclean.records import Bools, Finding, Take
from mocapclean.runs import column_runs


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params:
    """This rule has no parameters."""


def examine(take: Take, params: Params) -> tuple[Bools, tuple[Finding, ...]]:
    """Name every run of samples (F, M) that reading found untrusted."""
    findings = tuple(
        Finding(
            rule="missing",
            marker=take.markers[marker],
            frames=(start, stop),
            message=f"missing in the file for {stop - start} frames",
        )
        for marker, start, stop in column_runs(~take.trusted)
    )
    return np.zeros_like(take.trusted), findings
