"""The body's frame: hips and neck in a plane, moved with the world, and found again when landmarks are lost."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocapclean.dictionaries.landmarks import place_landmarks, plane_frames, rigidity_weights
from mocapclean.geometry.alignment import carry_points
from mocapclean.geometry.body_frames import BodyFrames

GROUPS = [np.array([k]) for k in range(4)]
TORSO = np.arange(6)


def bodies(rng, n_frames=80):
    """(F, 6, 3): a rigid torso that tumbles smoothly."""
    t = np.linspace(0, 2, n_frames)[:, None]
    turns = Rotation.from_rotvec(np.concatenate([np.sin(t), np.cos(2 * t), t], axis=1))
    rest = rng.normal(scale=200.0, size=(6, 3))
    return np.stack([turns.apply(point) for point in rest], axis=1) + 500 * np.sin(3 * t)[:, None]


def test_plane_and_round_trip(rng):
    positions = bodies(rng)
    frames = plane_frames(positions[:, :4])
    local = frames.to_local(positions)
    assert np.abs(local[:, 0]).max() < 1e-9
    hips, neck = local[:, 2] - local[:, 1], local[:, 3] - local[:, 1]
    assert np.abs(hips[:, 1:]).max() < 1e-9
    assert np.abs(neck[:, 2]).max() < 1e-9
    assert (neck[:, 1] > 0).all()
    assert frames.to_world(local) == pytest.approx(positions, abs=1e-9)
    assert np.linalg.det(frames.axes) == pytest.approx(1.0)


def test_a_turned_world_gives_the_same_body(rng):
    positions, turn = bodies(rng), Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()
    moved = positions @ turn.T + [1e4, -2e3, 7.0]
    plain, other = (plane_frames(p[:, :4]).to_local(p) for p in (positions, moved))
    assert other == pytest.approx(plain, abs=1e-6)


@pytest.mark.parametrize("points", [np.zeros((1, 4, 3)), np.arange(4.0)[None, :, None] * np.ones(3)])
def test_points_that_span_no_plane_still_give_axes(points):
    axes = plane_frames(points).axes[0]
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_lost_landmarks_of_a_rigid_torso_are_where_they_were(rng):
    positions = bodies(rng)
    trusted = np.ones((80, 6), dtype=bool)
    trusted[20:60, [0, 1]] = False
    frames = plane_frames(positions[:, :4])
    model = frames.to_local(positions)
    hidden = np.where(trusted[..., None], positions, np.nan)
    assert place_landmarks(hidden, trusted, GROUPS, TORSO, model) == pytest.approx(positions[:, :4], abs=1.0)
    never = trusted.copy()
    never[:, 0] = False
    assert place_landmarks(hidden, never, GROUPS, TORSO, model)[:, 0] == pytest.approx(positions[:, 0], abs=5.0)


def test_registration_undoes_a_motion_and_weights_decide(rng):
    shape, turn = rng.normal(size=(1, 5, 3)), Rotation.from_rotvec([0.4, 1.0, -2.0]).as_matrix()
    seen = shape @ turn.T + [1.0, 2.0, 3.0]
    assert carry_points(shape, seen, np.ones((1, 5)), shape[:, 0]) == pytest.approx(seen[:, 0])
    seen[0, 4] += 50.0
    weights = np.array([[1.0, 1, 1, 1, 0]])
    assert carry_points(shape, seen, weights, shape[:, 0]) == pytest.approx(seen[:, 0])


def test_what_keeps_its_distance_weighs_most(rng):
    positions = bodies(rng)
    positions[:, 5] += rng.normal(scale=30.0, size=(80, 3))
    weights = rigidity_weights(positions, positions[:, 0])
    assert weights[5] < 1e-3 * weights[1:5].min()


def test_frames_hold_what_they_are_given():
    frames = BodyFrames(np.eye(3)[None], np.ones((1, 3)))
    assert frames.to_local(np.ones((1, 2, 3))) == pytest.approx(0.0)
