"""Solids that block views, against dense sampling of the line of sight."""

import numpy as np
import pytest

from mocapclean.geometry.occluders import Box, Capsules, Cylinder, point_distances, segment_distances

SAMPLES = 1200  # of a line of sight
FEW = 150  # of the axis of a capsule
CAMERA = np.array([3000.0, -2000.0, 1500.0])


def along(start, stop, n=SAMPLES):
    """Points (..., n, 3) on segments, both ends among them."""
    share = np.linspace(0.0, 1.0, n)[:, None]
    return start + share * (np.asarray(stop) - start)[..., None, :]


def to_segment(points, first, second):
    """Distances of points (n, 3) from one segment, by sampling it."""
    return np.linalg.norm(points[:, None] - along(first, second, FEW)[None], axis=2).min(axis=1)


def special_segments(rng):
    """Segments (4, n, 3) of all kinds: at random, parallel, of one line, crossing, sharing an end, and points."""
    a, b, c, d = rng.normal(0.0, 500.0, (4, 40, 3))
    c[:5], d[:5] = a[:5] + 30.0, b[:5] + 30.0
    c[5:10], d[5:10] = a[5:10] + 2 * (b - a)[5:10], a[5:10] + 3 * (b - a)[5:10]
    middle = (a[10:15] + b[10:15]) / 2
    d[10:15] = 2 * middle - c[10:15]
    c[15:20] = b[15:20]
    d[20:25] = c[20:25]
    b[25:28] = a[25:28]
    b[28:30], d[28:30] = a[28:30], c[28:30]
    return a, b, c, d


def test_distances_of_segments_are_those_of_dense_samples(rng):
    a, b, c, d = special_segments(rng)
    found = np.sqrt(segment_distances(a, b, c, d))
    for k in range(len(a)):
        spacing = (np.linalg.norm(d[k] - c[k]) + np.linalg.norm(b[k] - a[k])) / FEW
        sampled = to_segment(along(a[k], b[k], FEW), c[k], d[k]).min()
        assert sampled - spacing <= found[k] <= sampled + 1e-6, k
    np.testing.assert_allclose(found, np.sqrt(segment_distances(c, d, a, b)), atol=1e-5)


def test_distances_of_points_are_those_of_dense_samples(rng):
    points, (first, second) = rng.normal(0.0, 500.0, (3, 7, 3)), rng.normal(0.0, 500.0, (2, 3, 4, 3))
    second[0, 0] = first[0, 0]
    found = np.sqrt(point_distances(points, first, second))
    for frame in range(3):
        for k in range(4):
            sampled = to_segment(points[frame], first[frame, k], second[frame, k])
            np.testing.assert_allclose(found[frame, :, k], sampled, atol=6.0)
            assert (found[frame, :, k] <= sampled + 1e-6).all()


def depth_in_capsules(points, capsules, frame):
    """How deep (n,) points are inside any of the capsules of a frame; negative outside."""
    ends = capsules.ends[frame if len(capsules.ends) > 1 else 0]
    radii = capsules.radii[frame if len(capsules.radii) > 1 else 0]
    return np.max([r - to_segment(points, *e) for e, r in zip(ends, radii, strict=True)], axis=0)


def depth_in_box(points, box, frame):
    return np.minimum(points - box.low, box.high - points).min(axis=1)


def depth_in_cylinder(points, cylinder, frame):
    axis = (cylinder.second - cylinder.first) / np.linalg.norm(cylinder.second - cylinder.first)
    height = (points - cylinder.first) @ axis
    aside = np.linalg.norm(points - cylinder.first - height[:, None] * axis, axis=1)
    length = np.linalg.norm(cylinder.second - cylinder.first)
    return np.min([height, length - height, cylinder.radius - aside], axis=0)


def solids(rng):
    moving = rng.normal(0.0, 400.0, (3, 3, 2, 3))
    return [
        (Capsules(ends=moving, radii=rng.uniform(50.0, 200.0, (3, 3))), depth_in_capsules),
        (Capsules(ends=moving[:1], radii=np.full((1, 3), 120.0)), depth_in_capsules),
        (Box(low=np.array([-300.0, -200.0, -400.0]), high=np.array([100.0, 250.0, 500.0])), depth_in_box),
        (
            Cylinder(first=np.array([0.0, 100.0, -300.0]), second=np.array([200.0, -100.0, 300.0]), radius=250.0),
            depth_in_cylinder,
        ),
    ]


@pytest.mark.parametrize("kind", range(4))
def test_a_view_is_blocked_where_a_sample_of_it_is_inside(rng, kind):
    solid, depth_of = solids(rng)[kind]
    points = rng.normal(0.0, 700.0, (3, 25, 3))
    blocked = solid.blocks(CAMERA, points)
    assert 0 < blocked.mean() < 1
    step = 3.0  # mm, more than the distance of two samples
    for frame in range(3):
        for marker in range(25):
            deepest = depth_of(along(CAMERA, points[frame, marker]), solid, frame).max()
            if abs(deepest) > step:
                assert blocked[frame, marker] == (deepest > 0), (frame, marker, deepest)


def test_views_along_an_axis_meet_boxes_and_cylinders_that_they_cross():
    box = Box(low=np.zeros(3), high=np.full(3, 100.0))
    cylinder = Cylinder(first=np.zeros(3), second=np.array([0.0, 0.0, 100.0]), radius=50.0)
    camera = np.array([20.0, 20.0, 1000.0])
    points = np.array([[[20.0, 20.0, -50.0], [20.0, 20.0, 150.0], [20.0, 20.0, 50.0], [20.0, 700.0, 1000.0]]])
    np.testing.assert_array_equal(box.blocks(camera, points), [[True, False, True, False]])
    np.testing.assert_array_equal(cylinder.blocks(camera, points), [[True, False, True, False]])


def test_a_capsule_that_is_not_known_blocks_nothing():
    ends = np.array([[[[-500.0, 0.0, 0.0], [500.0, 0.0, 0.0]]]] * 2)
    ends[1, 0, 0] = np.nan
    points = np.array([[[-3000.0, 2000.0, -1500.0]]] * 2)
    blocked = Capsules(ends=ends, radii=np.full((2, 1), 100.0)).blocks(CAMERA, points)
    np.testing.assert_array_equal(blocked, [[True], [False]])
