"""What all rules share."""

from collections.abc import Callable, Iterator
from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from mocapclean.arrays import Bools, column_runs
from mocapclean.parameters import STRICT
from mocapclean.take import Finding, Take

Ruling = tuple[Bools, tuple[Finding, ...]]
"""The samples (F, M) that a rule distrusts, and what it says of them."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Switch:
    """A rule that can be switched off by name."""

    enabled: Annotated[bool, Field(description="whether the rule runs")] = True


def lasting(start: int, stop: int) -> str:
    """How long a half-open span lasts, in words."""
    return f"for {stop - start} frame{'' if stop - start == 1 else 's'}"


def findings(
    rule: str, take: Take, distrusted: Bools, message: Callable[[int, int, int], str], advice: str
) -> Iterator[Finding]:
    """A finding for each run of distrusted samples (F, M); message: of a column and its half-open span."""
    for marker, start, stop in column_runs(distrusted):
        yield Finding(
            rule=rule,
            level="warning",
            marker=take.markers[marker],
            frames=(start, stop),
            message=message(marker, start, stop),
            advice=advice,
        )
