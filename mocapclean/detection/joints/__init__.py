"""Find the faults of joints in their own channels: pops, holds and splices of rotations and translations.

Descendants of a joint that are right relative to their parents have no fault, as their own channels do not jump.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.detection.joints.holds import Hold, find_holds
from mocapclean.detection.joints.pops import LEAST, Excursion, find_excursions
from mocapclean.detection.joints.signals import Part, Signals, rotation_signals, translation_signals
from mocapclean.detection.joints.splices import Splice, find_splices
from mocapclean.geometry.joint_motion import JointMotion
from mocapclean.geometry.skeleton import Skeleton

_BESIDE = 2
"""Frames on each side of a fault that must be known if it is sure. Chosen by hand."""
_FLIP = 100.0
"""Degrees, as a chord, of a flip: 104 degrees of rotation. A joint and its children may have been solved in another
way, and their repair needs them all. Chosen by hand on the thumbs and thighs of the takes at even places."""
_LONGEST_FLIP = 2
"""Frames up to which a flip is a pop like others. Chosen by hand."""
_MANY = 0.5
"""Share of the joints that move: if more of them hold their values at once, the body may have been posed. By hand."""


@dataclass(frozen=True, kw_only=True)
class JointFault:
    """A fault of the rotation or translation of a joint in frames start to stop, half open.

    is_sure: whether the samples cannot be trusted; else the fault is a suspicion.
    """

    kind: Literal["pop", "hold", "splice"]
    joint: int
    start: int
    stop: int
    part: Part
    is_sure: bool
    message: str


def faults(skeleton: Skeleton, motion: JointMotion, rate: float) -> tuple[JointFault, ...]:
    """Return the faults of all joints, by kind, joint and time; ``rate`` in Hz."""
    found: list[JointFault] = []
    parts = [
        signals for signals in (rotation_signals(motion), translation_signals(skeleton, motion)) if len(signals.joints)
    ]
    pops = [find_excursions(signals, rate) for signals in parts]
    # The same value in all frames of a pop is no hold: the path leaves it on both sides.
    holds = [
        [hold for hold in find_holds(signals) if not _overlaps(hold, excursions)]
        for signals, excursions in zip(parts, pops, strict=True)
    ]
    clear = _clear_spans(parts, holds)
    for signals, excursions, own_holds in zip(parts, pops, holds, strict=True):
        excused = _excused(signals, excursions, own_holds)
        sure = _sure(skeleton, signals, excursions)
        found += [_pop(signals, excursion, excursion in sure) for excursion in excursions]
        found += [_hold(signals, hold, clear) for hold in own_holds]
        found += [_splice(signals, splice) for splice in find_splices(signals, excused)]
    return tuple(sorted(found, key=lambda fault: (fault.kind, fault.joint, fault.part, fault.start)))


def _overlaps(hold: Hold, excursions: list[Excursion]) -> bool:
    """Whether a hold has frames in common with an excursion of the same signal."""
    return any(
        hold.signal == other.signal and hold.start < other.stop and other.start < hold.stop for other in excursions
    )


def _clear_spans(parts: list[Signals], holds: list[list[Hold]]) -> set[tuple[int, int]]:
    """Return the spans in which a joint holds for sure and jumps far: others that hold in these frames do as well."""
    spans: dict[tuple[int, int], list[bool]] = {}
    for hold in (hold for own in holds for hold in own):
        spans.setdefault((hold.start, hold.stop), []).append(hold.is_clear and hold.jump >= LEAST)
    moving = sum(len(signals.joints) for signals in parts)
    return {span for span, clear in spans.items() if any(clear) and (len(clear) <= _MANY * moving or moving <= 2)}


def _excused(signals: Signals, excursions: list[Excursion], holds: list[Hold]) -> Bools:
    """Return the steps (F - 1, S) into, within and out of pops and holds."""
    excused = np.zeros((len(signals.paths) - 1, len(signals.joints)), dtype=bool)
    spans: list[Excursion | Hold] = [*excursions, *holds]
    for span in spans:
        excused[max(span.start - 1, 0) : span.stop, span.signal] = True
    return excused


def _sure(skeleton: Skeleton, signals: Signals, excursions: list[Excursion]) -> set[Excursion]:
    """Return the excursions that no motion explains, and those of their parents and children in the same frames.

    An excursion of a joint that its child undoes must be repaired in both or in neither.
    """
    judged = [excursion for excursion in excursions if _can_be_sure(signals, excursion)]
    sure = {excursion for excursion in judged if excursion.score >= 1.0}
    spans = {(int(signals.joints[other.signal]), other.start, other.stop) for other in sure}
    for excursion in judged:
        joint = int(signals.joints[excursion.signal])
        near = {skeleton.parents[joint], *(child for child, parent in enumerate(skeleton.parents) if parent == joint)}
        if any((other, excursion.start, excursion.stop) in spans for other in near):
            sure.add(excursion)
    return sure


def _can_be_sure(signals: Signals, excursion: Excursion) -> bool:
    """Whether the frames beside an excursion are known, and it is no lasting flip to another solution of the pose."""
    start, stop = excursion.start, excursion.stop
    is_flip = signals.part == "rotation" and stop - start > _LONGEST_FLIP and excursion.size >= _FLIP
    return not is_flip and bool(signals.known[max(start - _BESIDE, 0) : stop + _BESIDE, excursion.signal].all())


def _pop(signals: Signals, excursion: Excursion, is_sure: bool) -> JointFault:
    start, stop = excursion.start, excursion.stop
    frames = "1 frame" if stop - start == 1 else f"{stop - start} frames"
    size = signals.measure(excursion.signal, excursion.size)
    return JointFault(
        kind="pop",
        joint=int(signals.joints[excursion.signal]),
        start=start,
        stop=stop,
        part=signals.part,
        is_sure=is_sure,
        message=f"the {signals.part} leaves its path by {size} for {frames} and comes back",
    )


def _hold(signals: Signals, hold: Hold, clear: set[tuple[int, int]]) -> JointFault:
    jump = signals.measure(hold.signal, hold.jump)
    return JointFault(
        kind="hold",
        joint=int(signals.joints[hold.signal]),
        start=hold.start,
        stop=hold.stop,
        part=signals.part,
        is_sure=(hold.start, hold.stop) in clear,
        message=f"the {signals.part} keeps one value for {hold.stop - hold.start} frames and then jumps by {jump}",
    )


def _splice(signals: Signals, splice: Splice) -> JointFault:
    jump = signals.measure(splice.signal, splice.size)
    return JointFault(
        kind="splice",
        joint=int(signals.joints[splice.signal]),
        start=splice.at - 1,
        stop=splice.at + 1,
        part=signals.part,
        is_sure=False,
        message=f"the {signals.part} jumps by {jump} from one frame to the next and does not come back",
    )
