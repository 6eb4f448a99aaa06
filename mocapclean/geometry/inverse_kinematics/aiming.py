"""Where inverse kinematics starts: angles bridged over the frames in doubt, then aimed at the targets.

A ball joint (three rotations about different axes) is swung by the smallest rotation that points what it carries at
its targets (Wahba's problem; G. Wahba, SIAM Review 7(3) 409, 1965, doi:10.1137/1007077, solved by the SVD of
F. L. Markley, J. Astronautical Sciences 36, 245-258, 1988). If a hinge follows, its twist is chosen so that the
hinge can reach, on the side nearest to the bridge. Other rotations are turned one after the other, each by the angle
that brings what it carries nearest to the targets.
"""

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, runs
from mocapclean.geometry.rotations import fit_rotations_by_svd
from mocapclean.geometry.skeleton import Skeleton, move, turn

LEAP = 90.0  # degrees from one frame to the next that ask for another way to write a rotation
FAINT = 0.05  # of the product of two lengths: a turn that is decided by less is left to the bridge


def rotations_of(skeleton: Skeleton) -> list[list[int]]:
    """The rotation channels of each joint in product order."""
    found: list[list[int]] = [[] for _ in skeleton.names]
    for index in skeleton.product:
        found[skeleton.channels[index].joint].append(index)
    return found


def shifts_of(skeleton: Skeleton) -> list[list[int]]:
    """The position channels of each joint."""
    found: list[list[int]] = [[] for _ in skeleton.names]
    for index, channel in enumerate(skeleton.channels):
        if not channel.is_rotation:
            found[channel.joint].append(index)
    return found


def bridge(skeleton: Skeleton, poses: Floats, free: Bools) -> Floats:
    """Poses (F, C) whose free channels run straight from their last known values to their next.

    Ends are held, a channel that is never known is zero, and of all equal rotations the one is taken that needs no
    flip. Channels that are NaN and not free become zero.
    """
    known = ~free & np.isfinite(poses)
    bridged = np.where(known, poses, 0.0)
    groups = [group for group in rotations_of(skeleton) if group]
    groups += [[i] for i, channel in enumerate(skeleton.channels) if not channel.is_rotation]
    for group in groups:
        axes = [skeleton.channels[i].axis for i in group if skeleton.channels[i].is_rotation]
        for first, stop in runs(np.asarray((~known[:, group]).any(axis=1))):
            ends = [poses[i, group] for i in (first - 1, stop) if 0 <= i < len(poses)]
            if not ends:
                continue
            left, right = ends[0], ends[-1]
            if axes:
                right = _nearest(axes, right, left)
            share = np.arange(1, stop - first + 1)[:, None] / (stop - first + 1)
            line = left + share * (right - left)
            bridged[first:stop, group] = np.where(free[first:stop, group], line, bridged[first:stop, group])
    return bridged


def _nearest(axes: list[int], angles: Floats, near: Floats) -> Floats:
    """The Euler angles (..., n), degrees, of the same rotations that are nearest to ``near``."""
    best = angles + 360 * np.round((near - angles) / 360)
    if _is_ball(axes):
        other = angles * (1, -1, 1) + 180
        other += 360 * np.round((near - other) / 360)
        closer = np.abs(other - near).sum(axis=-1) < np.abs(best - near).sum(axis=-1)
        best = np.where(closer[..., None], other, best)
    return best


def smoothest(axes: list[int], angles: Floats, has_left: bool, has_right: bool) -> Floats:
    """The same rotations (F, n) as angles with the fewest and smallest jumps.

    The first and the last row, if they are said to be neighbours of the run, are kept and not returned.
    """
    ways = [angles]
    inner = slice(int(has_left), len(angles) - int(has_right))
    for direction in (1, -1):
        way = angles.copy()
        way[::direction] = _continued(axes, angles[::direction])
        if has_left:
            way[0] = angles[0]
        if has_right:
            way[-1] = angles[-1]
        ways.append(way)

    def jumps(way: Floats) -> float:
        step = np.abs(np.diff(way, axis=0))
        return float(step[step > LEAP].sum())

    return min(ways, key=jumps)[inner]


def _continued(axes: list[int], angles: Floats) -> Floats:
    """The same rotations (F, n) as the angles nearest to those of the frame before."""
    angles = np.unwrap(angles, period=360, axis=0)
    if _is_ball(axes):
        for i in np.flatnonzero(np.abs(np.diff(angles, axis=0)).sum(axis=1) > LEAP) + 1:
            other = angles[i:] * (1, -1, 1) + 180
            other += 360 * np.round((angles[i - 1] - other[0]) / 360)
            if np.abs(other[0] - angles[i - 1]).sum() < np.abs(angles[i] - angles[i - 1]).sum():
                angles[i:] = other
    return angles


def _is_ball(axes: list[int]) -> bool:
    return len(axes) == 3 and len(set(axes)) == 3


def aim(skeleton: Skeleton, poses: Floats, free: Bools, known: Bools, targets: Floats) -> Floats:
    """Poses (F, C) whose free rotations point, from the roots outwards, at the known (F, J) targets (F, J, 3)."""
    return _Aim(skeleton, poses, free, known, targets).poses


class _Aim:
    """One pass over the joints, each after its parent."""

    def __init__(self, skeleton: Skeleton, poses: Floats, free: Bools, known: Bools, targets: Floats) -> None:
        self.skeleton, self.start, self.poses, self.free, self.known = skeleton, poses, poses.copy(), free, known
        self.goals = np.where(known[:, :, None], targets, 0.0)
        self.was = move(skeleton, poses)
        self.hubs = self.was.positions - np.einsum("fjab,jb->fja", self.was.rotations, skeleton.after)
        self.places, self.rotations = self.was.positions.copy(), self.was.rotations.copy()
        self.turns = rotations_of(skeleton)
        self.carried = _carried(skeleton, self.turns)
        self.hinges = _hinges(skeleton, self.turns, self.carried)
        for joint, parent in enumerate(skeleton.parents):
            hub = self._follow(joint, parent)
            if self.turns[joint] and self.carried[joint]:
                rows = np.flatnonzero(free[:, self.turns[joint]].any(axis=1))
                if len(rows):
                    self._turn(joint, rows, hub[rows])
            self.places[:, joint] = hub + self.rotations[:, joint] @ skeleton.after[joint]

    def _follow(self, joint: int, parent: int) -> Floats:
        """Take the joint along with its parent; its new hub (F, 3)."""
        if parent < 0:
            return self._shift(joint)
        change = self.rotations[:, parent] @ _transposed(self.was.rotations[:, parent])
        self.rotations[:, joint] = change @ self.was.rotations[:, joint]
        return self.places[:, parent] + _apply(change, self.hubs[:, joint] - self.was.positions[:, parent])

    def _shift(self, joint: int) -> Floats:
        """Bring a root, if it is free to move, to its own target; its new hub (F, 3)."""
        group = {c.axis: i for i, c in enumerate(self.skeleton.channels) if c.joint == joint and not c.is_rotation}
        if len(group) < 3 or self.skeleton.after[joint].any():
            return np.asarray(self.hubs[:, joint])
        columns = np.array([group[axis] for axis in range(3)])
        rows = np.flatnonzero(self.free[:, columns].all(axis=1) & self.known[:, joint])
        self.poses[np.ix_(rows, columns)] = self.goals[rows, joint] - self.skeleton.before[joint]
        hub = self.hubs[:, joint].copy()
        hub[rows] = self.goals[rows, joint]
        return np.asarray(hub)

    def _turn(self, joint: int, rows: Ints, hub: Floats) -> None:
        group, tips, frame = self.turns[joint], self.carried[joint], self.skeleton.frames[joint]
        axes = [self.skeleton.channels[i].axis for i in group]
        cells = np.ix_(rows, np.array(group))
        arms = (self.was.positions[rows][:, tips] - self.hubs[rows, joint][:, None]) @ self.was.rotations[rows, joint]
        lines = (self.goals[rows][:, tips] - hub[:, None]) * self.known[rows][:, tips, None]
        own = self.rotations[rows, joint]
        parent = self.skeleton.parents[joint]
        base = (self.rotations[rows, parent] if parent >= 0 else np.eye(3)) @ frame
        if _is_ball(axes) and self.free[cells].all():
            own = _swing(arms @ _transposed(own), lines) @ own
            if joint in self.hinges:
                own = self._twist(joint, rows, hub, own) @ own
            angles = _nearest(axes, _euler(axes, _transposed(base) @ own @ frame), self.start[cells])
        else:
            angles = _turned(axes, self.start[cells], self.free[cells], base, arms @ frame, lines)
            own = base @ _product(axes, angles) @ frame.T
        self.rotations[rows, joint] = own
        self.poses[cells] = angles

    def _twist(self, joint: int, rows: Ints, hub: Floats, own: Floats) -> Floats:
        """The least rotation about the bone that lets the hinge at its end reach its target.

        With bone u, hinge axis h, its target at l from it and its arm k along h, the angle τ solves
        (R_u(τ) h) · l = k, that is B cos τ + C sin τ = -A.
        """
        hinge, channel, end = self.hinges[joint]
        change = own @ _transposed(self.was.rotations[rows, joint])
        bone = _apply(change, self.hubs[rows, hinge] - self.hubs[rows, joint])
        axis = _apply(change, self.was.axes[rows, channel])
        arm = _apply(change, self.was.positions[rows, end] - self.hubs[rows, hinge])
        line = self.goals[rows, end] - hub - bone
        bone = bone / np.maximum(np.linalg.norm(bone, axis=1, keepdims=True), 1e-9)
        along = _dot(axis, bone) * _dot(bone, line)
        a, b, c = along - _dot(axis, arm), _dot(axis, line) - along, _dot(np.cross(bone, axis), line)
        size = np.hypot(b, c)
        clear = self.known[rows, end] & (size > FAINT * np.linalg.norm(line, axis=1))
        half = np.arccos(np.clip(-a / np.where(clear, size, 1.0), -1, 1))
        either = np.arctan2(c, b) + np.stack([half, -half])
        either = (either + np.pi) % (2 * np.pi) - np.pi
        angle = np.where(clear, np.where(np.abs(either[0]) < np.abs(either[1]), either[0], either[1]), 0.0)
        return _about(bone, angle)


def _carried(skeleton: Skeleton, turns: list[list[int]]) -> list[list[int]]:
    """The joints that each joint carries rigidly at a distance: no rotation lies between."""
    found: list[list[int]] = [[] for _ in skeleton.names]
    for joint, parent in enumerate(skeleton.parents):
        holder = joint if skeleton.after[joint].any() else parent
        while holder >= 0 and not turns[holder]:
            holder = skeleton.parents[holder]
        if holder >= 0:
            found[holder].append(joint)
    return found


def _hinges(skeleton: Skeleton, turns: list[list[int]], carried: list[list[int]]) -> dict[int, tuple[int, int, int]]:
    """For each joint that carries nothing but a hinge: the hinge, its channel and the one joint that it carries."""
    found = {}
    for hinge, parent in enumerate(skeleton.parents):
        holder = parent
        while holder >= 0 and not turns[holder]:
            holder = skeleton.parents[holder]
        if holder >= 0 and len(turns[hinge]) == len(carried[hinge]) == len(carried[holder]) == 1:
            found[holder] = (hinge, turns[hinge][0], carried[hinge][0])
    return found


def _transposed(matrices: Floats) -> Floats:
    return np.swapaxes(matrices, -1, -2)


def _apply(matrices: Floats, vectors: Floats) -> Floats:
    return (matrices @ vectors[..., None])[..., 0]


def _swing(arms: Floats, lines: Floats) -> Floats:
    """The smallest rotations (F, 3, 3) that turn arms (F, K, 3) towards lines (F, K, 3)."""
    moment = _transposed(lines) @ arms
    size = np.linalg.norm(moment, axis=(1, 2))
    moment += (1e-6 * size + 1e-9)[:, None, None] * np.eye(3)
    return fit_rotations_by_svd(moment)


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=-1))


def _about(axis: Floats, radians: Floats) -> Floats:
    """Rotations (F, 3, 3) about unit axes (F, 3), by Rodrigues' formula."""
    x, y, z = axis.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sin, cos = np.sin(radians)[:, None, None], np.cos(radians)[:, None, None]
    return np.asarray(np.eye(3) + sin * cross + (1 - cos) * (cross @ cross))


def _product(axes: list[int], angles: Floats) -> Floats:
    """The rotations (F, 3, 3) whose elementary angles are (F, n)."""
    found = np.broadcast_to(np.eye(3), (len(angles), 3, 3))
    for i, axis in enumerate(axes):
        found = found @ turn(axis, angles[:, i])
    return found


def _turned(axes: list[int], angles: Floats, free: Bools, base: Floats, arms: Floats, lines: Floats) -> Floats:
    """Angles (F, n) of which each free one in its turn brings arms (F, K, 3) nearest to lines (F, K, 3)."""
    angles = angles.copy()
    lines = lines @ base
    for i in range(len(axes)):
        before, after = _product(axes[:i], angles[:, :i]), _product(axes[i:], angles[:, i:])
        j, k = (axes[i] + 1) % 3, (axes[i] + 2) % 3
        here, there = arms @ _transposed(after), lines @ before
        sin = (here[..., j] * there[..., k] - here[..., k] * there[..., j]).sum(axis=1)
        cos = (here[..., j] * there[..., j] + here[..., k] * there[..., k]).sum(axis=1)
        size = np.linalg.norm(here, axis=2) * np.linalg.norm(there, axis=2)
        clear = free[:, i] & (np.hypot(sin, cos) > FAINT * size.sum(axis=1))
        angles[:, i] += np.where(clear, np.degrees(np.arctan2(sin, cos)), 0.0)
    return angles


def _euler(axes: list[int], matrices: Floats) -> Floats:
    """Angles (F, 3), degrees, of rotations about three different axes multiplied from the left."""
    i, j, k = axes
    sign = 1 if (j - i) % 3 == 1 else -1
    first = np.arctan2(-sign * matrices[:, j, k], matrices[:, k, k])
    second = np.arcsin(np.clip(sign * matrices[:, i, k], -1, 1))
    third = np.arctan2(-sign * matrices[:, i, j], matrices[:, i, i])
    return np.asarray(np.degrees(np.stack([first, second, third], axis=1)))
