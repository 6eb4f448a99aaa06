"""Errors, bone lengths and rigid pairs against plain arithmetic."""

import numpy as np
import pytest

from mocapclean.errors import UsageError
from mocapclean.evaluation import metrics
from mocapclean.geometry.skeleton import Bone, Skeleton
from mocapclean.take import Take
from mocapclean.take.bones import bones_of, check_names, known_bones, rigid_pairs


def test_error_per_coordinate_and_in_3d():
    truth = np.zeros((2, 2, 3))
    positions = truth.copy()
    positions[0, 1] = [3.0, 0.0, 4.0]
    where = np.array([[True, True], [False, False]])
    error = metrics.error(truth, positions, where)
    assert error.samples == 2
    assert error.rmse == pytest.approx((25 / 6) ** 0.5)
    assert error.rmse_3d == pytest.approx((25 / 2) ** 0.5)
    assert error.rmse_3d == pytest.approx(error.rmse * 3**0.5)
    assert error.largest == pytest.approx(5.0)
    assert metrics.error(truth, positions, np.zeros((2, 2), bool)) is None


def test_the_expected_error_is_what_the_error_comes_to(rng):
    sd = np.where(rng.random((4000, 2)) < 0.5, rng.uniform(0.5, 8.0, (4000, 2)), np.nan)
    known = ~np.isnan(sd)
    errors = np.nan_to_num(sd)[..., None] * rng.normal(size=(4000, 2, 3))
    error = metrics.error(errors, np.zeros_like(errors), known)
    assert metrics.expected_error(sd) == pytest.approx(error.rmse_3d, rel=0.03)
    assert metrics.expected_error(sd[:0]) is None
    assert metrics.expected_error(np.full(3, np.nan)) is None


def test_bone_lengths_count_only_frames_with_both_ends():
    positions = np.zeros((3, 2, 3))
    positions[:, 1, 0] = [10.0, 12.0, 99.0]
    known = np.array([[True, True], [True, True], [True, False]])
    ends, reference = np.array([[0, 1]]), np.array([10.0])
    (length,) = metrics.bone_lengths(positions, known, ends, reference)
    assert (length.frames, length.mean, length.sd, length.deviation) == (2, 11.0, 1.0, 2.0)
    assert metrics.skeleton_rmse(positions, known, ends, reference) == pytest.approx(2**0.5)
    (none,) = metrics.bone_lengths(positions, np.zeros_like(known), ends, reference)
    assert (none.frames, none.mean) == (0, None)
    assert metrics.skeleton_rmse(positions, np.zeros_like(known), ends, reference) is None


def test_gaps_are_classed_by_length():
    classes = {name: list(members) for name, members in metrics.by_length([1, 10, 11, 60, 121, 30])}
    assert classes == {"1-10": [0, 1], "11-30": [2, 5], "31-60": [3], "over 120": [4]}


def take_of(positions, markers):
    return Take(positions=positions, trusted=np.ones(positions.shape[:2], bool), markers=markers, rate=100.0)


def test_rigid_pairs_are_found_and_loose_ones_are_not(rng):
    centre = np.cumsum(rng.normal(size=(200, 1, 3)) * 20, axis=0)
    rigid = centre + np.array([[0.0, 0, 0], [100.0, 0, 0], [0, 150.0, 0]])
    loose = np.cumsum(rng.normal(size=(200, 1, 3)) * 20, axis=0)
    take = take_of(np.concatenate([rigid, loose], axis=1), ("A", "B", "C", "L"))
    lengths = {(b.start, b.end): b.length for b in rigid_pairs(take)}
    assert lengths == {
        ("A", "B"): pytest.approx(100.0),
        ("A", "C"): pytest.approx(150.0),
        ("B", "C"): pytest.approx(32500**0.5),
    }
    assert bones_of(take)[0] == "rigid pairs"


def test_a_rigid_pair_tells_how_far_its_length_is_known(rng):
    distance = 200.0 + 2.0 * rng.normal(size=300)
    positions = np.zeros((300, 2, 3))
    positions[:, 1, 0] = distance
    (bone,) = rigid_pairs(take_of(positions, ("A", "B")))
    assert bone.length == pytest.approx(np.median(distance))
    assert bone.spread == pytest.approx(2.0, rel=0.15)
    assert {b.spread for b in known_bones(("hip", "knee"), chain())} == {0.0}


def chain():
    return Skeleton(
        names=("hip", "knee", "ankle"),
        parents=(-1, 0, 1),
        before=np.array([[0.0, 0, 0], [0, -400.0, 0], [0, -380.0, 0]]),
        after=np.zeros((3, 3)),
        frames=np.broadcast_to(np.eye(3), (3, 3, 3)),
        channels=(),
        product=(),
    )


def test_skeleton_bones_match_every_subject_by_bare_name():
    bones = known_bones(("A:hip", "A:knee", "B:knee", "B:ankle", "prop"), chain())
    assert bones == (
        Bone(start="A:hip", end="A:knee", length=400.0),
        Bone(start="B:knee", end="B:ankle", length=380.0),
    )


def test_a_skeleton_without_a_common_name_is_refused():
    check_names(("S:hip",), chain())
    with pytest.raises(UsageError, match="must share names with the take"):
        check_names(("LASI", "RASI"), chain())
