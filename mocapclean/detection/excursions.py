"""Shared code of the rules spike and jump: runs of samples off the path, called excursions, split by length."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mocapclean.arrays import column_runs
from mocapclean.detection.breaks import LEAST_BREAK
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, duration, findings
from mocapclean.parameters import but

LEAST_EXCURSION = LEAST_BREAK  # mm off the path: no threshold is lower, so that a lower limit would change nothing
LONGEST_SPIKE = 3  # frames, chosen by hand
SHORTEST_JUMP = LONGEST_SPIKE + 1  # frames


def examine_excursions(
    rule: str, evidence: Evidence, least: float, advice: str, *, shortest: int = 1, longest: float = np.inf
) -> Ruling:
    """Return the ruling of ``rule`` about excursions of ``shortest`` to ``longest`` frames.

    They lie at least ``least`` mm off the path in one frame. Bursts of noise are left to the rule ``flicker``.
    """
    deviation, threshold = evidence.analysis.deviation, evidence.analysis.threshold
    distrusted = np.zeros_like(evidence.take.trusted)
    for marker, start, stop in column_runs((deviation > 0) & ~evidence.analysis.bursts):
        if shortest <= stop - start <= longest and deviation[start:stop, marker].max() >= least:
            distrusted[start:stop, marker] = True

    def message(marker: int, start: int, stop: int) -> str:
        distance = deviation[start:stop, marker]
        times = float((distance / threshold[start:stop, marker]).max())
        return f"up to {distance.max():.0f} mm off its path {duration(start, stop)}, {times:.1f} times the threshold"

    return distrusted, tuple(findings(rule, evidence.take, distrusted, message, advice))


def first_jump(longest_spike: int, shortest_jump: int) -> int:
    """Return the least length of a jump, in frames; a shorter excursion is a spike.

    The parameters of the two rules may leave lengths between them, or overlap. The one changed from its default then
    sets the boundary; the longest spike, if both are.
    """
    return shortest_jump if longest_spike == LONGEST_SPIKE else longest_spike + 1


def with_one_boundary(params: Mapping[str, Any]) -> dict[str, Any]:
    """Return the rules' parameters, adjusted so that each length of an excursion belongs to exactly one of ``spike``
    and ``jump``.

    If only one of them runs, it keeps its range. ``spike`` is left out where every excursion is a jump.
    """
    shared = dict(params)
    if "spike" not in shared or "jump" not in shared:
        return shared
    boundary = first_jump(shared["spike"].longest, shared["jump"].shortest)
    shared["jump"] = but(shared["jump"], shortest=boundary)
    if boundary > 1:
        shared["spike"] = but(shared["spike"], longest=boundary - 1)
    else:
        del shared["spike"]
    return shared
