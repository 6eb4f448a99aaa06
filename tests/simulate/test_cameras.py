"""Occlusion by ray casting: what the cameras around a take see."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mocapclean.errors import UsageError
from mocapclean.geometry.occluders import Box, Capsules, Cylinder, point_distances
from mocapclean.simulate import occlude_by_cameras, perform, prop
from mocapclean.simulate.cameras import Cameras, body_of, camera_ring, seen
from tests import commands


@pytest.fixture(scope="module")
def take():
    return perform("boxing", 2.0, 60.0, 3).markers


def looking_at(places, point):
    places = np.asarray(places, dtype=float)
    axes = point - places
    return Cameras(places, axes / np.linalg.norm(axes, axis=1, keepdims=True))


def ring(take, n):
    """Cameras so far away that all of the take is in their fields."""
    middle = take.positions.mean(axis=(0, 1))
    turns = np.linspace(0.0, 2 * np.pi, n, endpoint=False)
    offsets = np.stack([np.cos(turns), np.sin(turns), np.full(n, 0.2)], axis=1)
    return looking_at(middle + 9000.0 * offsets, middle)


def first_cameras(cameras, n):
    return Cameras(cameras.places[:n], cameras.axes[:n])


def test_without_a_body_everything_is_seen_and_with_one_not(take):
    assert seen(ring(take, 5), take.positions, []).all()
    with_body = seen(ring(take, 5), take.positions, [body_of(take)])
    assert 0.3 < with_body.mean() < 1.0


def test_more_cameras_never_see_less(take):
    cameras, body = camera_ring(take, np.random.default_rng(1), 10), [body_of(take)]
    views = [seen(first_cameras(cameras, n), take.positions, body) for n in (2, 4, 7, 10)]
    for fewer, more in pairwise(views):
        assert not (fewer & ~more).any()
        assert fewer.sum() < more.sum()


def test_more_things_never_show_more(take):
    cameras = camera_ring(take, np.random.default_rng(1), 8)
    corner = take.positions.min(axis=(0, 1))
    wall = Box(low=corner - 800.0, high=corner + np.array([9000.0, 400.0, 9000.0]))
    alone, beside = (seen(cameras, take.positions, [body_of(take), *props]) for props in ([], [wall]))
    assert not (beside & ~alone).any()
    assert beside.sum() < alone.sum()


def test_a_closed_room_hides_all(take):
    low, high = take.positions.min(axis=(0, 1)) - 10.0, take.positions.max(axis=(0, 1)) + 10.0
    missing = occlude_by_cameras(take, np.random.default_rng(0), 12, [Box(low=low, high=high)])
    assert missing.all()


def test_two_cameras_give_a_position_only_at_a_useful_angle():
    point = np.zeros((1, 1, 3))

    def is_seen(degrees, out_of_sight=0.0):
        angle = np.radians(degrees)
        places = 3000.0 * np.array([[1.0, 0.0, 0.0], [np.cos(angle), np.sin(angle), 0.0]])
        cameras = looking_at(places, np.array([0.0, 0.0, out_of_sight]))
        return bool(seen(cameras, point, [])[0, 0])

    assert [is_seen(degrees) for degrees in (5, 19, 21, 90, 159, 161, 180)] == [0, 0, 1, 1, 1, 0, 0]
    assert is_seen(90, out_of_sight=1000.0)
    assert not is_seen(90, out_of_sight=1600.0)


def test_a_marker_hides_behind_its_own_segment():
    # Four markers around the axis of a limb, which hides the one behind it from cameras in front.
    around = 50.0 * np.array([[1.0, 0, 0], [0, 1.0, 0], [-1.0, 0, 0], [0, -1.0, 0]])
    take = perform("walk", 1.0, 60.0, 0).markers.select(np.arange(4))
    take = replace(take, positions=np.broadcast_to(around, take.positions.shape))
    sides = np.radians([-20.0, 20.0])
    in_front = 3000.0 * np.stack([np.cos(sides), np.sin(sides), np.zeros(2)], axis=1)
    views = seen(looking_at(in_front, np.zeros(3)), take.positions, [body_of(take)])
    assert views[:, 0].all()
    assert not views[:, 2].any()


def test_no_marker_is_inside_the_body(take):
    body = body_of(take)
    squared = point_distances(take.positions, body.ends[:, :, 0], body.ends[:, :, 1])
    assert (np.sqrt(squared) > body.radii[:, None]).all()


def test_only_trusted_samples_count_and_are_lost(take):
    trusted = take.trusted.copy()
    trusted[10:40, 3:9] = False
    trusted[:, 20] = False
    one = replace(take, trusted=trusted)
    moved = np.where(trusted[..., None], take.positions, np.random.default_rng(0).normal(0, 1e4, take.positions.shape))
    lost = occlude_by_cameras(one, np.random.default_rng(5), 6)
    np.testing.assert_array_equal(lost, occlude_by_cameras(replace(one, positions=moved), np.random.default_rng(5), 6))
    assert lost.any()
    assert not (lost & ~trusted).any()
    nobody = replace(take, trusted=np.zeros_like(trusted))
    assert not occlude_by_cameras(nobody, np.random.default_rng(5), 6).any()


@pytest.mark.parametrize("up", [1, 2])
def test_cameras_stand_above_the_floor_and_around_the_volume(take, up):
    positions = take.positions[..., [1, 2, 0]] if up == 1 else take.positions
    turned = replace(take, positions=positions)
    places = camera_ring(turned, np.random.default_rng(2), 8).places
    low, high = positions.min(axis=(0, 1)), positions.max(axis=(0, 1))
    heights = places[:, up] - low[up]
    assert (heights > 500.0).all()
    assert (heights < 3000.0).all()
    across = [axis for axis in range(3) if axis != up]
    assert ((places < low) | (places > high))[:, across].any(axis=1).all()


@pytest.mark.parametrize("n", [0, 1, 65, 2.5])
def test_a_number_of_cameras_that_cannot_be_is_refused(take, n):
    with pytest.raises(UsageError, match="number of cameras"):
        occlude_by_cameras(take, np.random.default_rng(0), n)


def test_props_are_read_from_text():
    box = prop("box:100,0,0,0,50,900")
    assert isinstance(box, Box)
    np.testing.assert_array_equal([box.low, box.high], [[0, 0, 0], [100, 50, 900]])
    cylinder = prop("cylinder:0,0,0,0,0,800,300")
    assert isinstance(cylinder, Cylinder)
    assert cylinder.radius == 300.0
    capsule = prop("capsule:0,0,0,0,0,800,300")
    assert isinstance(capsule, Capsules)
    assert capsule.blocks(np.array([2000.0, 0, 400.0]), np.array([[[-2000.0, 0, 400.0]]])).all()


@pytest.mark.parametrize(
    "text",
    [
        *("", "box", "box:1,2,3", "cone:0,0,0,1,1,1,1", "box:0,0,0,1,1,x", "box:0,0,0,1,1,nan", "box:0,0,0,1,1,0"),
        *("cylinder:0,0,0,0,0,0,5", "capsule:0,0,0,0,0,9,0"),
    ],
)
def test_a_prop_that_cannot_be_is_refused(text):
    with pytest.raises(UsageError, match="Got"):
        prop(text)


def test_the_command_casts_rays(tmp_path):
    arguments = ("simulate", "--motion", "boxing", "--seconds", "1", "--rate", "60", "--out-dir", tmp_path)
    code, _, err = commands.run(*arguments, "--occlusion", "cameras", "--cameras", "5", "--prop", "box:0,0,0,9,9,9")
    assert (code, err) == (0, "")
    assert (tmp_path / "boxing.c3d").exists()
    for wrong in (("--cameras", "5"), ("--prop", "box:0,0,0,9,9,9"), ("--occlusion", "cameras", "--missing", "0.1")):
        code, _, err = commands.run(*arguments, "--overwrite", *wrong)
        assert code == 2
        assert "must be left out" in err
