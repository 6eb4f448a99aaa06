"""The parts that all rules share: their switch and level, and one finding for each run of samples that they doubt."""

from collections.abc import Callable, Iterator
from typing import Annotated, Literal

import numpy as np

from mocapclean.arrays import Bools, column_runs
from mocapclean.detection.evidence import Evidence
from mocapclean.parameters import Field, parameters
from mocapclean.take import Finding, Take

LONGEST_REPLACED = 0.25  # s, longest excursion that is distrusted where the path encloses it

Ruling = tuple[Bools, tuple[Finding, ...]]
"""The result of a rule: the samples (F, M) that it doubts, and its findings."""

Level = Literal["always", "enclosed", "never"]
"""Which findings of a rule distrust their samples; the others are suspicions."""


@parameters
class Switch:
    """The parameters of every rule that can be switched off."""

    enabled: Annotated[bool, Field(description="whether the rule runs")] = True
    replace: Annotated[
        Level, Field(description="whose findings distrust samples: all, those that the path encloses, or none")
    ] = "never"


@parameters
class JointSwitch(Switch):
    """The parameters of a rule for joints whose sure findings act."""

    replace: Annotated[Level, Field(description="whose sure findings distrust samples")] = "always"


def duration(start: int, stop: int) -> str:
    """Return the length of a half-open span of frames in words, such as "for 4 frames"."""
    return f"for {stop - start} frame{'' if stop - start == 1 else 's'}"


def findings(
    rule: str, take: Take, distrusted: Bools, message: Callable[[int, int, int], str], advice: str
) -> Iterator[Finding]:
    """Yield a finding for each run of doubted samples (F, M).

    ``message`` takes the column of the marker and the half-open span of frames.
    """
    for marker, start, stop in column_runs(distrusted):
        yield Finding(
            rule=rule,
            level="warning",
            marker=take.markers[marker],
            frames=(start, stop),
            message=message(marker, start, stop),
            advice=advice,
        )


def joint_findings(rule: str, evidence: Evidence, advice: str) -> Ruling:
    """Return the joints (F, J) whose channels a rule distrusts, and its findings: those faults of its kind.

    A fault of which the evidence is not sure is a suspicion.
    """
    take, doubted, found = evidence.take, np.zeros_like(evidence.take.trusted), []
    assert take.skeleton is not None
    for fault in evidence.joint_faults:
        if fault.kind != rule:
            continue
        doubted[fault.start : fault.stop, fault.joint] = True
        channels = [
            index
            for index, channel in enumerate(take.skeleton.channels)
            if channel.joint == fault.joint and channel.is_rotation == (fault.part == "rotation")
        ]
        found.append(
            Finding(
                rule=rule,
                level="warning",
                marker=take.markers[fault.joint],
                frames=(fault.start, fault.stop),
                message=fault.message,
                advice=advice,
                suspicion=not fault.is_sure,
                channels=tuple(channels),
            )
        )
    return doubted, tuple(found)


def leap(rule: str, take: Take, marker: int, frames: tuple[int, int], message: str, advice: str) -> Finding:
    """Return a suspicion about a step of a marker between two frames, of which neither side is known to be wrong."""
    before, after = frames
    size = float(np.linalg.norm(take.positions[after, marker] - take.positions[before, marker]))
    time = "one frame" if after - before == 1 else f"{after - before} frames"
    return Finding(
        rule=rule,
        level="warning",
        marker=take.markers[marker],
        frames=(before, after + 1),
        message=f"moves {size:.0f} mm within {time} and {message}",
        advice=advice,
        suspicion=True,
    )
