import numpy as np

from mocapclean.simulate import hide
from mocapclean.solvers.kriging import Params
from mocapclean.solvers.kriging.extrapolation import pose_growth
from mocapclean.solvers.running import run_method
from mocapclean.take import Take


def opening(angles: np.ndarray) -> np.ndarray:
    """(F, 3, 3) mm: two segments of 300 mm at an angle, their joint in the middle."""
    end = 300 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    start = np.broadcast_to([300.0, 0, 0], end.shape)
    return np.stack([start, 0 * end, end], axis=1)


def test_variance_grows_with_the_distance_from_the_poses_that_were_seen():
    positions = opening(np.linspace(0.2, 2.2, 400))
    known = np.arange(100, 130)
    growth = pose_growth(positions, known, np.arange(130, 400), 10, 0.3)
    assert growth[0] == 1.0
    assert (np.diff(growth[20:200]) > 0.0).all()
    assert growth[200] > 10.0
    # Poses that were seen cost nothing, at whatever time they come.
    again = np.concatenate([positions[:200], positions[100:130]])
    assert (pose_growth(again, known, np.arange(200, 230), 10, 0.3) == 1.0).all()


def test_without_two_neighbours_or_two_frames_there_is_no_pose():
    positions = opening(np.linspace(0.2, 2.2, 50))
    gap = np.arange(20, 30)
    assert (pose_growth(positions[:, :1], np.arange(10), gap, 4, 0.3) == 1.0).all()
    assert (pose_growth(positions, np.array([3]), gap, 4, 0.3) == 1.0).all()


def test_a_marker_that_is_seen_briefly_has_honest_error_bars(rng):
    # A finger on a hand that turns on its own, at the end of an arm of two rigid clusters.
    t = np.arange(700) / 100.0
    trunk = np.stack([25 * np.sin(6 * t), 900 * t, 950 + 20 * np.cos(12 * t)], axis=1)
    swing, bend = 0.5 * np.sin(6 * t), 1.1 * np.sin(3.5 * t) + 0.4 * np.sin(8 * t)
    wrist = trunk + 300 * np.stack([0 * t, np.sin(swing), -np.cos(swing)], axis=1)
    finger = wrist + 120 * np.stack([np.sin(bend), np.cos(bend) * np.sin(2.2 * t), -np.cos(bend)], axis=1)
    shape = rng.normal(size=(5, 3)) * 60
    truth = np.concatenate([trunk[:, None] + shape, wrist[:, None] + shape, finger[:, None]], axis=1)
    truth += 0.3 * rng.normal(size=truth.shape)
    names = tuple(f"m{k}" for k in range(truth.shape[1]))
    take = Take(positions=truth, trusted=np.ones(truth.shape[:2], bool), markers=names, rate=100.0)
    missing = np.zeros_like(take.trusted)
    missing[:340, -1] = missing[361:, -1] = True
    solution = run_method("kriging", hide(take, missing), Params())
    errors, sd = (solution.positions - truth)[missing], solution.sd[missing]
    assert np.sqrt(np.square(errors).sum(axis=1).mean()) > 30.0
    assert (np.abs(errors) <= 1.645 * sd[:, None]).mean() > 0.85
    for span in (slice(0, 340), slice(361, 700)):
        assert np.sqrt(3 * np.square(solution.sd[span, -1]).mean()) > 30.0
