"""Levels: which findings distrust their samples, and which are suspicions that leave them trusted.

A wrong finding that acts makes a good sample worse. A suspicion makes none worse. A rule therefore acts by itself only
where the damage is small and the evidence lies on both sides of it: an excursion that the marker's own path encloses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mocapclean.arrays import Bools, Floats
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.segments import SegmentEnds
from mocapclean.take import Finding

REPLACE = ("sure", "suspicious", "missing")
"""The choices of ``detect``: what its rules may distrust."""

# Chosen by hand by looking at the natural findings of all captures; no half was kept apart.
_LEAST_RATE = 49.0  # Hz, 50 Hz less rounding: below it a limb may leave its path and return within three true frames
_SIDE_SECONDS = 0.1  # s, length of the path on each side that must be free of findings
_FEWEST_SIDE_FRAMES = 8  # the same in frames, at least
_SIDE_LENGTHS = 4  # the same in lengths of the excursion, at least
_STANDS_OUT = 5.0  # times the largest error of a cubic over the sides: natural findings from 5 on look like faults


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

    def span(self, finding: Finding) -> tuple[int, int, int] | None:
        """Return the marker and the half-open span of a finding; None if it names none."""
        if finding.marker not in self.columns or finding.frames is None:
            return None
        return self.columns[finding.marker], *finding.frames

    def holds(self, marker: int, start: int, stop: int, params: Any) -> bool:
        """Whether samples ``start`` to ``stop`` of a marker are a short excursion, enclosed by its path.

        The rate is at least 50 Hz, and the excursion at most ``longest_replaced`` seconds long. A tenth of a second on
        both sides, or four lengths of the excursion, is measured and free of findings. The path breaks where the
        excursion begins and where it ends, the side after it lies where the side before leads, and the excursion stands
        out from both.
        """
        if self.take.rate < _LEAST_RATE or self.take.detached[marker]:
            return False
        if stop - start > getattr(params, "longest_replaced", np.inf) * self.take.rate:
            return False
        seconds, lengths = _SIDE_SECONDS * self.take.rate, _SIDE_LENGTHS * (stop - start)
        n_side = max(_FEWEST_SIDE_FRAMES, round(seconds), lengths)
        sides = [self.free[side, marker] for side in (slice(max(0, start - n_side), start), slice(stop, stop + n_side))]
        if any(len(side) < n_side or not side.all() for side in sides):
            return False
        breaks = self.evidence.analysis.breaks[:, marker]
        if not (breaks[start - 1 : start + 1].any() and breaks[stop : stop + 2].any()):
            return False
        return self._returns(marker, start, stop) and self._stands_out(marker, start, stop, n_side)

    def _returns(self, marker: int, start: int, stop: int) -> bool:
        """Whether the path after an excursion lies within the threshold of where the path before it leads.

        A residual is kept, or extrapolated from one of the sides. A marker that nothing predicts must be where both
        sides lead: a ball returns from the floor to its height, and was there.
        """
        analysis = self.evidence.analysis
        ends = SegmentEnds.of(analysis.residual[:, marker], np.array([[start - 2, start], [stop, stop + 2]]))
        misses = ends.misses(np.array([1]), np.array([0]), np.array([stop - start + 1]))[:, 0]
        miss = misses.min() if analysis.predicted[marker] else misses[1:].max()
        return bool(miss <= analysis.threshold[[start, stop], marker].min())

    def _stands_out(self, marker: int, start: int, stop: int, n_side: int) -> bool:
        """Whether an excursion is far off the marker's own path in the world, by the errors of cubics.

        A cubic through two frames before and two after a span predicts it. Its error over the excursion must be five
        times the largest one over spans of the same length within ``n_side`` frames on either side.
        """
        path, length = self.take.positions[start - n_side : stop + n_side, marker], stop - start
        errors = _cubic_errors(path, length)
        reach = 1 + max(1, length // 2)
        # Spans whose cubic and frames lie on one side: the first of them begins ``reach`` frames into the path.
        n_clear = n_side - 2 * reach - length + 1
        beside = np.concatenate([errors[:n_clear], errors[len(errors) - n_clear :]])
        return bool(errors[n_side - reach] > _STANDS_OUT * beside.max())


def _cubic_errors(path: Floats, length: int) -> Floats:
    """Return the largest error of a cubic over each span of ``length`` frames of a path (F, 3), mm.

    The cubic goes through the frame next to the span on each side, and one that is half a length farther. Spans begin
    at the first frame that has these frames before it, and so on, frame by frame.
    """
    half = max(1, length // 2)
    nodes, inside = np.array([-1 - half, -1, length, length + half]), np.arange(length)
    others = [np.delete(nodes, k) for k in range(4)]
    # Lagrange: x(t) = Σ x(tₖ) Π (t - tⱼ) / (tₖ - tⱼ) over j ≠ k.
    weights = [
        ((inside[:, None] - rest) / (node - rest)).prod(axis=1) for node, rest in zip(nodes, others, strict=True)
    ]
    starts = np.arange(1 + half, len(path) - length - half)
    predicted = np.einsum("kl,skc->slc", np.stack(weights), path[starts[:, None] + nodes])
    errors = np.linalg.norm(path[starts[:, None] + inside] - predicted, axis=2)
    return np.asarray(errors.max(axis=1))
