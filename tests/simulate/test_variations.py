"""Variations of a take: what they change is what they name, and all else stays as it was."""

from dataclasses import replace

import numpy as np
import pytest

from mocapclean.geometry.skeleton import forward
from mocapclean.simulate import VARIATIONS, perform, vary
from mocapclean.simulate.variations import FAULTY, RATES, UNCHANGED
from mocapclean.take import Take


@pytest.fixture(scope="module")
def performance():
    return perform("walk", 5.0, 120.0, 3)


@pytest.fixture(scope="module")
def takes(performance):
    """Five seconds of walking, as markers with some gaps and as joints with poses."""
    markers = performance.markers
    trusted = markers.trusted.copy()
    trusted[100:140, 5] = trusted[:30, 7] = False
    gapped = replace(markers, trusted=trusted, positions=np.where(trusted[..., None], markers.positions, np.nan))
    skeleton, poses = performance.bvh, performance.bvh_poses
    positions = forward(skeleton, poses)[0]
    joints = Take(
        positions=positions,
        trusted=np.ones(positions.shape[:2], bool),
        markers=skeleton.names,
        rate=120.0,
        skeleton=skeleton,
        poses=poses,
    )
    return {"markers": gapped, "joints": joints}


def varied(takes, columns, kind, seed=0):
    """A variation of a take that allows it."""
    variation = vary(takes[columns], kind, seed)
    assert variation is not None
    return variation


IMPOSSIBLE = ("50 Hz", "100 Hz")  # of a take at 120 Hz, which has no whole step to them
ALL = pytest.mark.parametrize("kind", [kind for kind in VARIATIONS if kind not in IMPOSSIBLE])
BOTH = pytest.mark.parametrize("columns", ["markers", "joints"])
ELSEWHERE = (*(f"{rate} Hz" for rate in RATES), "pause", "two subjects", "foot locked at the end")
"""Variations in which samples have no exact counterpart in the take."""


@BOTH
def test_a_take_has_no_variation_of_its_own_rate_or_of_an_uneven_one(takes, columns):
    assert all(vary(takes[columns], kind, 0) is None for kind in IMPOSSIBLE)
    at_100 = replace(takes[columns], rate=100.4)
    assert vary(at_100, "100 Hz", 0) is None
    assert vary(at_100, "50 Hz", 0).take.rate == pytest.approx(50.2)
    assert vary(at_100, "30 Hz", 0) is None


@BOTH
@ALL
def test_samples_are_those_of_their_source_unless_faulty(takes, columns, kind):
    take, variation = takes[columns], varied(takes, columns, kind)
    assert variation.take.trusted.shape == variation.faulty.shape == variation.source.shape
    assert np.isfinite(variation.take.positions[variation.take.trusted]).all()
    own = variation.source >= 0
    if kind in ELSEWHERE:
        return
    same = (variation.take.positions == take.positions.reshape(-1, 3)[variation.source]).all(axis=2)
    trusted = take.trusted.ravel()[variation.source]
    np.testing.assert_array_equal(variation.take.trusted[own], trusted[own])
    known = own & variation.take.trusted
    assert (same | variation.faulty)[known].all()
    assert not (same & variation.faulty)[known].any()


@BOTH
@ALL
def test_only_faults_are_faulty(takes, columns, kind):
    variation = varied(takes, columns, kind)
    assert variation.faulty.any() == (kind in FAULTY)
    assert not (variation.faulty & ~variation.take.trusted).any()


@BOTH
@ALL
def test_the_rate_and_the_names_stay(takes, columns, kind):
    take, variation = takes[columns], varied(takes, columns, kind)
    if kind.endswith(" Hz"):
        assert variation.take.rate == pytest.approx(float(kind.split()[0]), rel=0.03)
        duration = len(variation.take.trusted) / variation.take.rate
        assert duration == pytest.approx(min(5.0, 4000 / variation.take.rate), abs=0.1)
    else:
        assert variation.take.rate == take.rate
    markers = variation.take.markers
    assert markers[: len(take.markers)] == take.markers
    assert len(set(markers)) == len(markers)


@ALL
def test_the_seed_decides(takes, kind):
    first, again = varied(takes, "markers", kind, 1), varied(takes, "markers", kind, 1)
    np.testing.assert_array_equal(first.take.positions, again.take.positions)
    np.testing.assert_array_equal(first.take.trusted, again.take.trusted)


def test_other_seeds_have_other_faults(takes):
    assert (varied(takes, "markers", "spike", 1).faulty != varied(takes, "markers", "spike", 2).faulty).any()


def test_names_that_are_taken_stay_unique(takes):
    take = takes["markers"]
    named = replace(
        take, markers=("Floor", "Floor_", f"second:{take.markers[2]}", *take.markers[3:], "x")[: len(take.markers)]
    )
    assert vary(named, "still marker", 0).take.markers[-1] == "Floor__"
    both = vary(replace(named, markers=("second:a", "a", *take.markers[2:])), "two subjects", 0).take.markers
    assert len(set(both)) == 2 * len(take.markers)


def added(takes, columns, kind):
    variation = varied(takes, columns, kind)
    return variation.take, (variation.source < 0).all(axis=0)


@pytest.mark.parametrize("kind", ["still marker", "box at rest"])
def test_things_rest_beside_the_body(takes, kind):
    take, new = added(takes, "markers", kind)
    assert take.positions[:, new].std(axis=0).max() < 0.3
    take, new = added(takes, "joints", kind)
    assert (take.positions[:, new] == take.positions[0, new]).all()


def test_a_cup_is_moved_once(takes):
    take, new = added(takes, "joints", "cup moved once")
    path = take.positions[:, new][:, 0]
    moving = np.flatnonzero(np.linalg.norm(np.diff(path, axis=0), axis=1))
    assert np.linalg.norm(path[-1] - path[0]) == pytest.approx(400.0)
    assert 110 <= moving[-1] - moving[0] <= 120


def test_a_thrown_ball_flies_and_is_lost(takes):
    take, new = added(takes, "joints", "ball thrown")
    seen = take.trusted[:, new][:, 0]
    path = take.positions[:, new][seen, 0]
    acceleration = np.diff(path, 2, axis=0)[-60:] * take.rate**2
    np.testing.assert_allclose(acceleration, [[0.0, 0.0, -9810.0]] * 60, atol=1e-3)
    assert (path[:100] == path[0]).all()
    assert not seen[-1]


@BOTH
@pytest.mark.parametrize(("kind", "n"), [("pose in frame 1", 1), ("pose in frames 1-30", 30)])
def test_a_pose_stands_before_the_motion(takes, columns, kind, n):
    take, variation = takes[columns], varied(takes, columns, kind)
    assert len(variation.take.trusted) == len(take.trusted) + n
    assert ((variation.source >= 0) == (np.arange(len(take.trusted) + n) >= n)[:, None]).all()
    shape = variation.take.positions[0] - np.nanmean(variation.take.positions[0], axis=0)
    first = variation.take.positions[n] - np.nanmean(variation.take.positions[n], axis=0)
    assert np.nanmax(np.linalg.norm(shape - first, axis=1)) > 100.0


def test_joints_have_the_rest_pose_of_their_skeleton(takes):
    variation = varied(takes, "joints", "pose in the last frame")
    skeleton, last = variation.take.skeleton, variation.take.positions[-1]
    offsets = [last[j] - last[p] for j, p in enumerate(skeleton.parents) if p >= 0]
    expected = [skeleton.before[j] for j, p in enumerate(skeleton.parents) if p >= 0]
    np.testing.assert_allclose(offsets, expected, atol=1e-9)


def test_a_foot_is_down_at_the_end(takes):
    variation = varied(takes, "markers", "foot down at the end")
    last = variation.take.positions[-6:]
    speed = np.linalg.norm(last[-1] - last[0], axis=1) * variation.take.rate / 5
    assert np.nanmin(speed) < 100.0
    assert np.nanmedian(speed) > 250.0


def test_standing_is_no_stance(takes):
    standing = takes["joints"].crop(0, 300)
    standing = replace(standing, positions=np.tile(standing.positions[0], (300, 1, 1)))
    assert vary(standing, "foot down at the end", 0) is None


def test_a_pause_is_still_and_no_motion_is_lost(takes):
    variation = varied(takes, "joints", "pause")
    step = np.linalg.norm(np.diff(variation.take.positions, axis=0), axis=2).max(axis=1)
    assert (step == 0.0).sum() == pytest.approx(90, abs=2)
    assert (np.diff(variation.source[:, 0]) >= 0).all()
    assert (np.diff(variation.source[:, 0]) <= len(variation.take.markers)).all()


def test_a_cut_leaps_and_a_loop_repeats(takes):
    leap = np.diff(varied(takes, "markers", "cut").source[:, 0])
    n_markers = len(takes["markers"].markers)
    assert (np.delete(leap, 199) == n_markers).all()
    assert leap[199] == 201 * n_markers
    loop = varied(takes, "markers", "loop")
    np.testing.assert_array_equal(loop.source[:300], loop.source[300:])


def test_two_subjects_are_apart(takes):
    variation, take = varied(takes, "joints", "two subjects"), takes["joints"]
    n = len(take.markers)
    np.testing.assert_array_equal(variation.take.positions[:, :n], take.positions[:450])
    np.testing.assert_array_equal(variation.take.positions[:, n:], take.positions[150:] + np.array([1500.0, 0.0, 0.0]))


def test_interpolation_to_a_higher_rate_keeps_the_samples(takes):
    take, variation = takes["joints"], varied(takes, "joints", "1000 Hz")
    np.testing.assert_allclose(variation.take.positions[::25], take.positions[: 3 * 160 : 3], atol=1e-9)


def test_a_held_limb_holds_several_markers(takes):
    variation = varied(takes, "joints", "limb held")
    held = np.flatnonzero(variation.faulty.any(axis=0))
    frames = np.flatnonzero(variation.faulty.any(axis=1))
    assert len(held) >= 2
    assert len(frames) <= 30
    before = variation.take.positions[frames[0] - 1, held]
    assert (variation.take.positions[frames[0] : frames[-1] + 1, held] == before).all()


def test_a_take_that_is_too_short_has_no_such_variation(takes):
    short = takes["markers"].crop(0, 40)
    assert vary(short, UNCHANGED, 0) is not None
    assert all(vary(short, kind, 0) is None for kind in ("cup moved once", "ball thrown", "pause", "cut", "loop"))
    unseen = replace(takes["markers"], trusted=np.zeros_like(takes["markers"].trusted))
    assert all(vary(unseen, kind, 0) is None for kind in ("still marker", "spike", "limb held", "foot down at the end"))
