"""Fill takes with poses: the rotations of joints themselves, or their positions and then the poses that reach these.

The default method fills rotations and translations. The methods of the papers work on marker matrices, so they fill the
positions of all joints that hang on what is not known, and inverse kinematics finds the unknown channels. Both leave
every known channel as it is.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.dictionaries.dictionary import Dictionary
from mocapclean.geometry.joint_motion import (
    angles_between,
    conjugate,
    from_vectors,
    joint_motion,
    rotation_vectors,
    times,
    with_motion,
)
from mocapclean.geometry.skeleton import Skeleton, influence
from mocapclean.solvers import SOLVERS
from mocapclean.solvers.running import run_method
from mocapclean.take import Solution, Take
from mocapclean.take.posed import bridged_positions, joint_positions, known_poses, with_poses

FARTHEST_MISFIT = 50.0
"""Millimetres between a joint where a method for markers puts it and where the pose has it, above which the joints that
it hangs on are left. By hand: a straight line between two places cuts an arc by as much; no grade is good then."""
_STEP_FACTOR, _STEP_DEGREES = 1.5, 1.0
"""An angular step in or beside a fitted span is at most this many times the largest step of the joint elsewhere, plus
these degrees. Chosen by hand: twice that is seen as a pop."""
_TAPER_DEGREES = 0.5
"""Degrees for each frame by which a correction of a fitted span's end fades; half of what a step may exceed by hand."""
_FIXED_MM = 0.1
"""Millimetres that a fit may move a joint that hangs on known channels alone; it has none to move it with."""


def fill_poses(method: str, take: Take, params: Any, wanted: Bools, dictionary: Dictionary | None = None) -> Solution:
    """Return the answer of a method for the wanted joints (F, J) of a take with poses, its ``poses`` included."""
    if SOLVERS[method].TRAITS.turns_joints:
        return _by_rotations(take, wanted)
    return _by_positions(method, take, params, wanted, dictionary)


def merge_poses(take: Take, solution: Solution, accepted: Bools) -> Take:
    """Return the take with the unknown channels of accepted joints (F, J) that the solution has filled."""
    assert solution.poses is not None
    _, poses, known = known_poses(take)
    filled = accepted & solution.filled & ~take.trusted
    answered = filled[:, take.owners] & ~known
    merged = with_poses(take, np.where(answered, solution.poses, poses))
    return replace(merged, filled=take.filled | filled)


def levers(skeleton: Skeleton) -> Floats:
    """Return the millimetres (J,) that the far end of each joint moves for one radian: the longest bone that it turns.

    The bone before a joint stands for that of a joint at the end of a chain.
    """
    bones = np.linalg.norm(skeleton.before + skeleton.after, axis=1)
    turned = np.linalg.norm(skeleton.after, axis=1)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            turned[parent] = max(turned[parent], np.linalg.norm(skeleton.before[joint]))
    return np.asarray(np.where(turned > 0.0, turned, bones))


class HiddenJoints:
    """The same take as a matrix of far ends, for checks that hide samples of joints and compare what fills them.

    right: the take whose known channels are right.
    """

    def __init__(self, right: Take, fill: Callable[[Take, Bools], Solution]) -> None:
        self.right, self.fill = right, fill
        self.skeleton, self.poses, self.known = known_poses(right)
        self.rotations, self.positions = self._pose(self.poses, self.known)
        zeros = np.zeros_like(right.positions)
        self.take = replace(right.as_markers(), positions=zeros, trusted=right.trusted)

    def solve(self, hidden: Take, wanted: Bools) -> Solution:
        """Return the answer for a take in which more samples are hidden; its positions (F, J, 3), mm, are the errors.

        An error is that of a joint's far end: of the joint's position, plus the rotation vector of the error of its
        rotation times its lever.
        """
        known = self.known & hidden.trusted[:, self.right.owners]
        solution = self.fill(self.right.with_known(known), wanted)
        assert solution.poses is not None
        answered = (wanted & solution.filled)[:, self.right.owners] & ~known
        rotations, positions = self._pose(np.where(answered, solution.poses, self.poses), known | answered)
        turned = np.radians(rotation_vectors(times(conjugate(self.rotations), rotations)))
        return replace(solution, positions=positions - self.positions + turned * levers(self.skeleton)[:, None])

    def _pose(self, poses: Floats, known: Bools) -> tuple[Floats, Floats]:
        """Return the rotations (F, J, 4) and positions (F, J, 3) of poses with their known channels."""
        rotations = joint_motion(self.skeleton, poses, known).rotations
        return rotations, bridged_positions(self.skeleton, poses, known)


def _by_rotations(take: Take, wanted: Bools) -> Solution:
    """Return the answer of the default method, which fills rotations and translations."""
    from mocapclean.solvers.joints import fill_joints

    skeleton, poses, known = known_poses(take)
    motion = joint_motion(skeleton, poses, known)
    asked = wanted & ~take.trusted
    answer = fill_joints(
        motion, skeleton.names, asked & ~motion.rotation_known, asked & ~motion.translation_known, take.rate
    )
    filled = asked & answer.filled
    answered = filled[:, take.owners] & ~known
    filled_poses = with_motion(
        skeleton, np.where(known, poses, np.nan), answered, answer.rotations, answer.translations
    )
    turns, shifts = (np.where(filled, sd, 0.0) for sd in (answer.rotation_sd, answer.translation_sd))
    place_sd = _position_sd(skeleton, bridged_positions(skeleton, filled_poses, known | answered), turns, shifts)
    far_sd = np.hypot(place_sd, np.radians(turns) * levers(skeleton))
    return Solution(
        positions=take.positions,
        poses=filled_poses,
        filled=filled,
        sd=np.where(filled, far_sd, 0.0),
        sd_degrees=turns,
        reason="rotations of joints",
    )


def _position_sd(skeleton: Skeleton, positions: Floats, turns: Floats, shifts: Floats) -> Floats:
    """Return the standard deviation (F, J) mm of each coordinate of joints, by the errors of all that they hang on.

    turns, shifts: (F, J) degrees about, and mm along, each axis. A turn with the standard deviation σ about each axis
    moves a point at the lever r with the variance ⅔ σ² |r|² in a coordinate, as the mean over the directions.
    """
    variances = np.zeros(turns.shape)
    for joint in np.flatnonzero((turns > 0.0).any(axis=0) | (shifts > 0.0).any(axis=0)):
        frames = np.flatnonzero((turns[:, joint] > 0.0) | (shifts[:, joint] > 0.0))
        # A bone after the joint turns about the joint's start, which is its parent's place.
        turns_itself = bool(skeleton.after[joint].any())
        pivot = skeleton.parents[joint] if turns_itself and skeleton.parents[joint] >= 0 else joint
        below = _all_below(skeleton, int(joint))
        lever = np.linalg.norm(positions[frames][:, below] - positions[frames, pivot][:, None], axis=2)
        turned = 2.0 / 3.0 * (np.radians(turns[frames, joint])[:, None] * lever) ** 2
        variances[np.ix_(frames, below)] += turned + shifts[frames, joint][:, None] ** 2
    return np.sqrt(variances)


def _all_below(skeleton: Skeleton, joint: int) -> Ints:
    """Return a joint and all that hang on it."""
    inside = [joint]
    for other, parent in enumerate(skeleton.parents):
        if parent in inside:
            inside.append(other)
    return np.array(inside, dtype=np.intp)


def _by_positions(method: str, take: Take, params: Any, wanted: Bools, dictionary: Dictionary | None) -> Solution:
    """Return the answer of a method for markers, and the poses that inverse kinematics fits to it."""
    from mocapclean.geometry.inverse_kinematics import fit

    skeleton, poses, known = known_poses(take)
    places, _ = influence(skeleton)
    # 1. The joints whose positions hang on an unknown channel are the gaps of the marker matrix.
    markers = take.as_markers()
    hidden = ~markers.trusted
    asked = np.asarray((~known & wanted[:, take.owners]) @ places.T)
    answer = run_method(method, markers, params, wanted=asked, dictionary=dictionary)
    # 2. The unknown channels bring these joints to their filled positions; all known channels stay.
    answered = hidden & answer.filled
    fitted = fit(skeleton, np.where(known, poses, np.nan), answer.positions, ~hidden, answered, tolerance=_FIXED_MM)
    # 3. A straight turn bridges the rotations that no position shows, and the ends meet the known frames beside them.
    motion = joint_motion(skeleton, fitted.poses, np.isfinite(fitted.poses))
    met = _with_ends_met(motion.rotations, ~take.trusted)
    bridged = with_motion(skeleton, np.where(known, poses, np.nan), ~known, met, motion.translations)
    apart = np.linalg.norm(joint_positions(skeleton, bridged) - answer.positions, axis=2)
    below = _below(skeleton)
    misfit = np.where(below[None], np.where(answered, apart, 0.0)[:, None, :], 0.0).max(axis=2)
    asked_joints = wanted & ~take.trusted
    open_ends = np.asarray((hidden & ~answer.filled) @ below.T)
    unreachable = _whole_runs((misfit > FARTHEST_MISFIT) | _steps_too_far(skeleton, bridged, ~take.trusted), take)
    filled = asked_joints & ~open_ends & ~unreachable
    sd = None
    if answer.sd is not None:
        farthest = np.where(below[None], np.where(answered, answer.sd, 0.0)[:, None, :], 0.0).max(axis=2)
        # The distance from the method's positions counts as an error of its own.
        sd = np.where(filled, np.hypot(farthest, misfit / 3**0.5), 0.0)
    return replace(
        answer,
        positions=take.positions,
        poses=bridged,
        filled=filled,
        sd=sd,
        misfit=misfit,
        unreachable=asked_joints & unreachable & ~open_ends,
        outliers=None,
        moved=None,
    )


def _below(skeleton: Skeleton) -> Bools:
    """Return which joints (J, J) are a joint itself or one of its children."""
    below = np.eye(len(skeleton.names), dtype=bool)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            below[parent, joint] = True
    return below


def _whole_runs(faults: Bools, take: Take) -> Bools:
    """Return the runs of untrusted samples (F, J) in which there is a fault (F, J)."""
    whole = np.zeros_like(faults)
    for joint, start, stop in column_runs(~take.trusted):
        whole[start:stop, joint] = faults[start:stop, joint].any()
    return whole


def _largest_steps(rotations: Floats, fitted: Bools) -> Floats:
    """Return the largest angular step (J,), degrees, that each joint may make beside its fitted samples (F, J)."""
    beside = fitted[1:] | fitted[:-1]
    known = np.where(beside, 0.0, angles_between(rotations[1:], rotations[:-1]))
    return np.asarray(_STEP_FACTOR * known.max(axis=0, initial=0.0) + _STEP_DEGREES)


def _with_ends_met(rotations: Floats, fitted: Bools) -> Floats:
    """Return rotations (F, J, 4) whose fitted runs (F, J) begin and end within a step of the known frames beside them.

    What a step at an end is too large fades over the frames of the run from there.
    """
    met, most = rotations.copy(), _largest_steps(rotations, fitted)
    for joint, start, stop in column_runs(fitted):
        ends = [(start - 1, slice(start, stop))] * (start > 0)
        ends += [(stop, slice(stop - 1, start - 1 if start else None, -1))] * (stop < len(met))
        for beside, inside in ends:
            run = met[inside, joint]
            step = rotation_vectors(times(conjugate(met[beside, joint]), run[0]))
            size = float(np.linalg.norm(step))
            if size <= most[joint]:
                continue
            excess = step * (1.0 - most[joint] / size)
            fading = np.clip(1.0 - np.arange(len(run)) * _TAPER_DEGREES / np.linalg.norm(excess), 0.0, 1.0)
            # In the axes of the frame beside the run: d exp(-excess), where d is the turn from there.
            turned = times(conjugate(met[beside, joint]), run)
            met[inside, joint] = times(met[beside, joint], times(from_vectors(-fading[:, None] * excess), turned))
    return met


def _steps_too_far(skeleton: Skeleton, poses: Floats, fitted: Bools) -> Bools:
    """Return the fitted samples (F, J) beside an angular step larger than the joint makes in any known frame."""
    rotations = joint_motion(skeleton, poses, np.isfinite(poses)).rotations
    steps = angles_between(rotations[1:], rotations[:-1])
    far = (fitted[1:] | fitted[:-1]) & (steps > _largest_steps(rotations, fitted))
    faults = np.zeros_like(fitted)
    faults[1:] |= far
    faults[:-1] |= far
    return np.asarray(faults & fitted)
