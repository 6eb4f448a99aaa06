"""Rotations against those of SciPy, and frames of a rigid segment."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mocapclean.geometry.alignment import segment_frames
from mocapclean.geometry.body_frames import BodyFrames
from mocapclean.geometry.rotations import fit_rotations


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), rank=st.sampled_from([2, 3]))
def test_rotations_are_those_of_scipys_alignment(seed, rank):
    rng = np.random.default_rng(seed)
    shape = rng.normal(size=(6, 3)) * 200
    shape[:, 2] *= rank == 3
    seen = Rotation.random(4, random_state=seed).as_matrix()
    points = np.einsum("nij,qj->nqi", seen, shape) + rng.normal(size=(4, 6, 3))
    moments = np.einsum("nqi,qj->nij", points, shape)
    expected = [Rotation.align_vectors(frame, shape)[0].as_matrix() for frame in points]
    assert np.allclose(fit_rotations(moments), expected, atol=1e-6)


def test_a_mirrored_cloud_is_turned_and_not_mirrored(rng):
    moments = rng.normal(size=(50, 3, 3))
    moments[::2, 0] *= -1
    rotations = fit_rotations(moments)
    assert np.allclose(np.linalg.det(rotations), 1.0)
    left, _, right = np.linalg.svd(moments)
    left[..., -1] *= np.sign(np.linalg.det(left @ right))[:, None]
    assert np.allclose(rotations, left @ right, atol=1e-6)


def test_zero_moments_give_the_identity():
    assert np.allclose(fit_rotations(np.zeros((2, 3, 3))), np.eye(3))


@pytest.mark.parametrize("n_points", [3, 8])
def test_a_rigid_segment_does_not_move_in_its_own_frames(rng, n_points):
    shape = rng.normal(size=(n_points, 3)) * 100
    turns = Rotation.random(40, random_state=3).as_matrix()
    points = np.einsum("nij,qj->nqi", turns, shape) + 1000 * rng.normal(size=(40, 1, 3))
    found = segment_frames(points[None], np.ones((1, 1, n_points)), np.array([40]))
    frames = BodyFrames(found.axes[0, 0], found.origins[0, 0])
    local = frames.to_local(points)
    assert np.abs(local - local.mean(axis=0)).max() < 1e-6
    assert np.allclose(frames.to_world(local), points)
