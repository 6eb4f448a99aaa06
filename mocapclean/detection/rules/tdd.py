"""Trust data detection: what moves farther than a body can is not trusted.

Purpose and name: Feng et al. 2014, "Exploiting temporal stability and low-rank structure for motion capture data
refinement", Information Sciences 277, doi:10.1016/j.ins.2014.03.013; Wang et al. 2016 set its threshold to 6 cm. The
published decision rule was not available, so this is a reconstruction ("TDD-R"), and this is what it does:

0.  The motion of the whole body (the running sum of the median displacement of all markers) is taken out.
1.  Each marker's trajectory is cut where it is missing and where both ‖x_t - x_{t-1}‖ and ‖x_t - 2x_{t-1} + x_{t-2}‖
    exceed the threshold, seen forwards and seen backwards.
2.  Of the pieces, the chain of largest total length is trusted in which each piece can be reached from the one before
    within the threshold per frame, from where it ended, or along its velocity, or back along the next one's. Between
    two pieces of more than a second each nothing tells which is at fault: both stay.
3.  A sample within the threshold of the smooth curve (PCHIP) through the chain is trusted again.

The threshold is a distance per frame at 120 Hz; steps 1 and 2 scale it by 120 / rate.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass
from scipy.interpolate import PchipInterpolator

from mocapclean.arrays import Bools, Floats, runs
from mocapclean.detection.evidence import Evidence
from mocapclean.detection.rule import Ruling, Switch, findings
from mocapclean.numerics.robust import nan_median
from mocapclean.parameters import STRICT

_LOOK_BACK = 40


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Params(Switch):
    """The numbers of trust data detection."""

    distance: Annotated[float, Field(gt=0, description="φ, mm per frame at 120 Hz that no marker exceeds")] = 60.0
    longest: Annotated[float, Field(gt=0, description="seconds; two longer pieces may stand a jump apart")] = 1.0


def examine(evidence: Evidence, params: Params) -> Ruling:
    """The samples (F, M) that no chain of plausible motion reaches, and a finding for each run of them."""
    take = evidence.take
    step = params.distance * 120.0 / take.rate
    positions = np.where(take.trusted[..., None], take.positions, np.nan)
    relative = positions - _body_track(positions)[:, None]
    distrusted = np.zeros_like(take.trusted)
    cuts = _cuts(relative, take.trusted, step)
    for marker in np.flatnonzero(cuts.any(axis=0)):
        valid = take.trusted[:, marker]
        segments = _segments(valid, cuts[:, marker])
        chain = _best_chain(relative[:, marker], segments, step, params.longest * take.rate)
        distrusted[:, marker] = valid & ~_readmit(relative[:, marker], chain, valid, params.distance)

    def message(marker: int, start: int, stop: int) -> str:
        return f"{stop - start} frames that the rest of its path cannot reach at {step:.0f} mm a frame"

    advice = "look at these frames; raise trust.tdd.distance if the motion is real"
    return distrusted, tuple(findings("tdd", take, distrusted, message, advice))


def _body_track(positions: Floats) -> Floats:
    """The running sum (F, 3) of the median displacement over markers; robust to gaps and to wild markers."""
    steps = np.diff(positions, axis=0)
    track = np.zeros((len(positions), 3))
    seen = np.isfinite(steps[..., 0]).any(axis=1)
    if seen.any():
        track[1:][seen] = nan_median(steps[seen], axis=1)
    return np.cumsum(track, axis=0)


def _cuts(positions: Floats, valid: Bools, step: float) -> Bools:
    """Where (F, M) a trajectory is cut before frame t, forwards and backwards alike."""
    if len(positions) < 2:
        return np.zeros_like(valid)
    backward = _forward_cuts(positions[::-1], valid[::-1], step)[::-1]
    cuts = _forward_cuts(positions, valid, step)
    cuts[1:] &= backward[:-1]
    return cuts


def _forward_cuts(positions: Floats, valid: Bools, step: float) -> Bools:
    """A step too long, unless the two frames before it (uncut) predict it."""
    jump = np.zeros_like(valid)
    jump[1:] = np.linalg.norm(np.diff(positions, axis=0), axis=2) > step
    unpredicted = np.ones_like(valid)
    if len(positions) > 2:
        bend = np.linalg.norm(np.diff(positions, n=2, axis=0), axis=2)
        unpredicted[2:] = ~(bend <= step)
    # In an unbroken run of jumps, the first that nothing predicts leaves its followers without a past as well.
    index = np.arange(len(valid))[:, None]
    last_calm = np.maximum.accumulate(np.where(jump, -1, index), axis=0)
    last_break = np.maximum.accumulate(np.where(jump & unpredicted, index, -1), axis=0)
    return jump & (last_break > last_calm)


def _segments(valid: NDArray[np.bool_], cuts: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Pieces (start, stop) of one trajectory (F,), broken at invalid frames and at cuts."""
    pieces = [
        np.stack([np.r_[start, inner], np.r_[inner, stop]], axis=1)
        for start, stop in runs(valid)
        for inner in [start + 1 + np.flatnonzero(cuts[start + 1 : stop])]
    ]
    return np.concatenate(pieces)


def _best_chain(path: Floats, segments: NDArray[np.intp], step: float, longest: float) -> NDArray[np.bool_]:
    """The frames (F,) of the longest chain of pieces in which each can follow the one before."""
    starts, stops = segments[:, 0], segments[:, 1]
    first, last = path[starts], path[stops - 1]
    several = (stops - starts > 1)[:, None]
    leaving = np.where(several, last - path[np.maximum(stops - 2, 0)], 0.0)
    arriving = np.where(several, path[np.minimum(starts + 1, len(path) - 1)] - first, 0.0)
    total = (stops - starts).astype(np.int64)
    long = total > longest
    before = np.full(len(segments), -1)
    for i in range(1, len(segments)):
        j = np.arange(max(0, i - _LOOK_BACK), i)
        gap = (starts[i] - (stops[j] - 1))[:, None]
        away = first[i] - last[j]
        reach = np.stack([away, away - gap * leaving[j], away - gap * arriving[i]])
        can = (np.linalg.norm(reach, axis=2) <= step * gap[:, 0]).any(axis=0) | (long[i] & long[j])
        if can.any():
            best = j[can][np.argmax(total[j[can]])]
            before[i] = best
            total[i] += total[best]
    chosen = np.zeros(len(path), dtype=bool)
    i = int(np.argmax(total))
    while i >= 0:
        chosen[starts[i] : stops[i]] = True
        i = before[i]
    return chosen


def _readmit(path: Floats, chain: NDArray[np.bool_], valid: NDArray[np.bool_], distance: float) -> NDArray[np.bool_]:
    """The chain and every valid frame between its ends that lies within the threshold of the curve through it."""
    frames = np.flatnonzero(chain)
    doubted = np.flatnonzero(valid & ~chain)
    doubted = doubted[(doubted > frames[0]) & (doubted < frames[-1])]
    trusted = chain.copy()
    if len(frames) > 1 and doubted.size:
        curve = PchipInterpolator(frames, path[frames], axis=0)(doubted)
        trusted[doubted] = np.linalg.norm(path[doubted] - curve, axis=1) <= distance
    return trusted
