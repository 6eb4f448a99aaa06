"""Prediction: rotations of segments against the singular value decomposition, rigid bodies, and steps."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocapclean.detection.prediction import affected, carried, complete, predict
from mocapclean.geometry.alignment import align_shapes
from mocapclean.geometry.distances import rigidity


def kabsch(shape, seen, weights):
    """The rotations by the singular value decomposition, one frame after the other."""
    share = weights / weights.sum()
    turns = []
    for frame in seen:
        product = (share[:, None] * (frame - share @ frame)).T @ (shape - share @ shape)
        left, _, right = np.linalg.svd(product)
        left[:, -1] *= np.sign(np.linalg.det(left @ right))
        turns.append(left @ right)
    return np.array(turns)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), n_points=st.integers(3, 8), noise=st.sampled_from([0.0, 1.0, 30.0]))
def test_rotations_agree_with_the_svd(seed, n_points, noise):
    rng = np.random.default_rng(seed)
    shape, weights = 100 * rng.normal(size=(n_points, 3)), rng.uniform(0.5, 2.0, n_points)
    turns = Rotation.random(20, random_state=seed).as_matrix()
    seen = shape @ turns.swapaxes(1, 2) + rng.normal(size=(20, 1, 3)) * 500
    seen = seen + rng.normal(size=seen.shape) * noise
    turned, middles = align_shapes(shape.T[:, None], np.moveaxis(seen, 2, 0)[:, None], weights[None])
    rotations, centres = np.moveaxis(turned[:, :, 0], 2, 0), middles[:, 0].T
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(centres, np.einsum("k,fkc->fc", weights / weights.sum(), seen))
    spread = np.linalg.svd(shape - shape.mean(axis=0), compute_uv=False)
    if spread[1] > 20 + 2 * noise:
        np.testing.assert_allclose(rotations, kabsch(shape, seen, weights), atol=1e-5)


def body(rng, n_frames=300, n_markers=8):
    """A rigid body that turns and travels: positions (F, M, 3)."""
    shape = rng.normal(size=(n_markers, 3)) * 150
    t = np.arange(n_frames) / 40
    turns = Rotation.from_euler("xyz", np.stack([np.sin(t), 0.5 * t, np.cos(0.7 * t)], axis=1)).as_matrix()
    return shape @ turns.swapaxes(1, 2) + np.stack([300 * t, 50 * np.sin(t), 0 * t], axis=1)[:, None]


def test_a_rigid_body_predicts_its_points(rng):
    positions = body(rng)
    usable = np.ones(positions.shape[:2], bool)
    prediction = predict(positions, usable, rigidity(positions, usable))
    assert prediction.predicted.all()
    np.testing.assert_allclose(prediction.positions, positions, atol=1e-3)
    turned = (prediction.rotation @ prediction.residual[..., None])[..., 0] + prediction.positions
    np.testing.assert_allclose(turned, positions, atol=1e-9)


def test_samples_that_are_not_usable_are_not_read_and_are_completed(rng):
    positions = body(rng)
    usable = rng.random(positions.shape[:2]) > 0.05
    usable[100:140, 2] = False
    low, high = (np.where(usable[..., None], positions, junk) for junk in (-1e6, 1e6))
    done = complete(low, usable, rigidity(low, usable)).filled
    np.testing.assert_array_equal(done, complete(high, usable, rigidity(high, usable)).filled)
    np.testing.assert_array_equal(done[usable], positions[usable])
    assert np.abs(done - positions)[100:140, 2].max() < 5.0


def test_a_step_is_found_at_its_frame_and_with_its_size(rng):
    positions = body(rng) + rng.normal(size=(300, 8, 3))
    usable = np.ones(positions.shape[:2], bool)
    steady = predict(positions, usable, rigidity(positions, usable), slide=20)
    assert max((step.score for step in steady.steps), default=0.0) < 8.0
    offset = np.array([12.0, -9.0, 14.0])
    positions[180:, 4] += (steady.rotation[180:, 4] @ offset[:, None])[..., 0]
    prediction = predict(positions, usable, rigidity(positions, usable), slide=20)
    step = max(prediction.steps, key=lambda step: step.score)
    assert (step.marker, abs(step.start - 180) <= 2) == (4, True)
    assert step.score > 20.0
    assert abs(np.linalg.norm(step.offset) - np.linalg.norm(offset)) < 3.0


def test_a_slide_leads_to_a_step_of_its_size(rng):
    positions = body(rng) + rng.normal(size=(300, 8, 3))
    usable = np.ones(positions.shape[:2], bool)
    turns = predict(positions, usable, rigidity(positions, usable)).rotation[:, 4]
    share = np.clip((np.arange(300) - 150) / 30, 0.0, 1.0)[:, None]
    positions[:, 4] += (turns @ (share * [12.0, -9.0, 14.0])[..., None])[..., 0]
    prediction = predict(positions, usable, rigidity(positions, usable), slide=30)
    step = max(prediction.steps, key=lambda step: step.score)
    assert (step.marker, 140 <= step.start <= 190) == (4, True)
    assert abs(np.linalg.norm(step.offset) - np.linalg.norm([12.0, -9.0, 14.0])) < 3.0


def test_a_step_that_the_samples_of_one_side_contradict_does_not_count(rng):
    positions = body(rng) + 0.2 * rng.normal(size=(300, 8, 3))
    usable = np.ones(positions.shape[:2], bool)
    positions[:32, 4] += 150 * np.sin(np.arange(32) / 6)[:, None] * [0.0, 0.6, 0.8]
    prediction = predict(positions, usable, rigidity(positions, usable), slide=20)
    assert all(step.marker != 4 for step in prediction.steps)


def test_a_lonely_marker_is_not_predicted(rng):
    positions = body(rng, n_markers=3)
    usable = np.ones(positions.shape[:2], bool)
    prediction = predict(positions, usable, rigidity(positions, usable))
    assert not prediction.predicted.any()


def test_a_marker_is_predicted_alike_among_others_and_alone(rng):
    positions = body(rng) + rng.normal(size=(300, 8, 3))
    positions[200:, 4] += 25.0
    usable = np.ones(positions.shape[:2], bool)
    usable[:170, 1], usable[::3, 2], usable[40:, 5] = False, False, False
    rigid = rigidity(positions, usable)
    together = predict(positions, usable, rigid, slide=20)
    for marker in range(8):
        alone = predict(positions, usable, rigid, slide=20, only=np.arange(8) == marker)
        np.testing.assert_allclose(alone.residual[:, marker], together.residual[:, marker], atol=1e-7)
        np.testing.assert_allclose(alone.positions[:, marker], together.positions[:, marker], atol=1e-7)
        (one,), (other,) = (
            [step for step in prediction.steps if step.marker == marker] or [None] for prediction in (alone, together)
        )
        assert (one is None) == (other is None)
        assert one is None or (one.start == other.start and np.isclose(one.score, other.score, rtol=1e-3))


def test_markers_that_never_move_have_no_steps(rng):
    positions = np.repeat(rng.normal(size=(1, 8, 3)) * 150, 200, axis=0)
    usable = np.ones(positions.shape[:2], bool)
    assert predict(positions, usable, rigidity(positions, usable), slide=20).steps == ()


def test_a_slide_may_be_longer_than_any_take(rng):
    positions = body(rng)
    usable = np.ones(positions.shape[:2], bool)
    predict(positions, usable, rigidity(positions, usable), slide=10**40)


def test_what_has_not_changed_is_predicted_as_before(rng):
    positions = body(rng, n_markers=26)
    positions[:, 13:] += [3000.0, 0.0, 0.0]
    positions[:, 25] = 2000.0 + np.cumsum(rng.normal(size=(300, 3)), axis=0)
    positions = positions + rng.normal(size=positions.shape)
    usable = rng.random(positions.shape[:2]) > 0.02
    rigid, attached = rigidity(positions, usable), np.arange(26) != 25
    first = complete(positions, usable, rigid, attached)
    before = predict(first.filled, usable, rigid, slide=20, only=attached)
    # A marker of the one body and the lonely marker change; the other body does not.
    positions, usable = positions.copy(), usable.copy()
    positions[150:, 3] += 30.0
    positions[60:, 25] += 50.0
    usable[40:60, 3] = False
    then = complete(positions, usable, rigid, attached, first)
    kept = ~affected(first.filled, first.usable, then.filled, usable, rigid)
    assert 0 < kept.sum() < 25
    assert not kept[[3, 25]].any()
    done = predict(then.filled, usable, rigid, slide=20, only=attached, known=(before, kept))
    anew = complete(positions, usable, rigid, attached)
    expected = predict(anew.filled, usable, rigid, slide=20, only=attached)
    np.testing.assert_allclose(then.filled, anew.filled, atol=1e-7)
    for part in ("positions", "residual", "rotation"):
        np.testing.assert_allclose(getattr(done, part), getattr(expected, part), atol=1e-6)
    np.testing.assert_array_equal(done.predicted, expected.predicted)
    assert [(step.marker, step.start) for step in done.steps] == [(step.marker, step.start) for step in expected.steps]


def test_a_carried_marker_keeps_its_place_in_its_segment(rng):
    positions = body(rng)
    usable = rng.random(positions.shape[:2]) > 0.1
    positions = positions + 0.1 * rng.normal(size=positions.shape)
    place = carried(positions, usable, rigidity(positions, usable))
    assert np.abs(place - positions).max() < 1.0
    assert np.isnan(carried(positions[:, :3], usable[:, :3], rigidity(positions[:, :3], usable[:, :3]))).all()
