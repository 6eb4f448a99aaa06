"""Report the samples that the file itself marks as missing, one finding for each gap; no trust is lowered."""

import numpy as np

from mocapclean.arrays import column_runs
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, duration
from mocapclean.parameters import parameters
from mocapclean.take import Finding

COLUMNS = ("markers", "joints")


@parameters
class Params:
    """This rule has no parameters."""


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return no samples, and a finding for every run of samples that were untrusted when read."""
    take = evidence.take
    findings = tuple(
        Finding(
            rule="missing",
            marker=take.markers[marker],
            frames=(start, stop),
            message=f"missing in the file {duration(start, stop)}",
        )
        for marker, start, stop in column_runs(~take.trusted)
    )
    return np.zeros_like(take.trusted), findings
