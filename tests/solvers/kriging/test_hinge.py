import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.solvers.kriging.hinge import find_ends, hinge_frames
from mocapclean.solvers.kriging.neighbours import NeighbourDistances
from tests.solvers.kriging.batches import training_batch


def leg(rng, n=50):
    """Hip, knee and ankle (n, 3) with a bending knee, in a body that travels and turns, and the body's frames."""
    bend = rng.uniform(0.3, 2.0, n)
    swing = rng.uniform(-0.5, 0.5, n)
    knee = 400 * np.stack([np.sin(swing), 0 * swing, -np.cos(swing)], axis=1)
    shank = 430 * np.stack([-np.sin(bend - swing), 0 * bend, -np.cos(bend - swing)], axis=1)
    turns = Rotation.random(n, random_state=1).as_matrix()
    places = 1000 * rng.normal(size=(n, 3))
    world = [np.einsum("nij,nj->ni", turns, p) + places for p in (0 * knee, knee, knee + shank)]
    return world, BodyFrames(turns.swapaxes(1, 2), places)


def frames_of(ends, lengths, body, joint, n_training):
    """The frames (n) and radii (n,) of one segment, or None where they are not defined."""
    batch = training_batch([n_training], joint[None])
    segment = BodyFrames(body.axes[None], body.origins[None])
    frames, radii, defined = hinge_frames(ends[None], np.array([lengths]), segment, batch)
    return (BodyFrames(frames.axes[0], frames.origins[0]), radii[0]) if defined[0] else None


def test_a_knee_is_fixed_in_its_frame(rng):
    (hip, knee, ankle), body = leg(rng)
    frames, radii = frames_of(np.stack([hip, ankle], axis=1), (400.0, 430.0), body, knee, 20)
    local = frames.to_local(knee[:, None])[:, 0]
    assert np.allclose(local[:, 0], 0.0, atol=1e-6)
    assert np.allclose(local[:, 1], radii)
    assert np.allclose(local[:, 2], 0.0, atol=1e-6)
    assert np.allclose(frames.axes @ frames.axes.swapaxes(1, 2), np.eye(3))
    assert np.allclose(np.linalg.det(frames.axes), 1.0)


def test_only_training_frames_of_the_joint_are_read(rng):
    (hip, knee, ankle), body = leg(rng)
    hidden = knee.copy()
    hidden[20:] = np.nan
    ends = np.stack([hip, ankle], axis=1)
    (one, _), (other, _) = (frames_of(ends, (400.0, 430.0), body, target, 20) for target in (knee, hidden))
    assert np.array_equal(one.axes, other.axes)


@pytest.mark.parametrize("apart", [0.0, 830.0, 2000.0])
def test_ends_that_no_joint_fits_between_give_a_finite_circle(rng, apart):
    (hip, knee, _), body = leg(rng)
    ends = np.stack([hip, hip + np.array([apart, 0.0, 0.0])], axis=1)
    result = frames_of(ends, (400.0, 430.0), body, knee, 50)
    assert result is None or (np.isfinite(result[0].axes).all() and (result[1] >= 8.0).all())


def test_a_joint_on_the_line_has_no_frame(rng):
    turns = np.broadcast_to(np.eye(3), (10, 3, 3))
    ends = np.broadcast_to([[0.0, 0, 0], [0, 0, 800.0]], (10, 2, 3))
    knee = np.broadcast_to([0.0, 0, 400.0], (10, 3))
    assert frames_of(ends, (400.0, 400.0), BodyFrames(turns, ends[:, 0]), knee, 10) is None


def test_the_ends_are_rigid_with_the_joint_and_not_with_each_other(rng):
    (hip, knee, ankle), _ = leg(rng, 200)
    positions = np.stack([hip, knee, ankle, knee + 5000 * rng.normal(size=(200, 3))], axis=1)
    distances = NeighbourDistances.measured(positions, np.ones((200, 4), bool), 2.0, exact=True)
    assert find_ends(distances, 1, np.array([0, 2, 3])) == [0, 1]
    assert find_ends(distances, 1, np.array([0, 3])) == []
