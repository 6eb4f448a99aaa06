"""Inverse kinematics: joint angles fitted to joint positions without moving what is trusted.

Which angles are free, from where they start, and what happens when the trusted joints cannot be held.
"""

from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, runs
from mocapclean.geometry.inverse_kinematics.aiming import aim, bridge, rotations_of, shifts_of, smoothest
from mocapclean.geometry.inverse_kinematics.refining import refine
from mocapclean.geometry.skeleton import Skeleton, influence, move

SWING, SUBTREE = 3, 6  # degrees of freedom that turn one joint at will; that do so and keep what hangs on it
WIDER = 3  # more of them where the first choice cannot hold the fixed joints
CHOICES = 2  # after which a joint is left as it is
ATTEMPTS = 5  # for one choice: the first from scratch, the others from the frames that came out well
SMOOTHING = 2  # of these also solve again what jumps
ALONE = 3  # and from this one on the start is aimed at the fixed joints only
PATIENCE = 4  # rounds in which only the joint that was lost farthest counts
SLACK = 1e-4  # mm² per degree² or mm² that a free channel is held to its start
FIRM = 1e-2  # the same in further attempts: angles that positions hardly show should not jump
STIFF = 1e3  # the same for a steady shift while the first choice lasts: bones keep their lengths
STEADY = 0.01  # mm
MARGIN = 0.98  # of the tolerance: the rest is for the spelling of the numbers


@dataclass(frozen=True, kw_only=True)
class FittedPoses:
    """Refitted poses.

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
    """Rewrite the joint angles that bring ``wanted`` joints to their targets while ``fixed`` ones stay.

    poses: (F, C) degrees and millimetres, NaN where the file has no value. targets: (F, J, 3) millimetres, read
    where fixed or wanted. fixed, wanted: (F, J) bool. tolerance: millimetres that a fixed joint may move; where that
    cannot be kept, the runs of wanted frames of the joints concerned are left as they were.

    Free are the missing channels that decide a wanted joint or, where there are none, the rotations that move the
    joint, up to the third degree of freedom or more, and those that keep in place what hangs on them. The values of
    free channels are never read. They start from a bridge over the frames in which they are free (``bridge``), aimed
    at the targets (``aim``), and end where the least squares do (``refine``).
    """
    work = _Fitting(skeleton, poses, targets, fixed, wanted, tolerance)
    dirty: Bools = np.asarray(work.wanted.any(axis=1))
    patience = PATIENCE
    while dirty.any():
        work.choose(dirty)
        dirty = work.blame(work.settle(dirty), farthest=patience > 0)
        patience -= 1
    fitted = work.continued()
    changed = work.free & ~(np.abs(fitted - poses) <= 1e-9)
    return FittedPoses(poses=np.where(changed, fitted, poses), changed=changed, fitted=work.wanted)


class _Fitting:
    """The state of a fit: what is free, with which choice of channels, and the poses so far."""

    def __init__(
        self, skeleton: Skeleton, poses: Floats, targets: Floats, fixed: Bools, wanted: Bools, tolerance: float
    ) -> None:
        self.skeleton, self.file, self.targets, self.tolerance = skeleton, poses, targets, tolerance
        self.moved, turned = influence(skeleton)
        self.missing = np.isnan(poses)
        roots = np.array(skeleton.parents)[:, None] < 0
        self.explained = self.missing @ (self.moved | (turned & roots)).T
        finite = np.isfinite(targets).all(axis=2)
        self.wanted = wanted & finite
        self.fixed = fixed & finite & ~self.wanted & ~(self.missing @ self.moved.T)
        self.reaches = [_reach(skeleton, WIDER * choice) for choice in range(CHOICES)]
        self.choice = np.zeros(wanted.shape, dtype=np.intp)
        self.free = np.zeros(poses.shape, dtype=bool)
        self.poses = poses.copy()
        self.turns = np.array([c.is_rotation for c in skeleton.channels], dtype=bool)
        self.inner = np.array([skeleton.parents[c.joint] >= 0 for c in skeleton.channels], dtype=bool)

    def _asks(self, choice: int) -> Bools:
        """The wanted joints (F, J) that free the channels of this choice."""
        asks = self.wanted & (self.choice == choice)
        return np.asarray(asks & ~self.explained if choice == 0 else asks)

    def choose(self, dirty: Bools) -> None:
        """Set free, in the dirty frames (F,), what the wanted joints need; nothing that moves no known joint."""
        free = self.missing & (self.wanted @ self.moved)
        for choice, reach in enumerate(self.reaches):
            free |= self._asks(choice) @ reach
        free &= (self.fixed | self.wanted) @ self.moved
        self.free[dirty] = free[dirty]
        self.poses[dirty] = self.file[dirty]

    def settle(self, dirty: Bools) -> Floats:
        """Solve the dirty frames (F,); how far (F, J) fixed joints moved nevertheless, zero for those held."""
        lost = np.zeros(self.fixed.shape)
        again = dirty & self.free.any(axis=1)
        for attempt in range(ATTEMPTS):
            rows = np.flatnonzero(again)
            if not len(rows):
                break
            trial = self._solve(again, rows, attempt)
            gone = self._gone(trial, rows)
            take = np.full(len(rows), attempt == 0) | lost[rows].any(axis=1) | ~gone.any(axis=1)
            self.poses[rows[take]] = np.where(self.free[rows], trial, self.file[rows])[take]
            lost[rows[take]] = gone[take]
            again = np.asarray(lost.any(axis=1))
            if attempt < SMOOTHING:
                again |= dirty & self._jumps()
        return lost

    def _solve(self, again: Bools, rows: Ints, attempt: int) -> Floats:
        free, wanted, fixed = self.free[rows], self.wanted[rows], self.fixed[rows]
        targets = self.targets[rows]
        start = bridge(self.skeleton, self.poses, self.free & again[:, None])[rows]
        if attempt == 0 or attempt >= ALONE:
            known = fixed if attempt else fixed | wanted
            start = aim(self.skeleton, start, free, known, targets)
        first = (self.choice[rows] == 0).all(axis=1)
        stiff = first[:, None] & self._steady()
        slack = np.where(stiff, STIFF, FIRM if attempt else SLACK)
        return refine(self.skeleton, start, free, wanted, fixed, targets, slack, careful=attempt > 0)

    def _steady(self) -> Bools:
        """The shifts (C,) below the root that keep one value, a length of bone, wherever they are known."""
        known = np.where(self.free | self.missing, np.nan, self.file)
        steady = np.zeros(known.shape[1], dtype=bool)
        for channel in np.flatnonzero(~self.turns & self.inner & np.isfinite(known).any(axis=0)):
            steady[channel] = np.nanmax(known[:, channel]) - np.nanmin(known[:, channel]) < STEADY
        return steady

    def _gone(self, poses: Floats, rows: Ints) -> Floats:
        """How far (f, J) these poses move fixed joints, zero within the tolerance."""
        places = move(self.skeleton, poses).positions
        far = np.linalg.norm(places - self.targets[rows], axis=2)
        ours = self.fixed[rows] & (self.free[rows] @ self.moved.T)
        return np.where(ours & (far > MARGIN * self.tolerance), far, 0.0)

    def _jumps(self) -> Bools:
        """The frames (F,) at a jump of a free angle, and those between jumps that follow closely."""
        step = np.abs(np.diff(self.poses, axis=0, append=self.poses[-1:]))
        step = np.abs(step - 360 * np.round(step / 360))
        ours = self.free.copy()
        ours[:-1] |= self.free[1:]
        rough = np.zeros(len(step), dtype=bool)
        for channel in np.flatnonzero(self.turns & ours.any(axis=0)):
            known = step[~ours[:, channel], channel]
            known = known[np.isfinite(known)]
            limit = np.clip(4 * np.quantile(known, 0.99), 5.0, 30.0) if len(known) > 30 else 30.0
            jumps = np.flatnonzero(ours[:, channel] & (step[:, channel] > limit))
            for jump in jumps:
                rough[max(0, jump - 1) : jump + 3] = True
            for near in np.flatnonzero(np.diff(jumps) < 20):
                rough[jumps[near] : jumps[near + 1] + 1] = True
        return np.asarray(rough & self.free.any(axis=1))

    def blame(self, lost: Floats, *, farthest: bool) -> Bools:
        """Widen the choice for the wanted joints that moved the lost ones, or give up their run of frames.

        ``farthest`` looks, in each frame, only at the joint lost farthest: others may have given way to it.

        Returns the frames (F,) to be solved again.
        """
        blamed = np.zeros_like(self.wanted)
        looked_at = (lost > 0) & (lost >= (lost.max(axis=1, keepdims=True) if farthest else 0))
        for choice, reach in enumerate(self.reaches):
            blamed |= self._asks(choice) & (looked_at @ (reach @ self.moved.T).T)
        last = blamed & (self.choice == CHOICES - 1)
        for joint in np.flatnonzero(last.any(axis=0)):
            for first, stop in runs(self.wanted[:, joint]):
                if last[first:stop, joint].any():
                    blamed[first:stop, joint] = True
                    self.wanted[first:stop, joint] = False
        self.choice += blamed
        return np.asarray(blamed.any(axis=1))

    def continued(self) -> Floats:
        """The poses with equal rotations in place of those that jump, in the runs of free angles."""
        poses = self.poses.copy()
        for group in rotations_of(self.skeleton):
            alike = (self.free[:, group] == self.free[:, group[:1]]).all()
            for part in [group] if group and alike else [[channel] for channel in group]:
                axes = [self.skeleton.channels[i].axis for i in part]
                for first, stop in runs(self.free[:, part[0]]):
                    span = slice(max(first - 1, 0), stop + 1)
                    if np.isfinite(poses[span][:, part]).all():
                        poses[first:stop, part] = smoothest(axes, poses[span][:, part], first > 0, stop < len(poses))
        return poses


def _reach(skeleton: Skeleton, extra: int) -> Bools:
    """For each joint the channels (J, C) that bring it to a place and keep everything around it."""
    reach = np.zeros((len(skeleton.names), len(skeleton.channels)), dtype=bool)
    turns, shifts = rotations_of(skeleton), shifts_of(skeleton)
    children: list[list[int]] = [[] for _ in skeleton.names]
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            children[parent].append(joint)

    def descend(joint: int, quota: int, row: Bools) -> None:
        row[turns[joint] + (shifts[joint] if extra else [])] = True
        if quota > len(turns[joint]):
            for child in children[joint]:
                descend(child, quota - len(turns[joint]), row)

    for joint, row in enumerate(reach):
        lead = _lead(skeleton, shifts, joint)
        row[shifts[lead]] = True
        path = _path(skeleton, turns, lead, SWING + extra)
        if not path:
            descend(lead, SUBTREE + extra, row)
        for node in path:
            row[turns[node]] = True
            for child in set(children[node]).difference(path):
                descend(child, (SUBTREE if lead in (node, child) else SWING) + extra, row)
    return reach


def _lead(skeleton: Skeleton, shifts: list[list[int]], joint: int) -> int:
    """The joint itself, or the ancestor with which it always coincides."""
    while skeleton.parents[joint] >= 0:
        if shifts[joint] or skeleton.before[joint].any() or skeleton.after[joint].any():
            break
        joint = skeleton.parents[joint]
    return joint


def _path(skeleton: Skeleton, turns: list[list[int]], joint: int, quota: int) -> list[int]:
    """The joints, going up, whose rotations move this one, until they have so many degrees of freedom."""
    node = joint if skeleton.after[joint].any() else skeleton.parents[joint]
    path = []
    while node >= 0 and quota > 0:
        path.append(node)
        quota -= len(turns[node])
        node = skeleton.parents[node]
    return path
