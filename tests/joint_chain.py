"""A chain of joints and its clean motion, for the tests of what is detected in joints."""

import numpy as np

from mocapclean.geometry.joint_motion import JointMotion, continuous, from_vectors
from mocapclean.geometry.skeleton import Channel, Skeleton


def skeleton(n_joints: int, size: float = 1.0) -> Skeleton:
    """Return a chain of joints 300 mm times ``size`` apart; the root has position channels."""
    before = np.zeros((n_joints, 3))
    before[1:, 1] = 300.0 * size
    shifts = [Channel(joint=0, axis=axis, is_rotation=False) for axis in range(3)]
    turns = [Channel(joint=joint, axis=axis, is_rotation=True) for joint in range(n_joints) for axis in range(3)]
    return Skeleton(
        names=tuple(f"joint{joint}" for joint in range(n_joints)),
        parents=tuple(range(-1, n_joints - 1)),
        before=before,
        after=np.zeros((n_joints, 3)),
        frames=np.broadcast_to(np.eye(3), (n_joints, 3, 3)).copy(),
        channels=(*shifts, *turns),
        product=tuple(range(3, 3 + 3 * n_joints)),
    )


def smooth(rng: np.random.Generator, rate: float, n_joints: int, n_frames: int) -> JointMotion:
    """Return a clean motion: swings of up to 40 degrees at 0.3 to 1 Hz, and a root that walks at 1 m/s."""
    time = np.arange(n_frames)[:, None, None] / rate
    frequency, phase = rng.uniform(0.3, 1.0, (n_joints, 3)), rng.uniform(0, 6, (n_joints, 3))
    vectors = rng.uniform(10, 40, (n_joints, 3)) * np.sin(2 * np.pi * frequency * time + phase)
    translations = np.zeros((n_frames, n_joints, 3))
    translations[:, 0, 2] = 1000.0 * time[:, 0, 0]
    translations[:, 0, 1] = 900.0 + 20.0 * np.sin(2 * np.pi * 1.8 * time[:, 0, 0])
    known = np.ones((n_frames, n_joints), dtype=bool)
    return JointMotion(
        rotations=continuous(from_vectors(vectors)),
        translations=translations,
        turns=known[0],
        shifts=np.arange(n_joints) == 0,
        rotation_known=known,
        translation_known=known,
    )
