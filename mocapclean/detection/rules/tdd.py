"""Distrust samples that no plausible speed connects with the rest of their trajectory: trust data detection ("TDD-R").

Purpose and name: Feng et al. 2014, "Exploiting temporal stability and low-rank structure for motion capture data
refinement", Information Sciences 277, doi:10.1016/j.ins.2014.03.013; Wang et al. 2016 set its threshold to 6 cm. The
published decision rule was not available. This reconstruction has five steps:

0.  The motion of the whole body, the running sum of the median displacement of all markers, is subtracted.
1.  Each marker's trajectory is cut at missing samples, and where both ‖x_t - x_{t-1}‖ and ‖x_t - 2x_{t-1} + x_{t-2}‖
    exceed the threshold, forwards and backwards in time.
2.  The chain of segments with the largest total length is trusted. A segment can follow another if it begins within
    the threshold per frame of where that ends, or of the extrapolation from either at constant velocity. Two segments
    of more than a second each can always follow each other, because nothing shows which of them is at fault.
3.  A sample within the threshold of the smooth curve (PCHIP) through the chain is trusted again.
4.  Samples before or after the whole chain are not distrusted, however long it is: nothing returns from there, and a
    first pose is no fault. The leap from them to the chain is reported, and so is one between two long segments.

The threshold is a distance per frame at 120 Hz; steps 1 and 2 scale it by 120 / rate. The rule runs after the other
rules, on the samples that they trust: it cannot distinguish a fault from the samples before or after it.
"""

from typing import Annotated

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, duration, findings, leap
from mocapclean.detection.segments import SegmentEnds, best_chain, cut_segments
from mocapclean.numerics.robust import nan_median
from mocapclean.parameters import Field, parameters
from mocapclean.take import Finding

AFTER_OTHERS = True
_RATE = 120.0  # Hz, frame rate that the threshold is given for, as in Wang et al. 2016


@parameters
class Params(Switch):
    """The parameters of trust data detection."""

    distance: Annotated[float, Field(gt=0, description="φ, mm per frame at 120 Hz that no marker exceeds")] = 60.0
    longest: Annotated[float, Field(gt=0, description="seconds; two longer segments may lie a jump apart")] = 1.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """Return the samples (F, M) that no chain of plausible motion reaches, and their findings."""
    take = evidence.take
    threshold = params.distance * _RATE / take.rate
    judged = evidence.plausible & ~take.detached
    positions = np.where(judged[..., None], take.positions, np.nan)
    relative = positions - _body_motion(positions)[:, None]
    distrusted = np.zeros_like(take.trusted)
    cuts, leaps = _cuts(relative, judged, threshold), list[Finding]()
    for marker in np.flatnonzero(cuts.any(axis=0)).tolist():
        valid, path = judged[:, marker], relative[:, marker]
        segments = cut_segments(valid, cuts[:, marker])
        chain, unreachable = _chain(path, segments, threshold, params.longest * take.rate)
        distrusted[:, marker] = _between(chain) & valid & ~_readmitted(path, chain, valid, params.distance)
        for frames in (*unreachable, *_ends(chain, valid)):
            text = f"cannot at {threshold:.0f} mm per frame: nothing shows which side is right"
            leaps.append(leap("tdd", take, marker, frames, text, "look at these frames"))

    def message(marker: int, start: int, stop: int) -> str:
        return f"not reachable from the rest of its path at {threshold:.0f} mm per frame {duration(start, stop)}"

    advice = "look at these frames; raise trust.tdd.distance if the motion is real"
    return distrusted, (*findings("tdd", take, distrusted, message, advice), *leaps)


def _body_motion(positions: Floats) -> Floats:
    """Return the running sum (F, 3) of the median displacement over markers; robust to gaps and to faulty markers."""
    displacements = np.diff(positions, axis=0)
    motion = np.zeros((len(positions), 3))
    seen = np.isfinite(displacements[..., 0]).any(axis=1)
    if seen.any():
        motion[1:][seen] = nan_median(displacements[seen], axis=1)
    return np.cumsum(motion, axis=0)


def _cuts(positions: Floats, valid: Bools, threshold: float) -> Bools:
    """Return the frames (F, M) before which a trajectory is cut: displacement and second difference exceed the
    threshold.
    """
    if len(positions) < 2:
        return np.zeros_like(valid)
    backward = _forward_cuts(positions[::-1], valid[::-1], threshold)[::-1]
    cuts = _forward_cuts(positions, valid, threshold)
    cuts[1:] &= backward[:-1]
    return cuts


def _forward_cuts(positions: Floats, valid: Bools, threshold: float) -> Bools:
    """Return the displacements (F, M) beyond the threshold that the two frames before them do not predict."""
    jump = np.zeros_like(valid)
    jump[1:] = np.linalg.norm(np.diff(positions, axis=0), axis=2) > threshold
    unpredicted = np.ones_like(valid)
    if len(positions) > 2:
        second_difference = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=2)
        unpredicted[2:] = ~(second_difference <= threshold)
    # A run of jumps is cut from its first unpredicted one on: the frames before it predict none of those that follow.
    index = np.arange(len(valid))[:, None]
    last_calm = np.maximum.accumulate(np.where(jump, -1, index), axis=0)
    last_unpredicted = np.maximum.accumulate(np.where(jump & unpredicted, index, -1), axis=0)
    return jump & (last_unpredicted > last_calm)


def _chain(path: Floats, segments: Ints, threshold: float, longest: float) -> tuple[Bools, list[tuple[int, int]]]:
    """Return the frames (F,) of the longest chain of segments in which each can follow the one before.

    longest: in frames; two longer segments can always follow each other. Also the last frame before and the first after
    each link of such segments that the motion does not explain.
    """
    starts, stops = segments.T
    ends, long = SegmentEnds.of(path, segments), stops - starts > longest

    def reached(later: Ints, earlier: Ints) -> Bools:
        gap = starts[later] - (stops[earlier] - 1)
        return np.asarray((ends.misses(later, earlier, gap) <= threshold * gap).any(axis=0))

    def link_costs(later: Ints, earlier: Ints) -> Floats:
        return np.where(reached(later, earlier) | (long[later] & long[earlier]), 0.0, np.inf)

    chain = best_chain(segments, len(path), link_costs)[0]
    inside = np.flatnonzero(chain[starts])
    earlier, later = inside[:-1], inside[1:]
    leaps = ~reached(later, earlier)
    return chain, list(zip((stops[earlier[leaps]] - 1).tolist(), starts[later[leaps]].tolist(), strict=True))


def _between(chain: Bools) -> Bools:
    """Return the frames (F,) from the first to the last of a chain (F,)."""
    return np.asarray(np.logical_or.accumulate(chain) & np.logical_or.accumulate(chain[::-1])[::-1])


def _ends(chain: Bools, valid: Bools) -> list[tuple[int, int]]:
    """Return the frames before and after the leaps from valid samples (F,) to a chain (F,), at its ends."""
    first, last = np.flatnonzero(chain)[[0, -1]].tolist()
    before, after = np.flatnonzero(valid[:first]), np.flatnonzero(valid[last + 1 :])
    ends = [(int(before[-1]), first)] if before.size else []
    return ends + ([(last, last + 1 + int(after[0]))] if after.size else [])


def _readmitted(path: Floats, chain: Bools, valid: Bools, distance: float) -> Bools:
    """Return the chain (F,) and the valid frames between its ends within a distance of the curve through it."""
    frames = np.flatnonzero(chain)
    doubted = np.flatnonzero(valid & ~chain)
    doubted = doubted[(doubted > frames[0]) & (doubted < frames[-1])]
    trusted = chain.copy()
    if len(frames) > 1 and doubted.size:
        from scipy.interpolate import PchipInterpolator  # few takes need it, and it takes longer to import than to use

        curve = PchipInterpolator(frames, path[frames], axis=0)(doubted)
        trusted[doubted] = np.linalg.norm(path[doubted] - curve, axis=1) <= distance
    return trusted
