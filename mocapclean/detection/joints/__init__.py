"""Find the faults of joints in their own channels: pops, holds and splices of rotations and translations.

Descendants of a joint that are right relative to their parents have no fault, as their own channels do not jump.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.detection.joints.ends import find_at_ends
from mocapclean.detection.joints.holds import Hold, find_holds
from mocapclean.detection.joints.pops import LEAST, Excursion, find_excursions, longest_frames
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
_TOGETHER = 3
"""Joints whose splices at one frame are reported one by one; those of more joints are one fault. Chosen by hand."""


@dataclass(frozen=True, kw_only=True)
class JointFault:
    """A fault of the rotation or translation of a joint in frames start to stop, half open.

    is_sure: whether the samples cannot be trusted; else the fault is a suspicion. A splice has the frames before and
    behind the jump, of the joint nearest to the root where many jump at once.
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
    splices: list[tuple[Signals, Splice]] = []
    parts = [
        signals for signals in (rotation_signals(motion), translation_signals(skeleton, motion)) if len(signals.joints)
    ]
    pops = _with_ends(parts, [find_excursions(signals, rate) for signals in parts], rate)
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
        splices += [(signals, splice) for splice in find_splices(signals, excused)]
    found += _reported_splices(splices)
    return tuple(sorted(found, key=lambda fault: (fault.kind, fault.joint, fault.part, fault.start)))


def _with_ends(parts: list[Signals], pops: list[list[Excursion]], rate: float) -> list[list[Excursion]]:
    """Return the excursions of all parts with those at the ends of the take; a sure one within it excludes these."""
    ends = [find_at_ends(signals, longest_frames(rate)) for signals in parts]
    for at_start in (True, False):
        joints = {
            int(signals.joints[one.signal])
            for signals, own in zip(parts, ends, strict=True)
            for one in own
            if (one.start < _BESIDE) == at_start
        }
        if len(joints) > _TOGETHER:
            ends = [[one for one in own if (one.start < _BESIDE) != at_start] for own in ends]
    merged = []
    for own, inside in zip(ends, pops, strict=True):
        sure = [other for other in inside if other.score >= 1.0]
        own = [one for one in own if not any(_touch(one, other) for other in sure)]
        merged.append(own + [other for other in inside if not any(_touch(one, other) for one in own)])
    return merged


def _touch(one: Excursion, other: Excursion) -> bool:
    """Whether two excursions of the same signal have no frame between them."""
    return one.signal == other.signal and one.start <= other.stop and other.start <= one.stop


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
    """Return the excursions that no motion explains, and those of adjoining joints in the same frames.

    An excursion of a joint that its child undoes must be repaired in both or in neither; so none is sure that has the
    frames of a flip.
    """
    flips = {(other.start, other.stop) for other in excursions if _is_flip(signals, other)}
    judged = [one for one in excursions if (one.start, one.stop) not in flips and _is_known(signals, one)]
    sure = {excursion for excursion in judged if excursion.score >= 1.0}
    places = {(int(signals.joints[other.signal]), other.start, other.stop) for other in sure}
    for excursion in judged:
        near = _adjoining(skeleton, int(signals.joints[excursion.signal]))
        if any((joint, excursion.start, excursion.stop) in places for joint in near):
            sure.add(excursion)
    return sure


def _adjoining(skeleton: Skeleton, joint: int) -> set[int]:
    """Return the parent, the children and the siblings of a joint."""
    parent = skeleton.parents[joint]
    pairs = enumerate(skeleton.parents)
    return {parent} | {other for other, above in pairs if above == joint or above == parent >= 0}


def _is_flip(signals: Signals, excursion: Excursion) -> bool:
    """Whether an excursion is a lasting turn to what may be another solution of the same pose."""
    is_long = excursion.stop - excursion.start > _LONGEST_FLIP
    return signals.part == "rotation" and is_long and excursion.size >= _FLIP


def _is_known(signals: Signals, excursion: Excursion) -> bool:
    """Whether the frames of an excursion and those beside it are known."""
    frames = slice(max(excursion.start - _BESIDE, 0), excursion.stop + _BESIDE)
    return bool(signals.known[frames, excursion.signal].all())


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


def _reported_splices(splices: list[tuple[Signals, Splice]]) -> list[JointFault]:
    """Return the faults of splices; one for each frame at which many joints jump."""
    together: dict[int, list[tuple[Signals, Splice]]] = defaultdict(list)
    for signals, splice in splices:
        together[splice.at].append((signals, splice))
    reported = []
    for group in together.values():
        group.sort(key=lambda one: int(one[0].joints[one[1].signal]))
        n_joints = len({int(signals.joints[splice.signal]) for signals, splice in group})
        is_few = n_joints <= _TOGETHER
        reported += [_splice(*one, 0 if is_few else n_joints - 1) for one in (group if is_few else group[:1])]
    return reported


def _splice(signals: Signals, splice: Splice, n_others: int) -> JointFault:
    """Return the fault of a splice at which other joints jump as well."""
    jump = signals.measure(splice.signal, splice.size)
    others = f", with {n_others} other joints" if n_others else ""
    return JointFault(
        kind="splice",
        joint=int(signals.joints[splice.signal]),
        start=splice.at - 1,
        stop=splice.at + 1,
        part=signals.part,
        is_sure=False,
        message=f"the {signals.part} jumps by {jump} from one frame to the next and does not come back{others}",
    )
