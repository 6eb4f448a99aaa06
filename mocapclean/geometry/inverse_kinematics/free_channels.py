"""Which channels of a skeleton inverse kinematics may change to bring a joint to its target.

A joint is brought to a place by the rotations of its ancestors. Each of these ancestors carries other subtrees along,
so the first rotations of those subtrees are free too and turn them back.
"""

import numpy as np

from mocapclean.arrays import Bools
from mocapclean.geometry.euler import rotations_of, shifts_of
from mocapclean.geometry.skeleton import Skeleton

PLACING_FREEDOMS = 3
"""Rotations that bring the end of a chain to any point within reach: a point has three coordinates."""
HOLDING_FREEDOMS = 6
"""Rotations that hold a subtree in place and orientation while its parent turns: a rigid body has six freedoms."""


def channels_to_reach(skeleton: Skeleton, extra: int) -> Bools:
    """Return for each joint the channels (J, C) that bring it to a place and hold everything around it.

    extra: degrees of freedom beyond those that suffice, for chains that are bent badly or limited.
    """
    return _ChannelSearch(skeleton, extra).reach


class _ChannelSearch:
    """The search for the free channels of each joint.

    turns, shifts: the rotation and position channels of each joint. children: the joints below each joint. reach:
    (J, C) bool, the result.
    """

    def __init__(self, skeleton: Skeleton, extra: int) -> None:
        self.skeleton, self.extra = skeleton, extra
        self.turns, self.shifts = rotations_of(skeleton), shifts_of(skeleton)
        self.children: list[list[int]] = [[] for _ in skeleton.names]
        for joint, parent in enumerate(skeleton.parents):
            if parent >= 0:
                self.children[parent].append(joint)
        self.reach = np.zeros((len(skeleton.names), len(skeleton.channels)), dtype=bool)
        for joint, row in enumerate(self.reach):
            self._free_for(joint, row)

    def _free_for(self, joint: int, row: Bools) -> None:
        """Set in a row (C,) the channels that bring one joint to a place."""
        lead = self._coincident_ancestor(joint)
        row[self.shifts[lead]] = True
        chain = self._chain(lead, PLACING_FREEDOMS + self.extra)
        if not chain:  # a root: it moves by its shifts, and all below it stays in place
            self._free_below(lead, HOLDING_FREEDOMS + self.extra, row)
        for node in chain:
            row[self.turns[node]] = True
            # Subtrees off the chain are turned back: in place where they start at the joint itself, else in direction.
            for child in set(self.children[node]).difference(chain):
                freedoms = HOLDING_FREEDOMS if lead in (node, child) else PLACING_FREEDOMS
                self._free_below(child, freedoms + self.extra, row)

    def _free_below(self, joint: int, freedoms: int, row: Bools) -> None:
        """Set the channels of a joint and, until there are enough freedoms on every path, of those below it."""
        row[self.turns[joint] + (self.shifts[joint] if self.extra else [])] = True
        if freedoms > len(self.turns[joint]):
            for child in self.children[joint]:
                self._free_below(child, freedoms - len(self.turns[joint]), row)

    def _coincident_ancestor(self, joint: int) -> int:
        """Return the joint itself, or the highest ancestor that is always at the same place."""
        skeleton = self.skeleton
        while skeleton.parents[joint] >= 0:
            if self.shifts[joint] or skeleton.before[joint].any() or skeleton.after[joint].any():
                break
            joint = skeleton.parents[joint]
        return joint

    def _chain(self, joint: int, freedoms: int) -> list[int]:
        """Return the joints, going up, whose rotations move this joint, until there are enough freedoms."""
        # A bone after the joint (ASF) is moved by the joint's own rotations, an offset before it (BVH) is not.
        node = joint if self.skeleton.after[joint].any() else self.skeleton.parents[joint]
        chain = []
        while node >= 0 and freedoms > 0:
            chain.append(node)
            freedoms -= len(self.turns[node])
            node = self.skeleton.parents[node]
        return chain
