"""The step from positions back to joint angles: fit the poses of a take to its changed joints before it is written."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mocapclean.arrays import Bools, Floats, Ints, column_runs
from mocapclean.errors import UsageError
from mocapclean.geometry.skeleton import Skeleton
from mocapclean.take import Finding, Take
from mocapclean.take.posed import joint_positions

TRUSTED_MM = 0.1
"""Millimetres that a fit may move a trusted joint: a promise of the documents (docs/formats.md), chosen by hand."""


def posed(take: Take) -> tuple[Skeleton, Floats]:
    """Return the skeleton and poses of a take; raise UsageError if it carries positions alone."""
    if take.skeleton is None or take.poses is None:
        raise UsageError("positions alone are not a pose. Write this take as .c3d.")
    return take.skeleton, take.poses


def unrounded(poses: Floats) -> Floats:
    """Return the poses themselves, for files that are not bound to the spelling of an earlier one."""
    return poses


def fit_poses(take: Take, spelled: Callable[[Floats], Floats] = unrounded) -> Take:
    """Return the take with poses fitted to its filled and moved joints, and positions that follow from the poses.

    spelled: poses (f, C) to the poses that the file will hold, rounded as its numbers are spelled. A joint that no
    pose brings to its position while all trusted joints stay within 0.1 mm keeps its poses. Such a joint is no longer
    ``filled`` or ``moved``, and a finding of rule "fit" names its frames. Raises UsageError for a take without poses.
    """
    frames = np.flatnonzero(take.changed.any(axis=1))
    if not len(frames):
        return take
    skeleton, before = posed(take)
    wanted, trusted = take.changed[frames], (take.trusted & ~take.changed)[frames]
    poses, fitted = _fit_frames(take, frames, spelled)
    rewritten = (poses != before[frames]) & np.isfinite(poses)
    # Frames whose numbers stay as they were keep the trusted positions that were read, to the last bit.
    untouched = trusted & ~rewritten.any(axis=1, keepdims=True)
    reached = joint_positions(skeleton, poses)
    positions, trust, done = take.positions.copy(), take.trusted.copy(), np.zeros_like(take.filled)
    positions[frames] = np.where(untouched[:, :, None], take.positions[frames], reached)
    trust[frames] &= ~wanted | fitted
    done[frames] = fitted
    all_poses = before.copy()
    all_poses[frames] = np.where(rewritten, poses, before[frames])
    return replace(
        take,
        positions=positions,
        trusted=trust,
        filled=take.filled & done,
        moved=take.moved & done,
        poses=all_poses,
        findings=take.findings + _unfitted(take, take.changed & ~done),
    )


def _fit_frames(take: Take, frames: Ints, spelled: Callable[[Floats], Floats]) -> tuple[Floats, Bools]:
    """Return the poses (f, C) of some frames as they will be spelled, and the joints (f, J) that they fit.

    The fit is given all frames, because the poses around a gap are its start.
    """
    from mocapclean.geometry.inverse_kinematics import fit  # reading, and writing without a fit, need none of it

    skeleton, all_poses = posed(take)
    fixed = take.trusted & ~take.changed
    result = fit(skeleton, all_poses, take.positions, fixed, take.changed, tolerance=TRUSTED_MM)
    before = all_poses[frames]
    after = spelled(result.poses[frames])
    after = np.where(result.changed[frames] & np.isfinite(after), after, before)
    # Rounding may push a trusted joint over the tolerance: such a frame is given up as a whole.
    positions = joint_positions(skeleton, after)
    within = np.linalg.norm(positions - take.positions[frames], axis=2) <= TRUSTED_MM
    kept = np.all(within | ~fixed[frames], axis=1, keepdims=True)
    fitted = result.fitted[frames] & kept & np.isfinite(positions).all(axis=2)
    return np.where(fitted.any(axis=1, keepdims=True), after, before), fitted


def _unfitted(take: Take, left: Bools) -> tuple[Finding, ...]:
    """Return a finding for each run of frames in which a joint (F, J) could not be fitted."""
    return tuple(
        Finding(
            rule="fit",
            level="warning",
            marker=take.markers[joint],
            frames=(start, stop),
            message=f"no joint angles bring it to its filled position and keep all trusted joints within "
            f"{TRUSTED_MM} mm; it is left as it was",
            advice="distrust its neighbours too, or fill with another method",
        )
        for joint, start, stop in column_runs(left)
    )
