"""Inverse kinematics: joint angles fitted to joint positions without moving the joints that must stay.

A fit is a constrained least-squares problem for each frame: wanted joints are brought to their targets, fixed joints
are constraints. This module chooses the free channels and the start of each attempt, and widens or gives up what
violates a constraint. The steps of an attempt are in ``geometry.euler`` (the start over a gap), ``aiming`` (chains
turned towards their targets) and ``least_squares`` (damped least squares).
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, runs
from mocapclean.geometry.euler import bridge, rotations_of, smoothest
from mocapclean.geometry.inverse_kinematics.aiming import aim
from mocapclean.geometry.inverse_kinematics.free_channels import channels_to_reach
from mocapclean.geometry.inverse_kinematics.least_squares import least_squares
from mocapclean.geometry.skeleton import Skeleton, influence, placed

# All numbers below were chosen by hand and no sweep was kept; tests/geometry/test_inverse_kinematics.py holds what
# they achieve.

LEVELS = 2
"""Sets of free channels that are tried for a joint, narrow to wide, before its run of frames is given up."""
EXTRA_FREEDOMS = 3
"""Degrees of freedom by which each level widens the set of the one before."""
ATTEMPTS = 5
"""Attempts at one set of free channels: the first from the frames around, the others from frames that came out well."""
ATTEMPTS_AT_JUMPS = 2
"""Attempts after which frames at jumps of an angle are solved again, although they hold all constraints."""
AIM_AT_FIXED_FROM = 3
"""The attempt, from 0, from which chains are aimed at the fixed joints alone: constraints before targets."""
FARTHEST_ROUNDS = 4
"""Rounds in which, of the fixed joints that moved in a frame, only the farthest counts: others may have given way."""

START_WEIGHT = 1e-4
"""mm² per degree² or mm²: pull of a free channel towards its start in the first attempt, too weak to move a joint."""
LATER_START_WEIGHT = 1e-2
"""The same in further attempts, so that angles which hardly move any joint do not jump between frames."""
LENGTH_WEIGHT = 1e3
"""The same for a bone's length that is stored as steady position channels: lengths yield last, at the wider level."""
STEADY_MM = 0.01
"""Millimetres: position channels that vary by less over the known frames are lengths of a bone."""
TOLERANCE_SHARE = 0.98
"""Share of the tolerance that a fit may use: the rest is left for the rounding of the numbers in the file."""
UNCHANGED = 1e-9
"""Degrees or millimetres: a free channel that changed by less keeps its number."""

KNOWN_STEPS = 30
"""Known steps of an angle, frame to frame, above which their own quantile sets the limit of a jump."""
STEP_QUANTILE = 0.99
"""Quantile of the known steps of an angle that stands for its fastest regular motion."""
JUMP_FACTOR = 4
"""A jump is a step of more than this many times that quantile."""
LEAST_JUMP = 5.0
"""Degrees from one frame to the next: a smaller step is never a jump."""
MOST_JUMP = 30.0
"""Degrees from one frame to the next: a larger step is always a jump; the limit where few steps are known."""
FRAMES_BEFORE_JUMP = 1
"""Frames before the first frame of a jump that are solved again."""
FRAMES_FROM_JUMP = 3
"""Frames from the first frame of a jump on that are solved again."""
CLOSE_JUMPS = 20
"""Frames: jumps closer than this enclose frames on a wrong branch, which are all solved again."""


@dataclass(frozen=True, kw_only=True)
class FittedPoses:
    """The result of a fit.

    poses: (F, C) degrees and millimetres, NaN where the file has no value and none was needed. changed: (F, C) bool,
    the numbers that were rewritten. fitted: (F, J) bool, the wanted joints that were brought as near to their
    targets as the skeleton and the fixed joints allow.
    """

    poses: Floats
    changed: Bools
    fitted: Bools


def fit(
    skeleton: Skeleton,
    poses: Floats,
    targets: Floats,
    fixed: Bools,
    wanted: Bools,
    *,
    tolerance: float = 0.1,
) -> FittedPoses:
    """Return poses that bring ``wanted`` joints to their targets while ``fixed`` joints stay.

    poses: (F, C) degrees and millimetres, NaN where the file has no value. targets: (F, J, 3) millimetres, read
    where fixed or wanted. fixed, wanted: (F, J) bool. tolerance: millimetres that a fixed joint may move. Where the
    tolerance cannot be kept, the runs of wanted frames of the joints concerned keep their poses.

    The missing channels that decide a wanted joint are free. Where there are none, the rotations that move the joint
    are free, up to the third degree of freedom or more, with those that hold the subtrees they carry. The values of
    free channels are never read. They start from a bridge over the frames in which they are free, are aimed at the
    targets, and end at the minimum of the least squares.
    """
    frames = _frames_that_matter(poses, wanted)
    state = _Fitting(skeleton, poses, frames, targets, fixed, wanted, tolerance)
    unsolved: Bools = np.asarray(state.wanted.any(axis=1))
    rounds = 0
    while unsolved.any():
        state.choose_free(unsolved)
        violations = state.solve(unsolved)
        unsolved = state.widen_or_give_up(violations, farthest=rounds < FARTHEST_ROUNDS)
        rounds += 1
    smooth = state.without_jumps()
    fitted, changed, done = poses.copy(), np.zeros(poses.shape, dtype=bool), np.zeros_like(wanted)
    changed[frames] = state.free & ~(np.abs(smooth - state.given) <= UNCHANGED)
    fitted[frames] = np.where(changed[frames], smooth, state.given)
    done[frames] = state.wanted
    return FittedPoses(poses=fitted, changed=changed, fitted=done)


def _frames_that_matter(poses: Floats, wanted: Bools) -> Ints:
    """Return the frames that a fit reads: those with wanted joints, and on both sides the rest of what is unknown.

    A run of frames that are wanted, or have a channel without a value, ends at a frame that is known as a whole.
    Nothing is bridged, smoothed or solved across such a frame, so that each run can be fitted without the others.
    """
    known = np.isfinite(poses).all(axis=1) & ~wanted.any(axis=1)
    matter = np.zeros(len(poses), dtype=bool)
    for start, stop in runs(np.asarray(~known)):
        if wanted[start:stop].any():
            matter[max(start - 1, 0) : stop + 1] = True
    return np.flatnonzero(matter)


class _Fitting:
    """The state of a fit, in the f frames that it reads; all frames together set the limits of a channel.

    frames: (f,) their indices. all_given: (F, C) the poses of all frames. given: (f, C) the poses to be fitted. poses:
    (f, C) the poses so far. free: (f, C) bool. wanted, fixed: (f, J) bool, the joints to be moved and the constraints;
    a joint that is given up is no longer wanted. level: (f, J) which set of free channels a wanted joint has reached.
    channel_sets: (J, C) bool for each level. places, (J, C) bool: whether a channel decides where a joint is. missing:
    (f, C) bool, channels without a value. explained: (f, J) bool, joints that a missing channel decides, so that no
    other need be free.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        poses: Floats,
        frames: Ints,
        targets: Floats,
        fixed: Bools,
        wanted: Bools,
        tolerance: float,
    ) -> None:
        self.skeleton, self.frames, self.tolerance = skeleton, frames, tolerance
        self.all_given, self.given, self.targets = poses, poses[frames], targets[frames]
        self.places, orients = influence(skeleton)
        self.missing = np.isnan(self.given)
        roots = np.array(skeleton.parents)[:, None] < 0
        # A missing rotation of a root explains the root, although it does not move it.
        self.explained = self.missing @ (self.places | (orients & roots)).T
        finite = np.isfinite(self.targets).all(axis=2)
        self.wanted = wanted[frames] & finite
        # A joint that a missing channel decides has no place yet, and cannot be a constraint.
        self.fixed = fixed[frames] & finite & ~self.wanted & ~(self.missing @ self.places.T)
        self.channel_sets = [channels_to_reach(skeleton, EXTRA_FREEDOMS * level) for level in range(LEVELS)]
        self.level = np.zeros(self.wanted.shape, dtype=np.intp)
        self.free = np.zeros(self.given.shape, dtype=bool)
        self.poses = self.given.copy()
        self.is_rotation = np.array([c.is_rotation for c in skeleton.channels], dtype=bool)
        self.below_root = np.array([skeleton.parents[c.joint] >= 0 for c in skeleton.channels], dtype=bool)

    def _joints_at(self, level: int) -> Bools:
        """Return the wanted joints (F, J) that free the channels of a level."""
        joints = self.wanted & (self.level == level)
        return np.asarray(joints & ~self.explained if level == 0 else joints)

    def choose_free(self, unsolved: Bools) -> None:
        """Free, in the unsolved frames (F,), the channels that the wanted joints need, and reset the poses there."""
        free = self.missing & (self.wanted @ self.places)
        for level, channels in enumerate(self.channel_sets):
            free |= self._joints_at(level) @ channels
        # A channel that moves no joint with a known place cannot be determined.
        free &= (self.fixed | self.wanted) @ self.places
        self.free[unsolved] = free[unsolved]
        self.poses[unsolved] = self.given[unsolved]

    def solve(self, unsolved: Bools) -> Floats:
        """Solve the unsolved frames (F,) in up to ``ATTEMPTS`` attempts.

        Returns how far, (F, J) millimetres, fixed joints moved nevertheless; zero within the tolerance.
        """
        violations = np.zeros(self.fixed.shape)
        again = unsolved & self.free.any(axis=1)
        for attempt in range(ATTEMPTS):
            rows = np.flatnonzero(again)
            if not len(rows):
                break
            solved = self._solve_frames(again, rows, attempt)
            moved = self._violations(solved, rows)
            # Take the new poses of a frame if it had none, if the old ones violate, or if the new ones do not.
            take = np.full(len(rows), attempt == 0) | violations[rows].any(axis=1) | ~moved.any(axis=1)
            self.poses[rows[take]] = np.where(self.free[rows], solved, self.given[rows])[take]
            violations[rows[take]] = moved[take]
            again = np.asarray(violations.any(axis=1))
            if attempt < ATTEMPTS_AT_JUMPS:
                again |= unsolved & self._frames_at_jumps()
        return violations

    def _solve_frames(self, again: Bools, rows: Ints, attempt: int) -> Floats:
        """Return the poses (f, C) of one attempt at some frames: bridged, aimed, and refined by least squares."""
        free, wanted, fixed = self.free[rows], self.wanted[rows], self.fixed[rows]
        targets = self.targets[rows]
        start = bridge(self.skeleton, self.poses, self.free & again[:, None])[rows]
        # Attempts between start from the frames around that came out well, and are not aimed.
        if attempt == 0 or attempt >= AIM_AT_FIXED_FROM:
            known = fixed if attempt else fixed | wanted
            start = aim(self.skeleton, start, free, known, targets)
        narrow = (self.level[rows] == 0).all(axis=1)
        is_length = narrow[:, None] & self._lengths()
        start_weights = np.where(is_length, LENGTH_WEIGHT, LATER_START_WEIGHT if attempt else START_WEIGHT)
        return least_squares(
            self.skeleton, start, free, wanted, fixed, targets, start_weights, constraints_first=attempt > 0
        )

    def _lengths(self) -> Bools:
        """Return the position channels (C,) below a root that keep one value wherever they are known."""
        steady = np.zeros(self.given.shape[1], dtype=bool)
        for channel in np.flatnonzero(~self.is_rotation & self.below_root & self.free.any(axis=0)):
            known = self.all_given[:, channel].copy()
            known[self.frames[self.free[:, channel]]] = np.nan
            known = known[~np.isnan(known)]
            steady[channel] = len(known) > 0 and known.max() - known.min() < STEADY_MM
        return steady

    def _violations(self, poses: Floats, rows: Ints) -> Floats:
        """Return how far (f, J), in millimetres, these poses move fixed joints; zero within the tolerance."""
        positions = placed(self.skeleton, poses)
        moved = np.linalg.norm(positions - self.targets[rows], axis=2)
        constrained = self.fixed[rows] & (self.free[rows] @ self.places.T)
        return np.where(constrained & (moved > TOLERANCE_SHARE * self.tolerance), moved, 0.0)

    def _frames_at_jumps(self) -> Bools:
        """Return the frames (f,) with free channels at a jump of a free angle, or between jumps close together."""
        step = _angle_steps(self.poses)
        # A step is free if either of its frames is.
        free_steps = self.free.copy()
        free_steps[:-1] |= self.free[1:]
        rough = np.zeros(len(step), dtype=bool)
        large = free_steps & (step > LEAST_JUMP)
        for channel in np.flatnonzero(self.is_rotation & large.any(axis=0)):
            jumps = np.flatnonzero(large[:, channel] & (step[:, channel] > self._largest_step(int(channel))))
            for jump in jumps:
                rough[max(0, jump - FRAMES_BEFORE_JUMP) : jump + FRAMES_FROM_JUMP] = True
            for near in np.flatnonzero(np.diff(self.frames[jumps]) < CLOSE_JUMPS):
                rough[jumps[near] : jumps[near + 1] + 1] = True
        return np.asarray(rough & self.free.any(axis=1))

    def _largest_step(self, channel: int) -> float:
        """Return the largest step of an angle, degrees, that is no jump, by its known steps in the whole take."""
        free = np.zeros(len(self.all_given), dtype=bool)
        free[self.frames] = self.free[:, channel]
        free[:-1] |= free[1:]
        known = _angle_steps(self.all_given[:, channel])[~free]
        known = known[np.isfinite(known)]
        if len(known) <= KNOWN_STEPS:
            return MOST_JUMP
        return float(np.clip(JUMP_FACTOR * np.quantile(known, STEP_QUANTILE), LEAST_JUMP, MOST_JUMP))

    def widen_or_give_up(self, violations: Floats, *, farthest: bool) -> Bools:
        """Widen the free channels of the wanted joints whose channels moved fixed joints, or give up their runs.

        violations: (F, J) millimetres. farthest: whether only the joint that moved farthest in a frame counts.
        Returns the frames (F,) to be solved again.
        """
        widened = np.zeros_like(self.wanted)
        violated = (violations > 0) & (violations >= (violations.max(axis=1, keepdims=True) if farthest else 0))
        # A wanted joint is responsible if one of its free channels moves a violated joint.
        for level, channels in enumerate(self.channel_sets):
            widened |= self._joints_at(level) & (violated @ (channels @ self.places.T).T)
        exhausted = widened & (self.level == LEVELS - 1)
        for joint in np.flatnonzero(exhausted.any(axis=0)):
            for first, stop in runs(self.wanted[:, joint]):
                if exhausted[first:stop, joint].any():
                    widened[first:stop, joint] = True
                    self.wanted[first:stop, joint] = False
        self.level += widened
        return np.asarray(widened.any(axis=1))

    def without_jumps(self) -> Floats:
        """Return the poses with Euler angles of the same rotations that do not jump, in the runs of free angles."""
        poses = self.poses.copy()
        for group in rotations_of(self.skeleton):
            free_together = (self.free[:, group] == self.free[:, group[:1]]).all()
            for part in [group] if group and free_together else [[channel] for channel in group]:
                axes = [self.skeleton.channels[i].axis for i in part]
                for first, stop in runs(self.free[:, part[0]]):
                    span = slice(max(first - 1, 0), stop + 1)
                    if np.isfinite(poses[span][:, part]).all():
                        poses[first:stop, part] = smoothest(axes, poses[span][:, part], first > 0, stop < len(poses))
        return poses


def _angle_steps(angles: Floats) -> Floats:
    """Return the sizes of the steps of angles (F, ...), degrees, to the next frame, without whole turns."""
    step = np.abs(np.diff(angles, axis=0, append=angles[-1:]))
    return np.asarray(np.abs(step - 360 * np.round(step / 360)))
