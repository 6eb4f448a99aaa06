"""Draw repaired spans of skeletons: the damaged take, the repaired one and the truth, side by side and as curves.

    python benchmarks/joint_pictures.py TAKE [TAKE ...] -o docs/images/joints.png

Each take loses one joint for 20 frames in the middle, or has a pop of 45 degrees there, in turn. The row of a take has
stick figures of three frames of the span, damaged (red), repaired (blue) and true (black), and the joint's angle to its
first true rotation. Needs matplotlib.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt

import mocapclean
from mocapclean.geometry.joint_motion import angles_between, joint_motion
from mocapclean.take.posed import posed_take

LENGTH = 20  # frames of a span without numbers
POP_DEGREES = 45.0
BESIDE = 25  # frames that the curves show on each side
LEAST_SPEED = 20.0  # degrees per second: a joint that moves


def damaged(truth, joint, start, stop, pops):
    """The take with one joint damaged: without numbers, or turned in one frame."""
    poses = truth.poses.copy()
    channels = [i for i, c in enumerate(truth.skeleton.channels) if c.joint == joint and c.is_rotation]
    if pops:
        poses[start, channels[0]] += POP_DEGREES
    else:
        poses[start:stop, channels] = np.nan
    return posed_take(truth.skeleton, poses, truth.rate)


def draw(axes, path, pops):
    """Draw the row of one take."""
    truth = mocapclean.read(path)
    motion = joint_motion(truth.skeleton, truth.poses, truth.known)
    speeds = angles_between(motion.rotations[1:], motion.rotations[:-1]).mean(axis=0) * truth.rate
    parents = np.bincount([p for p in truth.skeleton.parents if p >= 0], minlength=len(speeds)) > 0
    moving = np.flatnonzero((speeds > LEAST_SPEED) & motion.turns & parents)
    joint = int(moving[len(moving) // 2])
    start = len(truth.poses) // 2
    stop = start + (1 if pops else LENGTH)
    given = damaged(truth, joint, start, stop, pops)
    after = mocapclean.fill(mocapclean.detect(given)).take
    takes = {"damaged": (given, "tab:red"), "repaired": (after, "tab:blue"), "truth": (truth, "black")}
    middle = (start + stop - 1) // 2
    for axis, frame in zip(axes[:3], (start, middle, stop - 1), strict=True):
        for place, (take, colour) in enumerate(takes.values()):
            stick(axis, take, frame, colour, place)
        axis.set_title(f"frame {frame + 1}", fontsize=8)
        axis.set_axis_off()
        axis.set_aspect("equal")
    frames = np.arange(max(0, start - BESIDE), min(len(truth.poses), stop + BESIDE))
    for name, (take, colour) in takes.items():
        own = joint_motion(take.skeleton, take.poses, np.isfinite(take.poses)).rotations[:, joint]
        angle = angles_between(motion.rotations[frames[0], joint], own[frames])
        known = np.isfinite(take.poses[frames][:, take.owners == joint]).all(axis=1)
        axes[3].plot(frames + 1, np.where(known, angle, np.nan), color=colour, label=name, linewidth=1)
    kind = f"turned by {POP_DEGREES:g} degrees" if pops else f"{LENGTH} frames without numbers"
    axes[3].set_title(f"{path.stem[-28:]}: {truth.markers[joint]}, {kind}; degrees", fontsize=8)
    axes[3].legend(fontsize=7)


def stick(axis, take, frame, colour, place):
    """Draw a skeleton in one frame, seen from the front, beside the others."""
    positions = take.positions[frame]
    size = np.linalg.norm(np.ptp(positions, axis=0))
    x = positions[:, 0] - positions[0, 0] + place * 0.8 * size
    for joint, parent in enumerate(take.skeleton.parents):
        if parent >= 0:
            axis.plot(x[[joint, parent]], positions[[joint, parent], 1], color=colour, linewidth=1)


def main():
    """Draw a picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("takes", nargs="+", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    shape = {"figsize": (13, 2.6 * len(given.takes)), "width_ratios": [1, 1, 1, 2.2], "squeeze": False}
    figure, rows = plt.subplots(len(given.takes), 4, **shape)
    for number, (row, path) in enumerate(zip(rows, given.takes, strict=True)):
        draw(row, path, pops=number % 2 == 1)
    figure.tight_layout()
    figure.savefig(given.output, dpi=80)


if __name__ == "__main__":
    main()
