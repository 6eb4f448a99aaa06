"""Levels: which findings distrust their samples, and which are suspicions that leave them trusted.

A wrong finding that acts makes a good sample worse. A suspicion makes none worse. A rule therefore acts by itself only
where the damage is small and the evidence lies on both sides of it: an excursion that the marker's own path encloses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from mocapclean.arrays import Bools, Ints
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.segments import SegmentEnds
from mocapclean.take import Finding, Take

REPLACE = ("sure", "suspicious", "missing")
"""The choices of ``detect``: what its rules may distrust."""

# Chosen by hand on one half of the takes of docs/trust.md.
_LEAST_RATE = 49.0  # Hz, 50 Hz less rounding: below it a limb may leave its path and return within three true frames
_SIDE_SECONDS = 0.1  # s, length of the path on each side that must be free of findings
_FEWEST_SIDE_FRAMES = 5  # the same in frames, at least
_EDGE_REACH = 1  # frames around each end of an excursion in one of which the path must break


@dataclass(frozen=True)
class Found:
    """What one rule found: its parameters, the samples (F, M) that it doubts, and its findings."""

    params: Any
    doubted: Bools
    findings: tuple[Finding, ...]


def levelled(found: Sequence[Found], evidence: Evidence, choice: str) -> list[Found]:
    """Return what the rules found, with the suspicions marked and without their samples.

    choice: "sure" follows the level ``replace`` of each rule; "suspicious" lets every finding act that names samples to
    distrust; "missing" lets none. Findings that name no samples, and those that a rule marks itself, stay as they are.
    """
    enclosure = Enclosure(evidence, found)
    return [_with_level(each, enclosure, choice) for each in found]


def _with_level(found: Found, enclosure: "Enclosure", choice: str) -> Found:
    """Return what a rule found, with its suspicions marked and without their samples."""
    level = getattr(found.params, "replace", "always")
    level = {"sure": level, "suspicious": "always", "missing": "never"}[choice]
    findings = []
    acting = np.zeros_like(found.doubted)
    for finding in found.findings:
        span = enclosure.span(finding)
        if span is None or not found.doubted[slice(*span[1:]), span[0]].any():
            findings.append(finding)
            continue
        acts = not finding.suspicion and (
            level == "always" or (level == "enclosed" and enclosure.holds(*span, found.params))
        )
        findings.append(replace(finding, suspicion=not acts))
        if acts:
            acting[slice(*span[1:]), span[0]] = True
    return Found(found.params, found.doubted & acting, tuple(findings))


class Enclosure:
    """The test whether the path of a marker encloses a finding, given all that the rules found."""

    def __init__(self, evidence: Evidence, found: Sequence[Found]) -> None:
        self.evidence, self.take = evidence, evidence.take
        self.columns = {name: column for column, name in enumerate(self.take.markers)}
        self.free = self.take.trusted.copy()
        for each in found:
            self.free &= ~each.doubted
        self.n_side = max(_FEWEST_SIDE_FRAMES, round(_SIDE_SECONDS * self.take.rate))

    def span(self, finding: Finding) -> tuple[int, int, int] | None:
        """Return the marker and the half-open span of a finding; None if it names none."""
        if finding.marker not in self.columns or finding.frames is None:
            return None
        return self.columns[finding.marker], *finding.frames

    def holds(self, marker: int, start: int, stop: int, params: Any) -> bool:
        """Whether samples ``start`` to ``stop`` of a marker are a short excursion, enclosed by its path.

        The rate is at least 50 Hz, and the excursion at most ``longest_replaced`` seconds long. A tenth of a second on
        both sides is measured and free of findings. The path breaks where the excursion begins and where it ends, and
        the side after it lies where the side before leads.
        """
        if self.take.rate < _LEAST_RATE or self.take.detached[marker]:
            return False
        if stop - start > getattr(params, "longest_replaced", np.inf) * self.take.rate:
            return False
        before, after = slice(max(0, start - self.n_side), start), slice(stop, stop + self.n_side)
        sides = [self.free[side, marker] for side in (before, after)]
        if any(len(side) < self.n_side or not side.all() for side in sides):
            return False
        return self._breaks_at(marker, start) and self._breaks_at(marker, stop) and self._returns(marker, start, stop)

    def _breaks_at(self, marker: int, frame: int) -> bool:
        """Whether the path of a marker breaks at a frame, or next to it."""
        near = slice(frame - _EDGE_REACH, frame + _EDGE_REACH + 1)
        return bool(self.evidence.analysis.breaks[near, marker].any())

    def _returns(self, marker: int, start: int, stop: int) -> bool:
        """Whether the path after an excursion lies within the threshold of where the path before it leads.

        By the residual, which is the marker's own path where nothing predicts it: kept, or extrapolated from either
        side.
        """
        residual = self.evidence.analysis.residual[:, marker]
        sides = np.array([[start - self.n_side, start], [stop, stop + self.n_side]])
        misses = SegmentEnds.of(residual, sides).misses(1, np.array([0]), np.array([stop - start + 1]))
        least = float(np.linalg.norm(misses, axis=2).min())
        return least <= float(self.evidence.analysis.threshold[[start, stop], marker].min())
