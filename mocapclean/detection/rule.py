"""The parts that all rules share: their switch, and one finding for each run of samples that they distrust."""

from collections.abc import Callable, Iterator
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, column_runs
from mocapclean.parameters import STRICT
from mocapclean.take import Finding, Take

Ruling = tuple[Bools, tuple[Finding, ...]]
"""The result of a rule: the samples (F, M) that it distrusts, and its findings."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Switch:
    """The parameter of every rule that can be switched off."""

    enabled: Annotated[bool, Field(description="whether the rule runs")] = True


def duration(start: int, stop: int) -> str:
    """Return the length of a half-open span of frames in words, such as "for 4 frames"."""
    return f"for {stop - start} frame{'' if stop - start == 1 else 's'}"


def findings(
    rule: str, take: Take, distrusted: Bools, message: Callable[[int, int, int], str], advice: str
) -> Iterator[Finding]:
    """Yield a finding for each run of distrusted samples (F, M).

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
