"""Contacts: joints that stand still at one place on both sides of a repaired span, such as feet on the ground.

What stands still before a repaired span, and at the same place after it, most likely stood there all the while. A
repair that moves it breaks the contact. Where the user asks for it, the repaired channels that move it bring it back.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mocapclean.arrays import Bools, Floats, column_runs
from mocapclean.geometry.joint_motion import angles_between, joint_motion
from mocapclean.geometry.skeleton import Skeleton, influence
from mocapclean.take import Take
from mocapclean.take.posed import known_poses, posed, with_poses

_SIDE_SECONDS, _FEWEST_SIDE_FRAMES = 0.1, 3
"""Seconds, and frames at least, on each side in which a joint must stand still. By hand: a stance lasts 0.6 s."""
_STILL = 0.003
"""Distance that counts as standing still, as a part of the body's extent: 5 mm of 1.7 m. Chosen by hand."""
_LEAST_SLACK = 0.0006
"""The same for the distance within which a contact is kept where its noise is less: 1 mm of 1.7 m. Chosen by hand."""
_START_WEIGHT = 1e-4
"""mm² per degree² or mm²: pull of a channel towards its filled value, too weak to move a contact by 0.1 mm."""
_MOST_TURN = 10.0
"""Degrees that a joint may be turned to keep a contact. Chosen by hand: a larger turn is another pose."""


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A joint that stands still at one place around frames start to stop: ``places`` (n, 3) mm, within ``slack`` mm."""

    joint: int
    start: int
    stop: int
    places: Floats
    slack: float

    def is_broken(self, positions: Floats) -> bool:
        """Whether the joint leaves its place in positions (F, J, 3)."""
        apart = np.linalg.norm(positions[self.start : self.stop, self.joint] - self.places, axis=1)
        return bool(apart.max() > self.slack)


def contacts(before: Take, filled: Bools) -> tuple[Contact, ...]:
    """Return the contacts around the spans in which the filled joints (F, J) of a take move other joints.

    before: the take with the trust that detection left.
    """
    skeleton, _, known = known_poses(before)
    places, _ = influence(skeleton)
    repaired = filled[:, before.owners] & ~known
    moved = np.asarray(repaired @ places.T)
    hidden = np.asarray(~known @ places.T)
    extent = float(np.linalg.norm(np.ptp(before.positions[0], axis=0)))
    n_side = max(_FEWEST_SIDE_FRAMES, round(_SIDE_SECONDS * before.rate))
    found = []
    for joint, start, stop in column_runs(moved):
        sides = slice(start - n_side, start), slice(stop, stop + n_side)
        if start < n_side or stop + n_side > len(moved) or any(hidden[side, joint].any() for side in sides):
            continue
        left, right = (before.positions[side, joint] for side in sides)
        centre = np.median(np.concatenate([left, right]), axis=0)
        spread = float(np.linalg.norm(np.concatenate([left, right]) - centre, axis=1).max())
        if spread <= _STILL * extent:
            share = np.arange(1, stop - start + 1)[:, None] / (stop - start + 1)
            line = left[-1] + share * (right[0] - left[-1])
            slack = max(spread, _LEAST_SLACK * extent)
            found.append(Contact(joint=joint, start=start, stop=stop, places=line, slack=slack))
    return tuple(found)


def broken(after: Take, around: Sequence[Contact]) -> tuple[Contact, ...]:
    """Return those of some contacts that a repaired take breaks."""
    return tuple(contact for contact in around if contact.is_broken(after.positions))


def kept(before: Take, after: Take, around: Sequence[Contact]) -> Take:
    """Return the repaired take with its repaired channels turned so that broken contacts are kept, where they can be.

    A span in which a joint would have to turn by more than 10 degrees stays as it is.
    """
    from mocapclean.geometry.inverse_kinematics.least_squares import least_squares

    lost = broken(after, around)
    if not lost:
        return after
    skeleton, filled = posed(after)
    _, _, known = known_poses(before)
    places, _ = influence(skeleton)
    wanted, targets = np.zeros_like(after.trusted), after.positions.copy()
    for contact in lost:
        wanted[contact.start : contact.stop, contact.joint] = True
        targets[contact.start : contact.stop, contact.joint] = contact.places
    free = (after.filled[:, after.owners] & ~known) & np.asarray(wanted @ places)
    frames = np.flatnonzero(free.any(axis=1))
    poses = filled.copy()
    poses[frames] = least_squares(
        skeleton,
        poses[frames],
        free[frames],
        wanted[frames],
        np.zeros_like(wanted[frames]),
        targets[frames],
        np.full((len(frames), poses.shape[1]), _START_WEIGHT),
    )
    return with_poses(after, np.where(_turned_too_far(skeleton, filled, poses, free), filled, poses))


def _turned_too_far(skeleton: Skeleton, before: Floats, after: Floats, free: Bools) -> Bools:
    """Return the free channels (F, C) of runs of frames in which a joint turns by more than the limit."""
    finite = np.isfinite(before)
    rotations = [joint_motion(skeleton, poses, finite).rotations for poses in (before, after)]
    frames = np.asarray((angles_between(*rotations) > _MOST_TURN).any(axis=1))
    refused = np.zeros_like(free)
    for channel, start, stop in column_runs(free):
        refused[start:stop, channel] = frames[start:stop].any()
    return refused
